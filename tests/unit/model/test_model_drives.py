"""Drives with controllers, and pressing motions: valid and invalid values in files."""

import pytest

from flexarm.base.errors import ModelError
from flexarm.model import ArmSpec, Link, Scenario
from flexarm.model.drives import balances

LINK = Link(length=1, flexural_rigidity=1, mass_per_length=1)
ARM = ArmSpec(links=[LINK, LINK])
LINE = {"kind": "line", "start": [1.5, 0], "end": [1.5, 1], "duration": 1}
PD = {"kind": "joint_pd", "proportional": 1, "derivative": 1}
PRESSED = {"kind": "pressed", "path": LINE, "force": 2.0}
WALL = {"surface": {"kind": "wall", "point": [1.5, 0], "normal": [-1, 0]}, "stiffness": 1e3}
TABLE = {"kind": "table", "x": [1.5, 1.5, 1.5], "y": [0, 1, 2]}


def scenario(**parts):
    return Scenario(**{"arm": ARM, "run": {"duration": 1}, "motion": LINE, "drive": PD, **parts})


def problems(**parts):
    with pytest.raises(ModelError) as caught:
        scenario(**parts)
    return [str(problem).removeprefix("Scenario: ") for problem in caught.value.problems]


ONE_EACH = "must have length 2, one value for each joint, got 3."


@pytest.mark.parametrize(
    ("drive", "reported"),
    [
        ({"kind": "lqg", "posture": [0, 0, 0]}, [f"drive.posture {ONE_EACH}"]),
        ({"kind": "lqg", "schedule": [None, None, [0]]}, [f"drive.schedule {ONE_EACH}"]),
        ({"kind": "mpc"}, ["drive.torque_limit is missing."]),
        (
            {"kind": "mpc", "torque_limit": 1, "horizon": 2.5},
            ["drive.horizon must be a whole number, got 2.5."],
        ),
        (
            {"kind": "lqg", "mesured": {"tip": 1}},
            ["drive.mesured is not a known key. Did you mean 'measured'?"],
        ),
        (
            {"kind": "lqg", "measured": {"tip": 0}, "integral": 3},
            [
                "drive.measured.tip must be greater than 0, got 0.",
                "drive.integral must be true or false, got 3.",
            ],
        ),
        (
            {"kind": "lqg", "acceptable": {}},
            ["drive.acceptable must be a mapping with at least one name, got {}."],
        ),
        (
            {"kind": "sliding_mode", "bandwidth": [1, 2, 3], "boundary_layer": -1},
            [
                "drive.boundary_layer must be greater than 0, got -1.",
                f"drive.bandwidth {ONE_EACH}",
            ],
        ),
        (
            {"kind": "disturbance_observer", "inner": {**PD, "proportional": [1, 2, 3]}},
            [f"drive.inner.proportional {ONE_EACH}"],
        ),
        (
            {"kind": "disturbance_observer", "compensation": 2, "inner": {"kind": "joint_pdd"}},
            [
                "drive.inner.kind must be one of",
                "drive.compensation must be at most 1, got 2.",
            ],
        ),
        (
            {"kind": "estimator", "inner": PD, "estimator": {"torque_noice": 1}},
            [("drive.estimator.torque_noice is not a known key. Did you mean 'torque_noise'?")],
        ),
        (  # one observer is the maximum
            {"kind": "disturbance_observer", "inner": {"kind": "disturbance_observer"}},
            ["drive.inner.kind must be one of"],
        ),
    ],
)
def test_wrong_controllers_are_rejected_with_every_reason(drive, reported):
    found = problems(drive=drive)
    assert len(found) == len(reported)
    for text, start in zip(found, reported, strict=True):
        assert text.startswith(start)


@pytest.mark.parametrize(
    ("drive", "expected"),
    [
        (PD, False),
        ({"kind": "lqg"}, True),
        ({"kind": "disturbance_observer", "inner": PD}, False),
        ({"kind": "estimator", "inner": {"kind": "hybrid_force"}}, True),
        ({**PD, "kind": "joint_pid", "gravity": "rigid"}, True),
        ({**PD, "kind": "joint_pid"}, False),
    ],
)
def test_drives_state_whether_they_balance_the_weight(drive, expected):
    assert balances(scenario(drive=drive).drive) == expected
    start = {"equilibrium": True, "balance": True}
    if expected:
        rule = "initial.balance cannot be combined with a drive that compensates gravity"
        assert problems(drive=drive, initial=start)[0].startswith(rule)
    else:
        scenario(drive=drive, initial=start)


@pytest.mark.parametrize(
    ("parts", "reported"),
    [
        (
            {"motion": PRESSED},
            ("motion.normal is required if there are no contacts."),
        ),
        (
            {"motion": PRESSED, "contacts": [{**WALL, "surface": TABLE}]},
            "motion.normal is required",
        ),
        (
            {"motion": {**PRESSED, "normal": [0, 0]}},
            "motion.normal must have a length greater than 0, got [0, 0].",
        ),
        (
            {"motion": {**PRESSED, "force": -1}, "contacts": [WALL]},
            "motion.force must be at least 0, got -1.",
        ),
        (
            {
                "motion": {**PRESSED, "force": {"times": [0, 1, 1], "values": [0, 1, 1]}},
                "contacts": [WALL],
            },
            "motion.force.times[2] must be greater than 1 (the previous time), got 1.",
        ),
        (
            {
                "motion": {**PRESSED, "force": {"times": [0, 1], "values": [0, 1, 1]}},
                "contacts": [WALL],
            },
            "motion.force.values must have length 2, one value for each time, got 3.",
        ),
        (
            {"motion": {**PRESSED, "path": {**LINE, "kind": "joint", "start": [0, 0, 0]}}},
            f"motion.path.start {ONE_EACH}",
        ),
        (
            {
                "motion": PRESSED,
                "contacts": [WALL],
                "drive": {**PD, "feedforward": "rigid_inverse_dynamics"},
            },
            "drive.feedforward rigid_inverse_dynamics is not supported",
        ),
        (
            {
                "motion": PRESSED,
                "contacts": [WALL],
                "drive": {
                    "kind": "disturbance_observer",
                    "inner": {**PD, "feedforward": "rigid_inverse_dynamics"},
                },
            },
            "drive.inner.feedforward rigid_inverse_dynamics is not supported",
        ),
        (
            {
                "motion": PRESSED,
                "contacts": [WALL],
                "drive": {"kind": "rigid_inverse_dynamics"},
            },
            "drive.kind rigid_inverse_dynamics is not supported",
        ),
        (
            {
                "motion": PRESSED,
                "contacts": [WALL],
                "drive": {"kind": "none"},
                "prescribed": [{"joint": 1, "kind": "motion"}],
            },
            "prescribed[0].kind motion is not supported with a pressed motion.",
        ),
        (
            {"motion": {**LINE, "shaping": {"method": "zvddd"}}},
            "motion.shaping.method must be one of 'zv', 'zvd', 'zvdd', 'ei', 'si', got 'zvddd'.",
        ),
        (
            {"motion": {**LINE, "shaping": {"frequency_hz": []}}},
            "motion.shaping.frequency_hz is empty.",
        ),
        (
            {"motion": {**LINE, "shaping": {"frequency_hz": 1, "modes": 2}}},
            "motion.shaping.modes cannot be combined with frequency_hz.",
        ),
        (
            {"motion": {**LINE, "smoothing": {"duration": 0}}},
            "motion.smoothing.duration must be greater than 0, got 0.",
        ),
        (
            {"hardware": {"instruments": [{"signal": "contact_force"}]}},
            ("hardware.instruments[0].signal is contact_force, but there are no contacts."),
        ),
    ],
)
def test_wrong_motions_are_rejected(parts, reported):
    assert any(text.startswith(reported) for text in problems(**parts))


def test_pressing_motion_requires_only_a_wall():
    made = scenario(motion=PRESSED, contacts=[WALL], drive={"kind": "hybrid_force"})
    assert made.motion.friction == 0.0
    assert made.drive.frequency is None, "the controller derives it from its arm"


def test_mappings_of_numbers_cannot_be_changed():
    made = scenario(drive={"kind": "lqg", "measured": {"tip": 1.0}})
    same = scenario(drive={"kind": "lqg", "measured": {"tip": 1.0}})
    assert hash(made) == hash(same)
    measured = made.drive.measured
    for change in (
        lambda: measured.update(tip=2.0),
        lambda: measured.pop("tip"),
        lambda: measured.__setitem__("tip", 2.0),
    ):
        with pytest.raises(TypeError, match="this mapping cannot be changed"):
            change()
    assert measured == {"tip": 1.0}
