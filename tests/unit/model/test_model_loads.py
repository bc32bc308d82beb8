"""Loads on the arm of a scenario, prescribed joints, and the start."""

import inspect

import numpy as np
import pytest

import flexarm as fa
from flexarm.base.errors import ModelError
from flexarm.model import (
    AccelerationTable,
    ArmSpec,
    FactorTable,
    HeldJoint,
    Link,
    Load,
    Scenario,
    file_text,
    json_schema,
    load_scenario,
)

LINK = Link(length=1, flexural_rigidity=1, mass_per_length=1)
ARM = ArmSpec(links=[LINK, LINK.replace(length=2)])
RUN = {"duration": 2}
JOINT = {"kind": "joint", "start": [0, 0], "end": [1, 1], "duration": 1}
PD = {"kind": "joint_pd", "proportional": 1, "derivative": 1}
TABLE = {"kind": "table", "joint": 1, "times": [0, 2], "angles": [0, 1]}


def scenario(**values):
    return Scenario(**{"arm": ARM, "run": RUN, **values})


def test_defaults():
    plain = scenario()
    assert (plain.loads, plain.prescribed, plain.base_acceleration) == ((), (), None)
    assert (plain.initial.equilibrium, plain.initial.balance) == (False, False)
    load = scenario(loads=[{"link": 1, "moment": 2}]).loads[0]
    assert load == Load(link=1, moment=2.0, frame="world")


def test_arrays_are_accepted():
    found = scenario(
        loads=[
            Load(link=2, force=np.ones(2), factor={"times": np.arange(3), "values": np.zeros(3)})
        ],
        base_acceleration=np.array([0.0, 9.81]),
        prescribed=[HeldJoint(joint=2)],
    )
    assert found.loads[0].factor.times == (0.0, 1.0, 2.0)
    assert found.base_acceleration == (0.0, 9.81)
    table = AccelerationTable(times=[0, 1], values=np.zeros((2, 2)))
    assert scenario(base_acceleration=table).base_acceleration is table


def test_station_at_the_tip_may_be_rounded():
    (load,) = scenario(loads=[{"link": 2, "moment": 1, "station": 2.0 * (1 + 1e-12)}]).loads
    assert load.station == pytest.approx(2.0, rel=1e-11)


def test_pair_of_numbers_is_not_a_table():
    """A table is a pair of lists; NumPy's arrays count as lists."""
    table = Load(link=1, moment=1.0, factor=(np.arange(2.0), np.ones(2))).factor
    assert (table.times, table.values) == ((0.0, 1.0), (1.0, 1.0))
    with pytest.raises(
        ModelError, match=r"factor must be a function of time or a table .*\(1, 2\)"
    ):
        Load(link=1, moment=1.0, factor=(1.0, 2.0))


def test_tables_may_have_jumps_and_constant_parts():
    found = scenario(
        loads=[{"link": 1, "moment": 1, "factor": {"times": [0, 1, 1], "values": [0, 1, 2]}}],
        base_acceleration={"times": [3], "values": [[0, 1]]},
    )
    assert found.loads[0].factor.times == (0.0, 1.0, 1.0)
    assert found.base_acceleration.times == (3.0,)


def test_fixed_joints_have_no_values():
    third = ArmSpec(links=[LINK] * 3, joints=[{}, {"fixed": True}, {}])
    found = Scenario(
        arm=third,
        run=RUN,
        motion=JOINT,
        prescribed=[HeldJoint(joint=3)],
        initial={"joint_angle": [0, 1]},
        loads=[{"link": 3, "moment": 1}],
    )
    assert found.prescribed[0].joint == 3
    with pytest.raises(ModelError) as caught:
        found.replace(prescribed=[HeldJoint(joint=2)], initial={"joint_angle": [0, 1, 2]})
    reported = [problem.removeprefix("Scenario: ") for problem in str(caught.value).splitlines()]
    assert reported == [
        "initial.joint_angle must have length 2, one value for each joint, got 3.",
        ("prescribed[0].joint must be the number of a joint that is not fixed (1, 3), got 2."),
    ]


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        ({"base_acceleration": 9.81}, ["base_acceleration must be a list of two numbers, got"]),
        ({"base_acceleration": [1, 2, 3]}, ["base_acceleration must be a list of two numbers"]),
        (
            {"base_acceleration": {"times": [0, 1], "values": [0, 1]}},
            [
                "base_acceleration.values[0] must be a list of two numbers, got 0.",
                "base_acceleration.values[1] must be a list of two numbers, got 1.",
            ],
        ),
        (
            {"base_acceleration": {"times": [0, 1], "value": [[0, 1], [0, 1]]}},
            [
                "base_acceleration.values is missing.",
                ("base_acceleration.value is not a known key. Did you mean 'values'?"),
            ],
        ),
        (
            {"prescribed": [{"joint": 1}]},
            ["prescribed[0].kind is missing."],
        ),
        (
            {"prescribed": [{"joint": 1, "kind": "held"}]},
            ["prescribed[0].kind must be one of 'hold', 'motion', 'table', got 'held'."],
        ),
        (
            {"prescribed": [{"joint": 3, "kind": "hold"}, {"joint": 3, "kind": "hold"}]},
            [
                (
                    "prescribed[0].joint must be the number of a joint that is not fixed (1, "
                    "2), got 3."
                ),
                (
                    "prescribed[1].joint must be the number of a joint that is not fixed (1, "
                    "2), got 3."
                ),
                "prescribed[1].joint repeats joint 3, which is in prescribed[0].",
            ],
        ),
        (
            {"prescribed": [{"joint": 1, "kind": "motion"}]},
            ["motion is required for prescribed[0]."],
        ),
        (
            {"prescribed": [{"joint": 1, "kind": "hold"}], "motion": JOINT, "drive": PD},
            ["prescribed cannot be combined with drive joint_pd."],
        ),
        (
            {"prescribed": [{**TABLE, "times": [0]}]},
            ["prescribed[0].times must have at least two values, got 1."],
        ),
        (
            {"prescribed": [{**TABLE, "times": [0, 1, 2]}]},
            ["prescribed[0].angles must have length 3, one value for each time, got 2."],
        ),
        (
            {"prescribed": [{**TABLE, "times": [2, 2]}]},
            ["prescribed[0].times[1] must be greater than 2 (the previous time), got 2."],
        ),
        (
            {"prescribed": [{**TABLE, "ends": "free", "times": [0, 1.5]}]},
            [
                (
                    "prescribed[0].times must cover the run from 0 to 2 with 'ends: free', got 0 "
                    "to 1.5. With 'ends: rest' the joint is at rest before and after the table."
                )
            ],
        ),
        (
            {"events": [{"kind": "joint_angle", "joint": 1}]},
            ["events[0].angle is required if there is no stop."],
        ),
        (
            {"events": [{"kind": "joint_angle", "joint": 1, "angle": 0.5, "stop": "upper"}]},
            ["events[0].angle cannot be combined with stop."],
        ),
        (
            {"events": [{"kind": "joint_angle", "joint": 2, "stop": "upper"}]},
            ["events[0].stop is not supported: joint 2 has no limits."],
        ),
        (
            {"events": [{"kind": "joint_angle", "joint": 3, "stop": "upper", "terminal": 1}]},
            ["events[0].terminal must be true or false, got 1."],
        ),
        (
            {"events": [{"kind": "joint_angle", "joint": 3, "stop": "upper"}]},
            [("events[0].joint must be the number of a joint that is not fixed (1, 2), got 3.")],
        ),
        (
            {"events": [{"kind": "tip_line", "point": [1], "normal": [0, 0], "direction": "up"}]},
            [
                "events[0].direction must be one of 'both', 'rising', 'falling', got 'up'.",
                "events[0].point must be a list of two numbers, got [1].",
                "events[0].normal must have a length greater than 0, got [0, 0].",
            ],
        ),
        (
            {
                "events": [
                    {"kind": "joint_angle", "joint": 1, "angle": 1, "name": "event_2"},
                    {"kind": "joint_angle", "joint": 1, "angle": 1, "name": "duration"},
                    {"kind": "tip_line", "point": [1, 2], "normal": [0, 1], "name": "event_2"},
                ]
            },
            [
                (
                    "events[1].name must not be 'duration' or 'failure' (other ends of a run), got "
                    "'duration'."
                )
            ],
        ),
        (
            {
                "events": [
                    {"kind": "joint_angle", "joint": 1, "angle": 1, "name": "event_2"},
                    {"kind": "joint_angle", "joint": 1, "angle": 1},
                ]
            },
            ["events[1].name repeats 'event_2', the name of events[0]."],
        ),
        (
            {"initial": {"equilibrium": True, "joint_rate": [0, 1]}},
            ["initial.joint_rate cannot be combined with equilibrium."],
        ),
        (
            {"initial": {"balance": True}},
            ["initial.equilibrium must be true with balance."],
        ),
        (
            {"initial": {"equilibrium": "yes"}},
            ["initial.equilibrium must be true or false, got 'yes'."],
        ),
    ],
)
def test_wrong_scenarios_are_rejected_with_every_reason(values, problems):
    with pytest.raises(ModelError) as caught:
        scenario(**values)
    reported = str(caught.value).splitlines()
    assert len(reported) == len(problems), reported
    for line, text in zip(reported, problems, strict=True):
        assert line.startswith(f"Scenario: {text}")


def test_factor_that_a_file_cannot_express_is_rejected_in_a_scenario():
    """Python accepts a function or a pair of lists as a factor; files have a table only."""
    load = Load(1, (0.0, 1.0), factor=([0.0, 1.0], [0.0, 2.0]))
    assert load.factor == FactorTable(times=[0.0, 1.0], values=[0.0, 2.0])
    assert scenario(loads=[load]).loads == (load,)
    with pytest.raises(ModelError, match=r"Scenario: loads\[0\]\.factor must be a table"):
        scenario(loads=[load.replace(factor=np.sin)])
    schema = json_schema()["$defs"]["Load"]["properties"]["factor"]
    assert "FactorTable" in str(schema)
    assert "callable" not in str(schema).lower()


def test_load_without_a_force_or_moment_is_rejected_but_zero_is_kept(tmp_path):
    with pytest.raises(ModelError, match="Load: force is required if there is no moment"):
        Load(1)
    still = scenario(loads=[Load(1, (0.0, 0.0)), Load(1, moment=0.0)])
    (tmp_path / "still.yaml").write_text(file_text(still), encoding="utf-8")
    assert load_scenario(tmp_path / "still.yaml") == still


def test_records_of_users_accept_their_first_values_by_position():
    wall = fa.Wall((0.0, 1.0), (0.0, -1.0))
    assert fa.Contact(wall, 1e3, 1) == fa.Contact(surface=wall, stiffness=1e3, link=1)
    with pytest.raises(TypeError, match="at most 2 values by position"):
        fa.Wall((0.0, 1.0), (0.0, -1.0), "wall")
    with pytest.raises(TypeError, match="multiple values for argument 'point'"):
        fa.Wall((0.0, 1.0), point=(0.0, 1.0))
    assert list(inspect.signature(fa.Wall).parameters) == ["point", "normal", "kind"]
