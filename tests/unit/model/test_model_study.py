"""Studies: their scenarios, and every problem once and at its place."""

import pytest

from flexarm.base.errors import ModelError
from flexarm.model import StudySpec
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.drives import CONTROLLED
from flexarm.model.scenarios.study import PlantSpec, StudyRun, plant_spec

LINK = {"length": 1.0, "flexural_rigidity": 10.0, "mass_per_length": 0.5, "elements": 1}
PD = {"kind": "joint_pd", "proportional": 4.0, "derivative": 1.0}
LINE = {"kind": "line", "start": [1.5, 0.5], "end": [1.0, 1.0], "duration": 1.0}
CONTENT = {
    "arm": {"links": [LINK, LINK], "payload": {"mass": 0.5, "inertia": 0.1}},
    "motions": {"line": LINE, "slow line": {**LINE, "duration": 2.0}},
    "drives": {"PD": PD, "torque alone": {"kind": "rigid_inverse_dynamics"}},
    "run": {"duration": 3.0, "rate": 200.0, "integrator": "rk4"},
}


def study(**changes):
    return StudySpec.model_validate({**CONTENT, **changes})


def problems_of(**changes):
    with pytest.raises(ModelError) as caught:
        StudySpec(**{**CONTENT, **changes})
    return [str(problem).removeprefix("StudySpec: ") for problem in caught.value.problems]


def test_each_scenario_has_its_drive_its_motion_and_the_common_parts():
    load = {"link": 1, "force": [0.0, -1.0]}
    found = study(loads=[load], hardware={"instruments": [{"signal": "joint_angle"}]})
    scenario = found.scenario("PD", "slow line")
    assert scenario.drive.kind == "joint_pd"
    assert scenario.motion.duration == 2.0
    assert scenario.loads == found.loads
    assert scenario.hardware == found.hardware
    assert (scenario.run.duration, scenario.run.rate, scenario.run.integrator) == (
        3.0,
        200.0,
        "rk4",
    )
    # Torques over time read no instruments.
    assert "rigid_inverse_dynamics" not in CONTROLLED
    assert found.scenario("torque alone", "line").hardware is None


def test_problem_of_many_scenarios_is_reported_once():
    found = problems_of(
        drives={"one": PD, "two": PD, "three gains": {**PD, "proportional": [1.0, 2.0, 3.0]}},
        loads=[{"link": 3, "force": [0.0, -1.0]}],
    )
    assert found == [
        "loads[0].link must be the number of a link, 1 to 2, got 3.",
        "drives.three gains.proportional must have length 2, one value for each joint, got 3.",
    ]


def test_settling_must_be_shorter_than_the_run():
    assert StudyRun(duration=2.0, settling=1.9).settling == 1.9
    for settling in (2.0, 3.0):
        with pytest.raises(ModelError, match=r"settling must be less than the duration of 2 s"):
            StudyRun(duration=2.0, settling=settling)


def test_plants_differ_in_all_their_factors_only():
    arm = ArmSpec.model_validate(CONTENT["arm"])
    plant = PlantSpec(payload_factor=2.0, flexural_rigidity_factor=[0.5, 1.0], mass_factor=3.0)
    found = plant_spec(arm, plant)
    assert (found.payload.mass, found.payload.inertia) == (1.0, 0.2)
    assert [link.flexural_rigidity for link in found.links] == [5.0, 10.0]
    assert [link.mass_per_length for link in found.links] == [1.5, 1.5]
    assert [link.length for link in found.links] == [1.0, 1.0]
    assert plant_spec(arm, PlantSpec()) == arm


def test_plants_that_do_not_match_the_arm_are_rejected():
    found = problems_of(
        plants={
            "three": {"mass_factor": [1.0, 2.0, 3.0]},
            "off": {"loads": [{"link": 3, "force": [1.0, 0.0]}]},
        }
    )
    assert len(found) == 2
    assert any("plants.three.mass_factor" in text and "3" in text for text in found)
    assert any("plants.off.loads[0].link" in text for text in found)
