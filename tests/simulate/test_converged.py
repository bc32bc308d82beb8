"""Meshes that `flexarm.converged` chooses: their true errors, their cost and their warnings."""

import sys

import numpy as np
import pytest

import flexarm as fa

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
DURATION, QUIET = 0.4, {"rate": 100.0, "progress": False}


def two_links(**fields):
    links = [fa.Link(length=1.4142, **ROD, **fields), fa.Link(length=1.0, **ROD, **fields)]
    return fa.Arm(
        links=links, joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.03)]
    )


def torque(t):
    return np.array([2.0, 0.5]) * np.sin(6.0 * t)


def candidates(study):
    """Return modes, segments and theory of all models of a study."""
    table = study.table
    sizes = table.modes.values.tolist(), table.segments.values.tolist()
    return list(zip(*sizes, table.theory.values.tolist(), strict=True))


def apart(one, other):
    return float(np.linalg.norm((one.tip - other.tip).values[:, :2], axis=1).max())


@pytest.mark.parametrize("accuracy", [1e-3, 3e-5])
def test_true_error_is_within_the_accuracy_and_near_the_estimate(accuracy):
    """The truth has six segments of three modes, which no study computes."""
    study = fa.converged(two_links(), DURATION, torque=torque, accuracy=accuracy, **QUIET)
    truth = fa.simulate(
        fa.Arm(
            study.arm.spec.replace(
                links=[
                    fa.Link(length=length, elements=18, segments=6, modes=3, **ROD)
                    for length in (1.4142, 1.0)
                ],
                theory="second_order",
            )
        ),
        DURATION,
        torque=torque,
        rtol=1e-8,
        **QUIET,
    )
    error = apart(study.result, truth)
    assert error <= study.model_error + study.result.attrs["integration_error"] <= accuracy
    # An estimate that is much larger than the error would make the chosen model too fine.
    assert error >= 0.2 * study.model_error
    assert study.converged
    assert study.result.attrs["model_error"] == study.model_error
    assert study.accuracy == study.result.attrs["accuracy"] == accuracy


def test_less_accuracy_needs_fewer_coordinates():
    coarse, fine = (
        fa.converged(two_links(), DURATION, torque=torque, accuracy=accuracy, **QUIET)
        for accuracy in (3e-3, 1e-5)
    )
    assert coarse.arm.dof < fine.arm.dof
    assert coarse.table.sizes["candidate"] <= fine.table.sizes["candidate"]


def test_given_mesh_and_theory_have_no_effect():
    meshes = ({}, {"elements": 8, "segments": 2, "modes": 3})
    one, other = (
        fa.converged(two_links(**mesh), DURATION, torque=torque, accuracy=1e-3, **QUIET)
        for mesh in meshes
    )
    np.testing.assert_array_equal(one.result.tip, other.result.tip)
    assert candidates(one) == candidates(other)


def test_chosen_model_is_the_cheapest_accurate_one():
    study = fa.converged(two_links(), DURATION, torque=torque, accuracy=1e-3, **QUIET)
    table = study.table
    coordinates = 2 + (table.modes * table.segments).sum("link")
    accurate = table.model_error <= 0.8 * study.accuracy
    work = (table.evaluations * coordinates)[accurate.values]
    assert float(work.min()) == float(work[table.chosen.values[accurate.values]].item())
    assert int(table.chosen.sum()) == 1
    assert int(coordinates[table.chosen.values].item()) == study.arm.dof
    link = study.arm.spec.links[0]
    at = int(np.flatnonzero(table.chosen)[0])
    assert (link.elements, link.segments) == (table.elements[at, 0], table.segments[at, 0])


def test_default_accuracy_is_relative_to_the_reach():
    study = fa.converged(two_links(), 0.1, torque=torque, **QUIET)
    assert study.accuracy == pytest.approx(1e-4 * 2.4142, rel=1e-12)


@pytest.mark.parametrize("gauged", [False, True])
def test_links_that_hardly_bend_become_rigid_except_for_those_with_gauges(gauged):
    gauges = (fa.Gauge(station=0.0, distance=0.01),) if gauged else ()
    links = [fa.Link(length=1.0, flexural_rigidity=2e4, mass_per_length=1.0, gauges=gauges)] * 2
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2)
    study = fa.converged(arm, 0.1, torque=torque, accuracy=1e-3, **QUIET)
    assert [link.flexible for link in study.arm.spec.links] == [gauged, gauged]
    assert study.table.modes.min() == int(gauged)
    assert study.converged


def test_rigid_arm_has_one_model_without_error():
    arm = two_links().rigid()
    study = fa.converged(arm, 0.1, torque=torque, **QUIET)
    assert candidates(study) == [([0, 0], [1, 1], "second_order")]
    assert study.model_error == 0.0
    assert study.converged


def test_far_bent_link_with_modal_damping_is_not_converged():
    soft = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 0.5}
    link = fa.Link(**soft, damping=fa.ModalDamping(ratio=0.02))
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)])
    refused = pytest.warns(fa.AccuracyWarning, match="does not permit segments; Rayleigh damping")
    with pytest.warns(fa.LargeDeflectionWarning), refused:
        study = fa.converged(arm, 0.5, torque=lambda t: [1.0], accuracy=1e-5, **QUIET)
    assert not study.converged
    assert study.model_error > study.accuracy
    assert "no model of the study reaches" in study.result.attrs["warning"]
    # Finer models than the one whose modes err less than its theory would cost for nothing.
    assert study.table.modes.max() < 12


def test_bending_error_of_a_damped_link_is_measured_without_its_damping():
    link = fa.Link(length=1.0, flexural_rigidity=30.0, mass_per_length=0.5)
    damped = link.replace(damping=fa.ModalDamping(ratio=0.001))
    joints = [fa.Joint(hub_inertia=0.1)] * 2
    options = {"torque": lambda t: [4.0 * np.sin(6.0 * t), 0.0], **QUIET}
    arm = fa.Arm(links=[damped] * 2, joints=joints)
    study = fa.converged(arm, 0.6, accuracy=4e-4, **options)
    modes = int(study.table.modes.max())
    sizes = {"elements": 8, "modes": modes}, {"elements": 8, "segments": 4, "modes": 2}
    pieces, segments = (
        fa.simulate(
            fa.Arm(links=[link.replace(**size)] * 2, joints=joints, theory="second_order"),
            0.6,
            rtol=1e-8,
            **options,
        )
        for size in sizes
    )
    bending = apart(pieces, segments)
    # The finest model also errs by its modes, a quarter as much. With the estimate of the theory
    # in place of the comparison, the error would be 3.8 times as large.
    assert bending <= study.table.model_error.min() <= 1.5 * bending
    assert study.converged


def test_work_of_the_study_is_limited(monkeypatch):
    module = sys.modules["flexarm.simulation.calls.convergence"]
    monkeypatch.setattr(module, "_LIMIT", 6.0)
    with pytest.warns(fa.AccuracyWarning, match="would exceed the work of the study"):
        study = fa.converged(two_links(), DURATION, torque=torque, accuracy=1e-6, **QUIET)
    assert not study.converged
    assert study.model_error > 1e-6
    table = study.table
    plain = candidates(study).index(([2, 2], [1, 1], "second_order"))
    # Expected work of the last run may be wrong by the ratio of two frequencies.
    assert table.attrs["work"] <= 2.0 * 6.0 * float(table.evaluations[plain]) * 6


def test_start_with_bent_links_is_a_function_of_the_arm():
    arm = two_links()
    bent = arm.rest([0.3, -0.5])
    bent[1] = 0.01
    with pytest.raises(fa.InputError, match="initial must describe straight links, or be a func"):
        fa.converged(arm, 0.1, initial=bent, **QUIET)
    heavy = fa.Arm(arm.spec.replace(gravity=(0.0, -1.0), theory="second_order"))
    hold = fa.equilibrium(heavy, [0.3, -0.5])
    study = fa.converged(
        heavy,
        0.2,
        torque=lambda t: hold.torque,
        initial=lambda one: fa.equilibrium(one, [0.3, -0.5]).q,
        accuracy=1e-3,
        **QUIET,
    )
    assert np.linalg.norm(study.result.tip.values[0, :2] - heavy.tip(hold.q)[:2]) < 1e-3
    assert study.converged


def test_controller_keeps_its_model_and_its_state():
    arm = two_links(modes=2)
    line = fa.joint_motion(arm, [0.0, 0.0], [0.3, -0.2], 0.4)
    controller = fa.JointPD([5.0, 2.0], [1.0, 0.4], sample_time=0.002)
    before = vars(controller).copy()
    study = fa.converged(
        arm, DURATION, controller=controller, reference=line, accuracy=1e-3, **QUIET
    )
    assert vars(controller) == before
    again = fa.simulate(
        arm, DURATION, controller=controller, reference=line, plant=study.arm, **QUIET
    )
    assert apart(study.result, again) < 1e-4
    assert study.converged


def test_tolerances_cannot_be_combined_with_the_accuracy():
    with pytest.raises(fa.InputError, match="accuracy cannot be combined with rtol"):
        fa.converged(two_links(), 0.1, rtol=1e-6, **QUIET)


def test_failures_are_those_of_simulate():
    rule = r"^converged: torque\(1e-13\) must be numbers of shape \(2,\)"
    with pytest.raises(fa.InputError, match=rule):
        fa.converged(two_links(), 0.1, torque=lambda t: np.zeros(3), **QUIET)
    with pytest.raises(fa.InputError, match=r"^converged: tip_force must be \(Fx, Fy\) or"):
        fa.converged(two_links(), 0.1, tip_force=[1.0], **QUIET)

    def failing(t):
        raise ValueError("no torque")

    with pytest.raises(fa.SimulationError, match="no torque"):
        fa.converged(two_links(), 0.1, torque=failing, **QUIET)


def test_print_shows_the_table_and_the_choice():
    study = fa.converged(two_links(), 0.1, torque=torque, accuracy=1e-3, **QUIET)
    lines = str(study).splitlines()
    assert lines[0] == repr(study)
    assert lines[1].split() == ["modes", "segments", "theory", "error", "(m)", "evaluations"]
    assert len(lines) == 2 + study.table.sizes["candidate"]
    assert sum(line.endswith("chosen") for line in lines) == 1
    assert "not converged" not in lines[0]
