"""LQG and MPC of mechanisms: nonlinear runs against the poles of the sampled loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import cooperating_arms, five_bar
from flexarm.control.analysis.margins import loop_at
from flexarm.control.design.minimal import MinimalCoordinates

DAMPED = {"modes": 2, "elements": 2, "damping": fa.ModalDamping(ratio=0.02)}
POLE = fa.Link(length=0.8, flexural_rigidity=20.0, mass_per_length=0.5, **DAMPED)
WEIGHT = {"gravity": (0.0, -9.81), "payload": fa.Payload(mass=0.3)}
UPRIGHT = fa.Joint(mounting_angle=np.pi / 2)
STEP = 2e-3


@dataclass
class Case:
    """An arm, options of LQG, and a posture with a small deviation of its joints, rad or m."""

    arm: fa.Arm
    posture: np.ndarray
    deviation: np.ndarray
    options: dict[str, Any]

    def law(self, kind: Any = fa.LQG, **options: Any) -> Any:
        return kind(self.arm, self.posture, sample_time=STEP, **{**self.options, **options})

    def run(self, law: Any, duration: float, **options: Any) -> Any:
        """Simulate from rest near the equilibrium; a deviation from it is small."""
        arm, driven = self.arm, self.options.get("actuated")
        rest = fa.equilibrium(arm, self.posture, held=driven if arm.closure_rows else None)
        held = driven if arm.closure_rows else ()
        start = fa.assembled(arm, rest.q + arm.rest(self.deviation), held=held).q
        still = fa.joint_motion(arm, self.posture, self.posture, 1.0, driven=held or None)
        options = {"reference": still, "rate": 1.0 / STEP, "rtol": 1e-9, **options}
        return fa.simulate(arm, duration, controller=law, initial=start, **options)


def five_bar_from_its_motors() -> Case:
    closed = five_bar(gravity=(0.0, -9.81))
    links = [link.replace(**DAMPED) for link in closed.fields["links"]]
    arm = fa.Arm(**{**closed.fields, "links": links})
    options = {"actuated": [1, 3], "rigidity_uncertainty": 0.3, "recovery": 0.3}
    return Case(arm, closed.joints, np.array([1e-5, 0.0, -2e-5, 0.0]), options)


def free_flyer() -> Case:
    arm = fa.Arm(
        base=fa.Base(mass=5.0, inertia=0.8, free=("x", "y", "angle")),
        links=[POLE, POLE.replace(parent=0)],
        joints=[fa.Joint(offset=(0.4, 0.0)), fa.Joint(offset=(-0.4, 0.1), mounting_angle=np.pi)],
    )
    options = {"rigidity_uncertainty": 0.2}
    return Case(arm, np.array([0.2, -0.1]), np.array([1e-5, 3e-5]), options)


def pole_on_a_free_cart() -> Case:
    base = fa.Base(mass=2.0, free=("x",))
    arm = fa.Arm(base=base, links=[POLE], joints=[UPRIGHT], **WEIGHT)
    return Case(arm, np.zeros(1), np.array([1e-5]), {"rigidity_uncertainty": 0.2})


def pole_on_a_driven_cart() -> Case:
    cart = fa.Link(length=0.1, mass_per_length=20.0, flexible=False)
    arm = fa.Arm(links=[cart, POLE], joints=[fa.Joint(kind="prismatic"), UPRIGHT], **WEIGHT)
    options = {"actuated": [1], "rigidity_uncertainty": 0.2}
    return Case(arm, np.zeros(2), np.array([0.0, 1e-5]), options)


def pole_on_springs() -> Case:
    springs = {"stiffness": (500.0, 0.0, 0.0), "damping": (5.0, 0.0, 0.0)}
    base = fa.Base(mass=2.0, free=("x",), **springs)
    arm = fa.Arm(base=base, links=[POLE], joints=[UPRIGHT], **WEIGHT)
    return Case(arm, np.zeros(1), np.array([1e-5]), {"rigidity_uncertainty": 0.2})


CASES = {
    case.__name__: case
    for case in (
        five_bar_from_its_motors,
        free_flyer,
        pole_on_a_free_cart,
        pole_on_a_driven_cart,
        pole_on_springs,
    )
}


def predicted(law: Any, case: Case, run: Any, plant: fa.Arm | None = None) -> np.ndarray:
    """Return the deviations of the joints (T, joints) of the linear loop from the start of a run.

    The powers of the matrix whose eigenvalues are the poles.
    """
    loop = loop_at(law, plant, law.designs[0].posture)
    coordinates = law._coordinates
    rest = coordinates.at_rest(law.designs[0].posture)
    (matrix,) = loop.matrices()
    state = np.zeros(len(matrix))
    deviation = (run.q.values[0] - rest.q)[coordinates.chosen]
    state[: deviation.size] = deviation
    # The memory of the law follows; its first prediction has the measured joint angles.
    measured = np.isin(coordinates.chosen, case.arm.joint_index)
    state[len(loop.plant.A[0]) :][: deviation.size] = measured * deviation
    rows = [k for k, name in enumerate(loop.plant.outputs) if name.startswith("joint_angle")]
    found = []
    for _ in range(run.time.size):
        found.append(loop.plant.C[0][rows] @ state[: loop.plant.C[0].shape[1]])
        state = matrix @ state
    return np.array(found) + rest.q[case.arm.joint_index]


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # closure forces
@pytest.mark.parametrize("name", CASES)
def test_small_motions_are_those_of_the_linear_loop(name):
    """Deviations of 1e-5 in a nonlinear run; the linear loop errs by their square."""
    case = CASES[name]()
    law = case.law()
    assert law.loop_poles()[0].real < -0.5
    run = case.run(law, 1.0)
    expected = predicted(law, case, run)
    size = np.abs(case.deviation).max()
    assert np.abs(expected[-1] - expected[0]).max() > 0.1 * size  # it moves
    np.testing.assert_allclose(run.joint_angle.values, expected, rtol=0, atol=1e-3 * size)


def test_a_loop_that_is_not_stable_grows_with_its_pole():
    """The payload of the plant is three times that of the design."""
    case = pole_on_a_driven_cart()
    law, plant = case.law(rigidity_uncertainty=0.0), fa.varied(case.arm, payload_factor=3.0)
    growth = law.loop_poles(plant)[0].real
    assert growth > 3.0
    assert fa.loop_margins(law, plant).growth.item() == pytest.approx(growth)
    case.deviation *= 1e-3
    with pytest.warns(fa.UnstableLoopWarning):
        run = case.run(law, 1.6, plant=plant)
    expected = predicted(law, case, run, plant)
    size = np.abs(expected).max()
    assert size > 100.0 * np.abs(case.deviation).max()
    np.testing.assert_allclose(run.joint_angle.values, expected, rtol=0, atol=1e-3 * size)


def test_mpc_is_the_regulator_without_active_limits_and_keeps_limits_of_motors():
    case = five_bar_from_its_motors()
    regulated = case.run(case.law(), 0.1).torque.values
    assert not np.any(regulated[:, [1, 3]])
    free = case.run(case.law(fa.MPC, torque_limit=3.0, horizon=8), 0.1)
    np.testing.assert_allclose(free.torque.values, regulated, atol=1e-10)
    assert free.attrs["mpc_limited"] == 0
    case.deviation *= 1e3
    limits = [1.05, 1.0, 1.3, 1.0]
    cut = case.run(case.law(fa.MPC, torque_limit=limits, horizon=8), 0.1)
    assert cut.attrs["mpc_limited"] > 0
    assert np.all(np.abs(cut.torque.values) <= np.array(limits) * (1.0 + 1e-6))


def test_the_preview_of_elastic_forces_improves_the_motion_of_a_five_bar():
    case = five_bar_from_its_motors()
    end = case.posture + np.array([0.4, 0.0, 0.3, 0.0])
    motion = fa.joint_motion(case.arm, case.posture, end, 0.6, driven=[1, 3])
    errors = []
    for preview in (0.0, None):
        run = case.run(case.law(preview=preview), 1.2, reference=motion, rtol=1e-6)
        missed = run.joint_angle.values - motion.joint_angle(run.time.values)
        errors.append(np.abs(missed[:, [0, 2]]).max())
    assert np.abs(missed[-1, [0, 2]]).max() < 2e-3  # the sag is that of the first posture
    assert errors[1] < 0.5 * errors[0]


def test_a_reference_that_opens_the_loops_is_refused():
    case = five_bar_from_its_motors()
    end = case.posture + np.array([3.0, 0.0, -3.0, 0.0])
    motion = fa.joint_motion(case.arm, case.posture, end, 1.0)
    start = fa.equilibrium(case.arm, case.posture, held=[1, 3]).q
    with pytest.raises(fa.SimulationError, match="reference must close the loops"):
        fa.simulate(case.arm, 1.0, controller=case.law(), reference=motion, initial=start)


def test_closures_between_links_do_not_hold_a_free_base():
    closed = cooperating_arms()
    arm = fa.Arm(**closed.fields)
    coordinates = MinimalCoordinates(arm, [1], closed.joints)
    assert coordinates.drifting.tolist() == [base.place for base in arm.assembly.base]
    fa.LQG(arm, posture=closed.joints, actuated=[1], sample_time=1e-3)


@pytest.mark.parametrize("case", [five_bar_from_its_motors, free_flyer])
def test_designs_with_the_hardware_of_the_motors(case):
    """Late motors make the loops of designs for ideal ones unstable."""
    motors = fa.Motors(delay=1.5 * STEP, time_constant=2e-3)
    hardware = fa.Hardware([fa.Instrument("joint_angle", rate_cutoff=80.0)], motors)
    given = case()
    growth = [
        loop_at(given.law(**options), given.arm, given.posture, hardware).poles()[0].real
        for options in ({}, {"hardware": hardware})
    ]
    assert growth[0] > 0.0 > growth[1]
