"""Representations at the prompt: one short line."""

import numpy as np
import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=1)
ARM = fa.Arm(links=[LINK, LINK])
MOTION = fa.joint_motion(ARM, [0.2, 0.9], [0.3, 1.0], 1.0, start_time=0.6)
INVERSE = fa.tip_inversion(ARM, MOTION, reduction=0.5)

SHOWN = {
    "modes": (
        fa.modes(ARM),
        "<flexarm.Modes: 4: 0.8852, 5.592, 18.91, 54.89 Hz>",
    ),
    "modes of a spinning arm": (
        fa.modes(fa.Arm(links=[LINK], theory="second_order"), spin=2.0),
        "<flexarm.Modes: 2, spinning at 2 rad/s: 3.559, 35.04 Hz>",
    ),
    "many modes": (
        fa.modes(fa.Arm(links=[LINK] * 3), joints="free"),
        "<flexarm.Modes: 9: 0, 0, 0, 11.91, ... Hz>",
    ),
    "no modes": (fa.modes(ARM.rigid()), "<flexarm.Modes: 0>"),
    "equilibrium": (
        fa.equilibrium(ARM, [0.1, 0.2], tip_force=(0.0, 2.0)),
        "<flexarm.Equilibrium: 6 coordinates, stable, held by -3.759, -1.785 N m, 1 load>",
    ),
    "tracks": (
        fa.track_modes(ARM, [[0.0, 0.1], [0.0, 0.5]], count=2),
        "<flexarm.ModeTracks: 2 modes at 2 samples, posture 0 to 1, from 0.8862, 5.564 Hz>",
    ),
    "separation": (
        fa.linearize_along(ARM, MOTION, rate=10.0),
        "<flexarm.Separation: 12 states, 2 inputs, joints free, 11 samples from 0.6 to 1.6 s>",
    ),
    "step": (
        fa.step_jacobian(
            ARM, np.zeros(6), np.zeros(6), [1.0, 0.0], 1e-4, parameters=["payload.mass"]
        ),
        "<flexarm.StepJacobian: 12 states by 12 states, 2 torques, payload.mass>",
    ),
    "torque of the joints": (
        fa.flexible_torque(ARM, MOTION),
        "<flexarm.FlexibleTorque: 2 joints, up to 1.6 s>",
    ),
}


@pytest.mark.parametrize("name", SHOWN)
def test_repr_has_one_line_with_the_main_values(name):
    value, expected = SHOWN[name]
    assert repr(value) == expected


def test_repr_of_an_inversion_states_its_error():
    text = repr(INVERSE)
    assert text.startswith("<flexarm.TipInversion: 2 torques from ")
    assert f"tip within {INVERSE.tip_error:.2g} m of its path" in text
    assert len(text) < 160
    assert len(repr(INVERSE.torque)) < 120


def test_zero_damping_has_no_sign():
    assert not np.signbit(fa.modes(ARM).damping_ratio).any()
