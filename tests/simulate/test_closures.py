"""Runs of mechanisms with loops: gaps, agreement of methods, rigid limits, momentum, failures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexarm as fa
from closed_mechanisms import (
    FOUR_BAR,
    SLIDER_CRANK,
    Closed,
    cooperating_arms,
    four_bar,
    slider_crank,
)
from oracles.mechanisms import oracle_of


def start(mechanism: Closed, crank_rate: float) -> tuple[fa.Arm, dict[str, Any]]:
    """The arm and the start of a run with straight links and a rate of the first joint."""
    arm = fa.Arm(**mechanism.fields)
    rates = np.zeros(arm.n_joints)
    rates[0] = crank_rate
    state = fa.assembled(arm, arm.rest(mechanism.joints), arm.rest(rates), held=[1])
    return arm, {"initial": state.q, "initial_rate": state.qd}


def largest_gap(arm: fa.Arm, result: Any) -> float:
    """The largest gap of all samples."""
    return max(float(np.abs(arm.closure_gaps(q)).max()) for q in result.q.values)


def test_rigid_four_bar_moves_and_pulls_as_in_closed_form() -> None:
    torque, rate, duration = 0.4, 3.0, 2.0
    arm, first = start(four_bar(0.7, flexible=False), rate)
    run = fa.simulate(
        arm, duration=duration, torque=lambda t: [torque, 0, 0], accuracy=1e-8, **first
    )

    def slope(t: float, y: np.ndarray) -> list[float]:
        return [y[1], FOUR_BAR.motion(y[0], y[1], torque)[0][0]]

    times = run.time.values
    exact = solve_ivp(
        slope, (0, duration), [0.7, rate], "DOP853", t_eval=times, rtol=1e-11, atol=1e-11
    )
    # The accuracy over the shortest link.
    assert run.joint_angle[:, 0].values == pytest.approx(exact.y[0], abs=1e-8 / 0.3)
    forces = [FOUR_BAR.motion(*y, torque)[1] for y in exact.y.T]
    # Forces change with the state, some hundred times its error.
    assert run.closure_force.values == pytest.approx(np.array(forces), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("mechanism", [four_bar(), slider_crank(theory="second_order")])
def test_methods_agree_and_keep_loops_and_energy(mechanism: Closed) -> None:
    arm, first = start(mechanism, 2.0)
    tips = []
    for options in (
        {"integrator": "dormand_prince_8", "accuracy": 1e-7},
        {"integrator": "kennedy_carpenter_5", "accuracy": 1e-7},
        {"integrator": "rk4", "step": 2e-5},
    ):
        run = fa.simulate(arm, duration=0.3, **first, **options)
        tips.append(run.tip.values)
        energy = (run.kinetic_energy + run.strain_energy + run.gravity_energy).values
        assert largest_gap(arm, run) < 1e-9  # of a reach of about 1 m
        # The error of the energy is that of the fastest vibration, far above the accuracy.
        assert np.ptp(energy) < 1e-6 * run.kinetic_energy.values.max()
    # Three times the accuracy of each run, beyond which it warns.
    assert tips[0] == pytest.approx(tips[1], abs=3e-7)
    assert tips[0] == pytest.approx(tips[2], abs=3e-7)


def test_momentum_of_two_arms_on_a_free_base_is_kept() -> None:
    mechanism = cooperating_arms()
    arm = fa.Arm(**{**mechanism.fields, "gravity": (0.0, 0.0)})
    rates = np.zeros(arm.dof)
    rates[:3] = 0.1, 0.2, 0.3
    state = fa.assembled(arm, arm.rest(mechanism.joints), rates)
    oracle = oracle_of(arm)
    for options in ({}, {"integrator": "kennedy_carpenter_5"}, {"integrator": "rk4", "step": 1e-4}):
        run = fa.simulate(
            arm,
            duration=1.0,
            initial=state.q,
            initial_rate=state.qd,
            torque=lambda t: np.sin(3.0 * t) * np.array([0.3, -0.2, 0.1, 0.1])[: arm.n_joints],
            **options,
        )
        samples = zip(run.q.values[::10], run.qd.values[::10], strict=True)
        momentum = np.array([oracle.momentum(q, qd) for q, qd in samples])
        # Rounding of sums over some thousand steps.
        assert np.abs(momentum - momentum[0]).max() < 1e-12
        assert largest_gap(arm, run) < 1e-9


def flat_parallelogram(angle: float) -> tuple[fa.Arm, np.ndarray]:
    """A rigid parallelogram with its crank at an angle, and its posture."""
    bars = [fa.Link(length=x, mass_per_length=1.0, flexible=False) for x in (0.5, 1.0, 0.5)]
    arm = fa.Arm(
        links=[*bars[:2], bars[2].replace(parent=0)],
        joints=[fa.Joint(), fa.Joint(), fa.Joint(offset=(1.0, 0.0))],
        closures=[fa.Closure(link=2, to_link=3)],
    )
    return arm, arm.rest([angle, -angle, angle])


def test_singular_posture_is_reported_with_its_time() -> None:
    arm, posture = flat_parallelogram(0.5)  # flat after 0.5 s
    with pytest.warns(fa.AccuracyWarning, match=r"singular posture at t = 0\.5 s"):
        fa.simulate(arm, duration=1.0, initial=posture, initial_rate=-posture / 0.5)


def test_start_in_a_singular_posture_is_refused() -> None:
    arm, posture = flat_parallelogram(0.0)
    with pytest.raises(fa.InputError, match=r"closures\[0\]"):
        fa.simulate(arm, duration=1.0, initial=posture)


def test_run_ends_close_to_a_singular_posture() -> None:
    arm, posture = flat_parallelogram(3e-6)
    with (
        pytest.warns(fa.AccuracyWarning, match="singular"),
        pytest.raises(fa.SimulationError, match="singular"),
    ):
        fa.simulate(arm, duration=1.0, initial=posture)


def test_start_must_close_the_loops() -> None:
    arm, first = start(four_bar(), 2.0)
    with pytest.raises(fa.InputError, match=r"initial must close the loops.*closures\[0\]"):
        fa.simulate(arm, duration=0.1)
    with pytest.raises(fa.InputError, match="initial_rate must keep the loops closed"):
        fa.simulate(arm, duration=0.1, initial=first["initial"], initial_rate=arm.rest([1, 0, 0]))
    with pytest.raises(fa.InputError, match="integrator must be one of 'auto'"):
        fa.simulate(arm, duration=0.1, integrator="cowell_4", **first)


@pytest.mark.parametrize("station", [None, 0.0])
def test_reactions_of_a_run_contain_closure_forces(station: float | None) -> None:
    mechanism = four_bar()
    if station is not None:  # a rod on the ground leans on the root of the rocker
        rod = fa.Link(length=0.2, mass_per_length=0.5, parent=0, flexible=False)
        links = [*mechanism.fields["links"], rod]
        joints = [*mechanism.fields["joints"], fa.Joint(offset=(0.8, 0.0))]
        line = fa.Closure(link=4, to_link=3, to_station=0.0, kind="line", angle=0.4)
        fields = {"links": links, "joints": joints}
        fields["closures"] = [*mechanism.fields["closures"], line]
        angles = np.append(mechanism.joints, 0.0)
        mechanism = Closed({**mechanism.fields, **fields}, angles)
    arm, first = start(mechanism, 2.0)
    last = fa.simulate(arm, duration=0.05, **first).isel(time=-1)
    q, qd, still = last.q.values, last.qd.values, np.zeros(arm.n_joints)
    exact = oracle_of(arm).moving(q, qd, still)
    # Rounding of accelerations, whose mass matrix has a condition of 1e4 to 1e5.
    scale = np.abs(exact.joint_force).max()
    np.testing.assert_allclose(
        last.joint_force.values, exact.joint_force, rtol=0.0, atol=1e-8 * scale
    )
    np.testing.assert_allclose(
        last.closure_force.values, exact.closure_force, rtol=0.0, atol=1e-8 * scale
    )
    forces = arm.closure_forces(q, qd, still)
    reactions = arm.joint_reactions(q, qd, exact.acceleration, closure_forces=forces)
    np.testing.assert_allclose(reactions[:, :2], exact.joint_force, rtol=0.0, atol=1e-8 * scale)
    for function in (arm.joint_reactions, arm.section_forces):
        with pytest.raises(fa.InputError, match="closure_forces is required for an arm with clos"):
            function(q, qd, exact.acceleration)


def test_inverse_dynamics_and_sections_contain_given_closure_forces() -> None:
    arm, first = start(four_bar(), 2.0)
    q, qd, torque = first["initial"], first["initial_rate"], [0.3, 0.0, 0.0]
    qdd = arm.forward_dynamics(q, qd, torque)
    forces = arm.closure_forces(q, qd, torque)
    required = arm.inverse_dynamics(q, qd, qdd, closure_forces=forces)
    # Rounding of accelerations, whose mass matrix has a condition of 1e4 to 1e5.
    atol = 1e-8 * np.abs(forces).max()
    applied = np.zeros(arm.dof)
    applied[arm.joint_index] = torque
    np.testing.assert_allclose(required, applied, rtol=0.0, atol=atol)
    without = arm.inverse_dynamics(q, qd, qdd) - arm.closure_jacobian(q).T @ forces
    np.testing.assert_allclose(required, without, rtol=0.0, atol=atol)
    sections = arm.section_forces(q, qd, qdd, closure_forces=forces)
    # The part outboard of the tips of coupler and rocker is the pin.
    crank, elbow, rocker = arm.joint_angles(q)  # links are straight at the start
    for link, angle, sign in ((1, crank + elbow, 1.0), (2, rocker, -1.0)):
        normal, shear, moment = sections[link, -1]
        turned = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        np.testing.assert_allclose(np.array(turned) @ [normal, shear], sign * forces, atol=atol)
        assert abs(moment) < atol


def test_loops_with_controllers_start_closed() -> None:
    light, first = start(four_bar(), 0.0)
    joints = [light.spec.joints[0].replace(hub_inertia=0.05), *light.spec.joints[1:]]
    arm = fa.Arm(light.spec.replace(joints=joints))
    law = fa.JointPD(proportional=[50.0, 0.0, 0.0], derivative=[5.0, 0.0, 0.0])
    posture = arm.joint_angles(first["initial"])
    motion = fa.joint_motion(arm, posture, posture, 0.2)
    with pytest.raises(fa.InputError, match="initial must close the loops"):
        fa.simulate(arm, 0.1, controller=law, reference=motion, initial=arm.rest([1, 0, 0]))
    run = fa.simulate(arm, 0.1, controller=law, reference=motion, initial=first["initial"])
    assert largest_gap(arm, run) < 1e-9
    # A rate gain that is too high for the light crank and the sample time.
    law = fa.JointPD(proportional=[5.0, 0.0, 0.0], derivative=[0.5, 0.0, 0.0])
    with pytest.warns(fa.FlexarmWarning) as warned:
        fa.simulate(light, 0.02, controller=law, reference=motion, initial=first["initial"])
    assert fa.UnstableLoopWarning in [each.category for each in warned]


def test_prescribed_crank_turns_the_rigid_slider_crank() -> None:
    arm, first = start(slider_crank(0.7, flexible=False), 6.0)
    crank = fa.PrescribedAngle(lambda t: 0.7 + 6.0 * t, lambda t: 6.0, lambda t: 0.0)
    with pytest.raises(fa.InputError, match="initial_rate must keep the loops closed"):
        fa.simulate(arm, 0.1, initial=first["initial"], prescribed={1: crank})
    run = fa.simulate(arm, 0.5, prescribed={1: crank}, **first)
    for time, angles in zip(run.time.values[::50], run.joint_angle.values[::50], strict=True):
        _, rod = SLIDER_CRANK.angles(0.7 + 6.0 * time)
        assert angles[1] == pytest.approx(rod.value - angles[0], abs=1e-6)


def test_a_change_of_mass_keeps_the_loops_closed() -> None:
    arm, first = start(four_bar(0.7, flexible=False), 3.0)
    change = fa.Change(path="payload.mass", at=0.2, to=2.0)
    run = fa.simulate(arm, 0.25, changes=[change], accuracy=1e-8, rate=20000.0, **first)
    after = int(np.searchsorted(run.time.values, 0.2, side="right"))
    q, qd = run.q.values[after], run.qd.values[after]
    # A fall of all rates by the impact, with the loop closed.
    assert np.abs(arm.closure_jacobian(q) @ qd).max() < 1e-9
    heavy = fa.Arm(arm.spec.replace(payload=fa.Payload(mass=2.0)))
    bars = heavy.mass_matrix(run.q.values[after - 1])
    before = run.qd.values[after - 1]
    # Reduced to the crank: its momentum is that of the four-bar before.
    motion = before / before[0]
    inertia = motion @ arm.mass_matrix(run.q.values[after - 1]) @ motion
    expected = inertia / (motion @ bars @ motion) * before[0]
    assert qd[0] == pytest.approx(expected, rel=1e-3)  # a sample later
    moved = fa.Change(path="joints[2].offset[0]", at=0.2, to=1.1)
    with pytest.raises(fa.InputError, match="opens the loops"):
        fa.simulate(arm, 0.4, changes=[moved], **first)


def test_forces_of_closures_beyond_the_linear_theory_are_reported() -> None:
    arm, first = start(four_bar(theory="linear"), 30.0)
    with pytest.warns(fa.LargeDeflectionWarning) as warned:
        fa.simulate(arm, 0.1, **first)
    assert any("closure 1 loads link" in str(each.message) for each in warned)


def test_dependent_closures_are_refused_before_a_run() -> None:
    link = fa.Link(length=1.0, mass_per_length=0.5, flexural_rigidity=200.0, modes=3)
    pinned = fa.Arm(links=[link], closures=[fa.Closure(link=1, to_offset=(1.0, 0.0))])
    with pytest.raises(fa.InputError, match=r"closures\[0\]"):
        fa.simulate(pinned, 0.1)


def test_a_far_wall_does_not_change_a_four_bar() -> None:
    arm, first = start(four_bar(), 2.0)
    wall = fa.Contact(surface=fa.Wall(point=(50.0, 0.0), normal=(-1.0, 0.0)), stiffness=1e4)
    alone = fa.simulate(arm, 0.05, **first)
    beside = fa.simulate(arm, 0.05, contacts=[wall], **first)
    np.testing.assert_allclose(beside.tip.values, alone.tip.values, rtol=0.0, atol=1e-9)
