"""A payload that is heavier than in the model: what margins do not show, and the cure."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from arms import chain

POSTURE = np.array([0.3, 0.6])


def arm_with(payload: float) -> fa.Arm:
    rod = {"flexural_rigidity": [45.0, 20.0], "mass_per_length": [0.6, 0.4], "elements": 1}
    joints = [
        fa.Joint(hub_inertia=0.05),
        fa.Joint(mass=0.8, hub_inertia=0.01, housing_inertia=0.01),
    ]
    more = {"damping": 0.01, "gauge": (0.02, 0.004), "payload": payload}
    return fa.Arm(chain((0.62, 0.48), joints, **rod, **more).spec.replace(gravity=(0.0, -9.81)))


def rest_error(controller: fa.Controller, payload: float) -> np.ndarray:
    """Return the joint errors (2,) rad after 4 s at a constant reference."""
    arm = arm_with(0.3)
    reference = fa.joint_motion(arm, POSTURE, POSTURE + 1e-6, 0.1)
    run = fa.simulate(
        arm,
        4.0,
        controller=controller,
        reference=reference,
        plant=arm_with(payload),
        initial=fa.equilibrium(arm, POSTURE).q,
        rate=50.0,
    )
    angle = run.q.values[:, arm.joint_index]
    assert np.ptp(angle[-10:], axis=0).max() < 1e-3  # at rest
    error: np.ndarray = angle[-1] - POSTURE
    return error


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.filterwarnings("ignore:the tip rests:flexarm.AccuracyWarning")  # rigid angles
def test_composite_control_without_an_integral_rests_beside_its_reference() -> None:
    """Its margins are good, and the error is proportional to the weight that its model lacks."""
    controller = fa.Composite(arm_with(0.3), POSTURE, integral=False)
    heavy = fa.loop_margins(controller, arm_with(0.6), POSTURE)
    assert heavy.growth.max() < -3.0
    assert heavy.worst_disk_margin.min() > 0.6
    small, large = (rest_error(controller, payload) for payload in (0.33, 0.6))
    assert abs(large[1]) > 0.25
    # Ten times the weight; the arm turns by 0.3 rad, which changes its weight's arm by a tenth.
    assert large == pytest.approx(10.0 * small, rel=0.15)
    regulator = fa.LQG(arm_with(0.3), POSTURE, integral="chord_angle")
    assert np.abs(rest_error(regulator, 0.6)).max() < 0.2 * np.abs(large).max()
    # The slowest pole of the default, at -2.1 1/s, leaves exp(-8) of the error after 4 s.
    default = fa.Composite(arm_with(0.3), POSTURE)
    assert fa.loop_margins(default, arm_with(0.6), POSTURE).worst_disk_margin.min() > 0.6
    assert np.abs(rest_error(default, 0.6)).max() < 1e-3 * np.abs(large).max()


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_poles_are_those_without_torque_limits() -> None:
    """Far from its posture, the law requests torques beyond them until the links have sagged."""
    arm, away = arm_with(0.3), [1.2, 0.2]
    limit = 1.4 * np.abs(fa.equilibrium(arm, POSTURE).torque)
    assert np.all(np.abs(fa.equilibrium(arm, away).torque) < limit)
    laws = fa.Composite(arm, POSTURE), fa.Composite(arm, POSTURE, torque_limit=limit)
    free, limited = (fa.loop_margins(law, arm, away).growth.item() for law in laws)
    assert limited == pytest.approx(free, rel=1e-9)


def test_composite_control_integrates_joints_only() -> None:
    assert fa.Composite(arm_with(0.3)).integral is True
    flat = fa.Arm(arm_with(0.3).spec.replace(gravity=(0.0, 0.0)))
    assert fa.Composite(flat).integral is False
    with pytest.raises(fa.InputError, match="integral is not supported for the tip"):
        fa.Composite(flat, integral="tip")
