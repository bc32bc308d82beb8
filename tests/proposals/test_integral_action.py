"""Proposals under gravity and for joints that stick: integral feedback, and what it achieves."""

from __future__ import annotations

import numpy as np
import pytest
from proposal_requirements import needs_of, one_link

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.planning.proposals.candidates import Candidate, candidates_of
from flexarm.planning.proposals.design import _best
from flexarm.planning.proposals.requirements import case_of


def test_candidates_under_gravity_have_integral_feedback_and_a_reference_of_the_bent_arm():
    def drives(arm, **options):
        listed = candidates_of(needs_of(arm, "point_to_point", torque_limit=5.0, **options))
        return {candidate.name: candidate.drives[0] for candidate in listed}

    heavy = fa.Arm(one_link().spec.replace(gravity=(0.0, -9.81)))
    found = drives(heavy)
    assert list(found) == ["LQG", "output redefinition", "joint PID"]
    assert found["LQG"]["integral"] == "chord_angle"
    assert found["LQG"]["reference"] == "quasi_static"
    assert found["LQG"]["hardware"]
    assert found["output redefinition"]["inner"]["integral"][0] > 0.0
    assert found["joint PID"]["integral"][0] > 0.0
    for drive in (found["LQG"], found["joint PID"], found["output redefinition"]["inner"]):
        assert drive["torque_limit"] == [5.0]
    assert drives(heavy, sensors="joints")["loop shaping"]["integral"] > 0.0
    free = drives(one_link())
    assert list(free) == ["LQG", "integral resonant", "joint PD"]
    assert "integral" not in free["LQG"]


def test_candidates_for_joints_that_stick_have_integral_feedback():
    """Without gravity, too: friction of 0.01 N m holds the slowest loop 3.7 mrad from its goal.

    That is 0.01 N m over 0.2 kg m^2 of the rigid arm times the square of 0.15 times 24.5 rad/s, the
    frequency of the link.
    """

    def drives(coulomb, **options):
        friction = fa.Friction(coulomb=coulomb)
        arm = one_link(friction=friction) if coulomb else one_link()
        needs = needs_of(arm, "point_to_point", torque_limit=5.0, **options)
        return {candidate.name: candidate.drives[0] for candidate in candidates_of(needs)}

    found = drives(0.01)
    assert list(found) == ["LQG", "integral resonant", "joint PID"]
    assert found["LQG"]["integral"] == "chord_angle"
    assert "reference" not in found["LQG"]
    assert found["joint PID"]["torque_limit"] == [5.0]  # against windup
    assert found["integral resonant"]["inner"]["integral"][0] > 0.0
    found = drives(0.01, sensors="joints")
    assert found["LQG"]["integral"] == "joint_angle"
    assert found["loop shaping"]["integral"] > 0.0
    # Friction that holds the tip within 1e-4 of the reach needs none.
    assert repr(drives(1e-5)) == repr(drives(0.0))


def test_gravity_without_gauges_permits_a_linear_quadratic_design():
    """The chords of the links need strains, so that the integral is that of the joint angles."""
    heavy = fa.Arm(one_link().spec.replace(gravity=(0.0, -9.81)))
    needs = needs_of(heavy, "point_to_point", sensors="joints")
    (first, *_), content = candidates_of(needs), case_of(needs)
    settings = Candidate(first.name, first.reason, first.drives[:1])
    found, errors = _best(needs, content, [settings])
    assert not errors
    assert found["LQG"].stable


@pytest.mark.thorough
@pytest.mark.parametrize("static", [0.1, 0.15], ids=["Coulomb", "Stribeck"])
def test_joints_that_stick_are_moved_to_the_goal_and_do_not_hunt(static):
    """The proposal keeps the goal within a thousandth of the reach, for three times the run.

    The same loop without its integral does not, which shows that the friction matters.
    """
    arm = one_link(friction=fa.Friction(coulomb=0.1, static=static))
    options = {"sensors": "joints", "computing": "low", "progress": False}
    found = fa.design(arm, "point_to_point", payload_uncertainty=1.0, **options)
    assert found.chosen == "joint PID"
    assert found.refusal == ""
    assert "dry friction" in " ".join(found.reasons)
    run = found.scenario.run
    plant = fa.varied(arm, payload_factor=2.0)
    loops = found.scenario.drive, found.scenario.drive.replace(integral=[0.0])
    goal = 0.8 * np.array([np.cos(0.5), np.sin(0.5)])
    for drive, near in zip(loops, (True, False), strict=True):
        longer = run.replace(duration=3.0 * run.duration)
        scenario = found.scenario.replace(drive=drive, run=longer)
        result = prepare(scenario).run(arm=plant, progress=False)
        tip = result.tip.values[result.time.values > run.duration, :2]
        error = np.hypot(*(tip - goal).T).max()
        assert bool(error < 1e-3 * arm.reach) is near, error


@pytest.mark.thorough
def test_a_payload_that_is_not_expected_does_not_move_the_tip():
    """The sag of the payload is 20 mm; the goal is 1 mm per metre of the reach."""
    arm = fa.Arm(one_link().spec.replace(gravity=(0.0, -9.81)))
    sag = [fa.equilibrium(fa.varied(arm, payload_factor=k), [0.0]) for k in (0.0, 2.0)]
    low, high = [arm.tip(item.q)[1] for item in sag]
    assert low - high == pytest.approx(2 * 0.1 * 9.81 * 0.8**3 / (3.0 * 20.0), rel=1e-2)
    found = fa.design(arm, "point_to_point", payload_uncertainty=1.0, progress=False)
    assert found.refusal == ""
    settled = found.table.tip_error_settled.sel(candidate=found.chosen)
    assert settled.max() < 1e-3 * arm.reach
    assert found.table.growth.sel(candidate=found.chosen) < 0.0
