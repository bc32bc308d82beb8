"""Rules of branches, sliding joints, bases and closures, and what an arm is."""

import copy
import math
import re

import pytest

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.model import ArmSpec, json_schema, load_arm_spec, save_arm_spec
from flexarm.model.arm.spec import serial_only, varied_spec
from flexarm.model.paths import number_at, number_paths, unit_at, with_number
from flexarm.model.plausible import implausible

LINK = {"length": 1.0, "flexural_rigidity": 10.0, "mass_per_length": 1.0}
RIGID = {"length": 1.0, "mass_per_length": 1.0, "flexible": False}
LEVER = {"length": 1.0, "mass_per_length": 0.0, "flexible": False}
POINT = {"mass": 1.0}
SLIDE = {"kind": "prismatic"}
AT_ROOT = {**LEVER, "parent_station": 0.0}
TURNED_BACK = [math.cos(0.3), -math.sin(0.3)]
#: A cart on springs that carries two arms, one of them divided by a crane on a slide, in a loop.
MECHANISM = {
    "base": {
        "mass": 3.0,
        "inertia": 0.2,
        "centre": [0.1, 0.0],
        "free": ["x", "angle"],
        "stiffness": [1e3, 0.0, 20.0],
        "damping": [5.0, 0.0, 0.0],
    },
    "links": [
        LINK,
        {**LINK, "parent": 1, "parent_station": 0.25},
        {**RIGID, "parent": 0},
        {**LINK, "parent": 1},
    ],
    "joints": [
        {"offset": [0.1, 0.2], "mounting_angle": 0.5},
        {"kind": "prismatic", "axis": [0.0, 2.0], "stiffness": 100.0},
        {},
        {"mass": 0.5},
    ],
    "closures": [
        {"link": 4, "to_link": 3, "offset": [0.0, 0.01]},
        {"kind": "line", "link": 2, "station": 0.5, "to_offset": [1.0, 0.0], "angle": 0.3},
    ],
}


#: Values that no field, or only some fields of a mechanism accept.
WRONG = (
    *(None, "", "no", "5 mm", True, math.nan, math.inf, -1, 0.0, 2, 256, 1.7e308, 5e-324),
    *([], [1.0], [1.7e308, 1.7e308], ["x"], {}, {"link": 1}, LINK, object()),
)


def stuck(place):
    """Return joints of which the second is a slide, fixed at a place (m)."""
    return [{}, {**SLIDE, "fixed": True, "rest_angle": place}, {}]


def problems_of(**fields):
    with pytest.raises(fa.ModelError) as error:
        ArmSpec(**fields)
    return [line.removeprefix("Arm: ") for line in str(error.value).splitlines()]


def only_problem_of(**fields):
    (problem,) = problems_of(**fields)
    return problem


def test_links_form_a_tree():
    spec = ArmSpec(links=[LINK, LINK, {**LINK, "parent": 0}, {**LINK, "parent": 1}, LINK])
    assert spec.parents == (-1, 0, -1, 0, 3)


@pytest.mark.parametrize(
    ("links", "problem"),
    [
        ([{**LINK, "parent": 1}], "links[0].parent must be 0 (the base), got 1."),
        (
            [LINK, {**LINK, "parent": 2}],
            "links[1].parent must be 0 (the base) to 1 (the link before), got 2.",
        ),
        ([LINK, {**LINK, "parent": -1}], "links[1].parent must be at least 0, got -1."),
        ([LINK, {**LINK, "parent": "1"}], "links[1].parent must be a whole number, got '1'."),
        ([LINK, {**LINK, "parent": True}], "links[1].parent must be a whole number, got True."),
        (
            [LINK, {**LINK, "parent_station": 1.5}],
            "links[1].parent_station must be at most 1 (the length of the link), got 1.5.",
        ),
        (
            [LINK, {**LINK, "parent_station": -0.5}],
            "links[1].parent_station must be at least 0, got -0.5.",
        ),
    ],
)
def test_wrong_parents_are_refused(links, problem):
    assert only_problem_of(links=links) == problem


@pytest.mark.parametrize(
    "links", [[{**LINK, "parent_station": 0.5}], [LINK, {**LINK, "parent": 0}]]
)
def test_base_has_no_stations(links):
    links[-1] = {**links[-1], "parent_station": 0.5}
    problem = f"links[{len(links) - 1}].parent_station requires a link as parent. "
    assert only_problem_of(links=links) == problem + "Give the offset of the joint on the base."


@pytest.mark.parametrize("station", [0.0, 0.5, 1.0, 0.1 + 0.2 + 0.7])
def test_segments_end_where_a_flexible_link_carries_a_joint(station):
    parent = {**LINK, "segments": 2}
    assert ArmSpec(links=[parent, {**LINK, "parent_station": station}])
    inside = only_problem_of(links=[parent, {**LINK, "parent_station": 0.4}])
    rule = "links[1].parent_station must be a multiple of 0.5 (the length of a segment), got 0.4."
    assert inside.startswith(rule)
    for other in ({**parent, "segments": 1}, {**RIGID, "segments": 2}):
        assert ArmSpec(links=[other, {**LINK, "parent_station": 0.4}])


@pytest.mark.parametrize(
    "damping",
    [{"kind": "modal", "ratio": 0.01}, {"kind": "rayleigh", "mass_coefficient": 0.1}],
)
def test_damping_of_a_divided_link_is_that_of_its_material(damping):
    def links(damping, station, **other):
        return [{**LINK, "damping": damping, **other}, {**LINK, "parent_station": station}]

    problem = only_problem_of(links=links(damping, 0.5))
    assert problem.startswith(
        "links[0].damping must be rayleigh without mass_coefficient on a link"
    )
    assert "Link 2 divides the link." in problem
    assert ArmSpec(links=links({"kind": "rayleigh", "stiffness_coefficient": 0.1}, 0.5))
    assert ArmSpec(links=links(damping, 1.0))
    assert ArmSpec(links=links(damping, 0.0))
    assert ArmSpec(links=links(damping, 0.5, flexible=False))


def test_only_sliding_joints_have_an_axis():
    assert fa.Joint().axis is None
    assert fa.Joint(kind="prismatic").axis == (1.0, 0.0)
    assert fa.Joint(kind="prismatic", axis=(0, -3)).axis == (0.0, -3.0)
    with pytest.raises(fa.ModelError, match=re.escape("axis requires kind prismatic.")):
        fa.Joint(axis=(0.0, 1.0))
    with pytest.raises(fa.ModelError, match="axis must have a length greater than 0"):
        fa.Joint(kind="prismatic", axis=(0.0, 0.0))
    with pytest.raises(fa.ModelError, match="Did you mean 'prismatic'"):
        fa.Joint(kind="prismatik")


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_every_joint_has_a_place(kind):
    for fixed in (False, True):
        joint = fa.Joint(kind=kind, fixed=fixed, offset=(0.1, -0.2), mounting_angle=1.0)
        assert (joint.offset, joint.mounting_angle) == ((0.1, -0.2), 1.0)


def test_numbers_of_sliding_joints_have_their_units():
    joint = fa.Joint(
        kind="prismatic",
        offset=("1 cm", 0),
        mounting_angle="180 deg",
        rest_angle="5 mm",
        stiffness="5 N/mm",
        damping="1 kN s/m",
        friction={"coulomb": "2 kN", "stribeck_rate": "1 cm/s", "viscous": "3 N s/m"},
        limits={"lower": "-1 cm", "upper": "1 cm", "stiffness": "1 N/mm", "damping": "2 s/m"},
        winding={"torque_constant": "50 mN m/A", "resistance": "1 ohm"},
        gear_ratio="6 rad/mm",
    )
    assert joint.offset == (0.01, 0.0)
    assert joint.mounting_angle == pytest.approx(3.14159265, rel=1e-8)
    assert (joint.rest_angle, joint.stiffness, joint.damping) == (0.005, 5000.0, 1000.0)
    assert (joint.friction.coulomb, joint.friction.viscous) == (2000.0, 3.0)
    assert joint.friction.stribeck_rate == 0.01
    assert (joint.limits.lower, joint.limits.stiffness, joint.limits.damping) == (-0.01, 1e3, 2.0)
    assert (joint.winding.torque_constant, joint.gear_ratio) == (0.05, 6000.0)


def test_units_of_the_other_kind_of_joint_are_refused():
    turning = {"stiffness": "5 N m/rad", "friction": {"coulomb": "1 N m"}, "rest_angle": "5 deg"}
    sliding = {"stiffness": "5 N/m", "friction": {"coulomb": "1 N"}, "rest_angle": "5 mm"}
    assert fa.Joint(**turning).friction.coulomb == 1.0
    assert fa.Joint(**SLIDE, **sliding).friction.coulomb == 1.0
    for fields in ({**turning, **SLIDE}, sliding):
        with pytest.raises(fa.ModelError) as error:
            fa.Joint(**fields)
        names = [line.split()[1] for line in str(error.value).splitlines()]
        assert sorted(names) == ["friction.coulomb", "rest_angle", "stiffness"]
    with pytest.raises(fa.ModelError, match=r"limits.lower must be a length, got -1 deg"):
        fa.Joint(**SLIDE, limits={"lower": "-1 deg", "upper": 1, "stiffness": 1})


def test_numbers_of_the_base_have_the_units_of_its_coordinates():
    base = fa.Base(
        mass="2 t",
        free=["angle", "x"],
        stiffness=["5 N/mm", 0, "2 kN m/rad"],
        damping=["1 kN s/m", 0.0, 3.0],
    )
    assert (base.mass, base.free) == (2000.0, ("angle", "x"))
    assert (base.stiffness, base.damping) == ((5e3, 0.0, 2e3), (1e3, 0.0, 3.0))
    with pytest.raises(
        fa.ModelError, match=r"stiffness\[2\] must have a unit that converts to N m"
    ):
        fa.Base(free=["angle"], stiffness=[0, 0, "2 N/m"])


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"free": ["x", "x"]}, "free[1] is a duplicate of free[0]."),
        ({"free": "x"}, "free must be a list, got 'x'."),
        ({"free": ["z"]}, "free[0] must be one of 'x', 'y', 'angle', got 'z'."),
        ({"free": ["x"], "stiffness": [1, 2, 0]}, "stiffness[1] requires 'y' in free."),
        ({"damping": [0, 0, 1]}, "damping[2] requires 'angle' in free."),
        ({"stiffness": [1, 2]}, "stiffness must be a list of three numbers, got [1, 2]."),
        ({"stiffness": [0, 0, -1]}, "stiffness[2] must be at least 0, got -1."),
        ({"mass": -1}, "mass must be at least 0, got -1."),
        ({"inertia": -1}, "inertia must be at least 0, got -1."),
    ],
)
def test_wrong_bases_are_refused(fields, problem):
    with pytest.raises(fa.ModelError) as error:
        fa.Base(**fields)
    assert str(error.value) == f"Base: {problem}"


@pytest.mark.parametrize(
    ("fields", "coordinate"),
    [
        ({"base": {"free": ["angle"]}}, "angle"),
        ({"base": {"free": ["x", "y", "angle"]}}, "angle"),
        # A mass at the origin resists no rotation, and a joint there passes on no moment.
        ({"base": {"free": ["x", "y", "angle"], "mass": 1.0}}, "angle"),
        ({"base": {"free": ["y"]}, "links": [LEVER], "joints": [{"hub_inertia": 1}]}, "y"),
        # One rigid body has three coordinates, but four move it.
        ({"base": {"free": ["x", "y", "angle"]}, "joints": [{"offset": [0.1, 0]}]}, "x"),
        # A slide in the same direction as the base.
        ({"base": {"free": ["x"]}, "joints": [SLIDE]}, "x"),
        # A rotor turns with its link, and that of an elastic joint on its own.
        ({"base": {"free": ["angle"]}, "joints": [{"rotor_inertia": 1}]}, "angle"),
        (
            {
                "base": {"free": ["angle"]},
                "joints": [{"rotor_inertia": 1, "gear_ratio": 9, "stiffness": 1}],
            },
            "angle",
        ),
    ],
)
def test_base_coordinates_without_inertia_are_refused_by_name(fields, coordinate):
    problem = only_problem_of(**{"links": [LINK], **fields})
    assert problem.startswith(f"base.free has {coordinate!r}, which moves no inertia.")


@pytest.mark.parametrize(
    "fields",
    [
        {"base": {"free": ["x", "y"]}},
        {"base": {"free": ["x", "y", "angle"], "inertia": 1.0}},
        {"base": {"free": ["angle"], "mass": 1.0, "centre": [0.1, 0.0]}},
        {"base": {"free": ["angle"]}, "joints": [{"offset": [0.1, 0.0]}]},
        {"base": {"free": ["angle"]}, "joints": [{"housing_inertia": 1.0}]},
        {"base": {"free": ["x", "angle"]}, "joints": [{"fixed": True}]},
        {"base": {"free": ["angle"]}, "joints": [{"rotor_inertia": 1, "gear_ratio": 9}]},
        {"base": {"free": ["x"]}, "joints": [{**SLIDE, "axis": [0, 1]}]},
        {"base": {"free": ["x", "y"]}, "joints": [{**SLIDE, "mass": 1.0}]},
        {"base": {"free": ["x", "y"]}, "links": [LEVER], "joints": [{"mass": 1, "hub_inertia": 1}]},
    ],
)
def test_base_coordinates_with_inertia_are_accepted(fields):
    spec = ArmSpec(**{"links": [LINK], **fields})
    assert spec.base.free == tuple(fields["base"]["free"])


@pytest.mark.parametrize(
    ("fields", "start"),
    [
        ({"links": [LEVER], "joints": [SLIDE]}, "links[0] slides, but carries no mass."),
        (
            {"links": [LEVER], "joints": [{**SLIDE, "hub_inertia": 1}], "payload": {"inertia": 1}},
            "links[0] slides, but carries no mass.",
        ),
        (
            {"links": [LEVER] * 2, "joints": [SLIDE] * 2, "payload": POINT},
            "links[0] has no inertia of its own: the joints further out move all that it carries.",
        ),
        (
            {"links": [LEVER] * 3, "payload": POINT},
            "links[0] has no inertia of its own: the joints further out move all that it carries.",
        ),
        (  # the mass of the branch does not move with the second link
            {"links": [LEVER, LEVER, {**LINK, "parent": 1}]},
            "links[1] has no inertia and carries no mass.",
        ),
        (  # at the axis of its parent, a mass on a joint resists no rotation
            {"links": [LEVER, {**LINK, "parent_station": 0.0}]},
            "links[0] has no inertia of its own",
        ),
        (
            {"links": [LEVER, AT_ROOT, {**LINK, "parent_station": 0.0}], "joints": stuck(0.0)},
            "links[0] has no inertia of its own",
        ),
        (  # both slide in the same direction, because the first link is mounted at an angle
            {
                "links": [LEVER] * 2,
                "joints": [{**SLIDE, "mounting_angle": 0.3}, {**SLIDE, "axis": TURNED_BACK}],
                "payload": POINT,
            },
            "links[0] has no inertia of its own",
        ),
    ],
)
def test_joints_without_inertia_are_refused(fields, start):
    assert only_problem_of(**fields).startswith(start)


@pytest.mark.parametrize(
    "fields",
    [
        {"links": [LEVER], "joints": [SLIDE], "payload": POINT},
        {"links": [LEVER], "joints": [{**SLIDE, "rotor_inertia": 1, "gear_ratio": 100}]},
        {
            "links": [LEVER, {**LEVER, "hub_radius": 0.1}],
            "joints": [SLIDE, {**SLIDE, "axis": [1, 1]}],
            "payload": POINT,
        },
        {"links": [LEVER, LEVER], "joints": [SLIDE, {}], "payload": POINT},
        {
            "links": [LEVER, LEVER],
            "joints": [SLIDE, {**SLIDE, "mounting_angle": 0.3, "axis": [0, 1]}],
            "payload": POINT,
        },
        {"links": [LEVER, {**LINK, "parent": 1}, {**LINK, "parent": 1}]},
        {"links": [LEVER, {**LINK, "parent_station": 0.3}]},
        {"links": [{**LEVER, "hub_radius": 0.1}, {**LINK, "parent_station": 0.0}]},
        {"links": [LEVER, {**LINK, "parent_station": 0.0}], "joints": [{}, {"offset": [0, 0.1]}]},
        {
            "links": [LEVER, {**LINK, "parent_station": 0.0}],
            "joints": [{}, {**SLIDE, "fixed": True, "rest_angle": 0.2}],
        },
        {"links": [LEVER, AT_ROOT, {**LINK, "parent_station": 0.0}], "joints": stuck(0.2)},
    ],
)
def test_joints_with_inertia_are_accepted(fields):
    assert len(ArmSpec(**fields).links) == len(fields["links"])


@pytest.mark.parametrize(
    ("closures", "problem"),
    [
        ([{"link": 3}], "closures[0].link must be the number of a link, 1 to 2, got 3."),
        ([{"link": 0}], "closures[0].link must be at least 1, got 0."),
        ([{}], "closures[0].link is missing."),
        (
            [{"link": 1, "to_link": 3}],
            "closures[0].to_link must be the number of a link, 1 to 2, got 3.",
        ),
        (
            [{"link": 1, "to_link": 1}],
            "closures[0].to_link must differ from link, got 1.",
        ),
        (
            [{"link": 1, "station": 2}],
            "closures[0].station must be at most 1 (the length of the link), got 2.",
        ),
        (
            [{"link": 1, "to_link": 2, "to_station": 2}],
            "closures[0].to_station must be at most 1 (the length of the link), got 2.",
        ),
        (
            [{"link": 1, "to_station": 1}],
            "closures[0].to_station requires the number of a link as to_link.",
        ),
        (
            [{"link": 1, "to_link": 0, "to_station": 1}],
            "closures[0].to_station requires the number of a link as to_link.",
        ),
        ([{"link": 1, "angle": 0.1}], "closures[0].angle is not supported for a pin."),
        ([{"kind": "rope", "link": 1}], "closures[0].kind must be one of 'pin', 'weld', 'line'"),
        ([{"kind": "curve", "link": 1}], "closures[0].shape is required for the kind curve."),
        (
            [{"link": 1, "shape": {"kind": "round", "center": (0.0, 0.0), "radius": 1.0}}],
            "closures[0].shape requires the kind curve.",
        ),
        (
            [{"kind": "curve", "link": 1, "shape": {"kind": "round", "center": (0.0, 0.0)}}],
            "closures[0].shape.radius is missing.",
        ),
    ],
)
def test_wrong_closures_are_refused(closures, problem):
    assert only_problem_of(links=[LINK, LINK], closures=closures).startswith(problem)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"link": 2}, {"link": 2}),
        ({"link": 2}, {"link": 2, "to_link": 0}),  # a fixed base is the ground
        ({"link": 2}, {"link": 2, "station": 1.0}),
        ({"link": 1, "to_link": 2}, {"link": 2, "to_link": 1}),
        ({"link": 1, "to_link": 2}, {"kind": "weld", "link": 1, "to_link": 2, "angle": 1.0}),
        ({"link": 1, "to_link": 2}, {"kind": "line", "link": 1, "to_link": 2, "angle": 1.0}),
        ({"kind": "line", "link": 2}, {"kind": "line", "link": 2}),
    ],
)
def test_closures_of_the_same_points_are_refused(first, second):
    problem = only_problem_of(links=[LINK, LINK], closures=[first, second])
    assert problem.startswith("closures[1] has the points of closures[0].")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"link": 2}, {"link": 1}),
        ({"link": 2}, {"link": 2, "station": 0.5}),
        ({"link": 2}, {"link": 2, "offset": [0.0, 0.1]}),
        ({"link": 2}, {"link": 2, "to_link": 1}),
        ({"kind": "line", "link": 2}, {"kind": "line", "link": 2, "angle": 1.0}),
        ({"kind": "line", "link": 1, "to_link": 2}, {"kind": "line", "link": 2, "to_link": 1}),
    ],
)
def test_other_closures_are_accepted(first, second):
    assert len(ArmSpec(links=[LINK, LINK], closures=[first, second]).closures) == 2


def test_closures_with_a_free_base_differ_from_those_with_the_ground():
    base = {"free": ["x"], "mass": 1.0}
    closures = [{"link": 1}, {"link": 1, "to_link": 0}]
    assert len(ArmSpec(links=[LINK], base=base, closures=closures).closures) == 2


def test_all_problems_of_a_mechanism_are_reported():
    problems = problems_of(
        links=[LINK, {**LINK, "parent": 5}, {**LINK, "parent_station": 3.0}],
        joints=[{"axis": [0, 1]}, {}, {}],
        base={"free": ["x", "x"]},
        closures=[{"link": 9}, {"link": 1, "angle": 1.0}],
    )
    assert [problem.split()[0] for problem in problems] == [
        "joints[0].axis", "base.free[1]", "closures[1].angle",
        "links[1].parent", "links[2].parent_station",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "feature"),
    [
        ({"links": [LINK, {**LINK, "parent": 0}]}, "branches"),
        ({"links": [LINK, {**LINK, "parent_station": 0.0}]}, "branches"),
        ({"joints": [SLIDE, {}]}, "sliding joints"),
        ({"joints": [{}, {"offset": [0, 1]}]}, "joints with an offset or a mounting angle"),
        ({"joints": [{"mounting_angle": 1}, {}]}, "joints with an offset or a mounting angle"),
        ({"base": {"free": ["x"], "mass": 1}}, "a free base"),
        ({"closures": [{"link": 2}]}, "closures"),
    ],
)
def test_features_of_a_mechanism_are_named(change, feature):
    spec = ArmSpec(**{"links": [LINK, LINK], **change})
    assert (spec.features, spec.is_serial) == ((feature,), False)
    with pytest.raises(InputError) as error:
        serial_only(spec, "export_urdf")
    assert str(error.value) == f"export_urdf is not supported for arms with {feature}."


def test_serial_arms_have_no_such_features():
    first = {**LINK, "parent": 0}
    for second in (LINK, {**LINK, "parent": 1}, {**LINK, "parent": 1, "parent_station": 1.0}):
        spec = ArmSpec(links=[first, second], joints=[{}, {"fixed": True}], base={"mass": 1.0})
        assert spec.is_serial
        assert spec.parents == (-1, 0)
        serial_only(spec, "export_urdf")


def test_all_features_are_in_one_sentence():
    with pytest.raises(InputError) as error:
        serial_only(ArmSpec(**MECHANISM), "accuracy")
    assert str(error.value) == (
        "accuracy is not supported for arms with branches, sliding joints, joints with an offset "
        "or a mounting angle, a free base and closures."
    )


def test_mechanism_is_written_to_a_file_and_read(tmp_path):
    spec = ArmSpec(**MECHANISM)
    save_arm_spec(spec, tmp_path / "arm.yaml")
    text = (tmp_path / "arm.yaml").read_text()
    assert load_arm_spec(tmp_path / "arm.yaml") == spec
    assert "free: [x, angle]" in text
    assert not re.search("revolute|kind: pin|mounting_angle: 0.0", text)


def test_defaults_of_mechanisms_are_not_written(tmp_path):
    serial = ArmSpec(
        links=[LINK],
        joints=[{"kind": "revolute", "offset": [0, 0], "mounting_angle": 0.0}],
        base={},
        closures=[],
    )
    save_arm_spec(serial, tmp_path / "arm.yaml")
    save_arm_spec(ArmSpec(links=[LINK], joints=[{}]), tmp_path / "before.yaml")
    text = (tmp_path / "arm.yaml").read_text()
    assert text == (tmp_path / "before.yaml").read_text()


def test_schema_describes_mechanisms():
    definitions = json_schema("arm")["$defs"]
    assert definitions["Base"]["properties"]["free"]["items"]["enum"] == ["x", "y", "angle"]
    assert definitions["Closure"]["required"] == ["link"]
    parent = definitions["Link"]["properties"]["parent"]["anyOf"][0]
    assert (parent["type"], parent["minimum"]) == ("integer", 0)
    three = definitions["Base"]["properties"]["stiffness"]
    assert (three["minItems"], three["maxItems"]) == (3, 3)


def test_numbers_of_a_mechanism_have_paths_and_units():
    spec = ArmSpec(**MECHANISM)
    paths = list(number_paths(spec))
    assert {"joints[1].axis[1]", "joints[0].offset[0]", "links[1].parent_station"} <= set(paths)
    assert {"base.stiffness[2]", "closures[1].to_offset[0]", "base.centre[0]"} <= set(paths)
    assert not any(path.startswith("joints[0].axis") for path in paths)
    assert number_at("path", with_number(spec, "base.mass", 4.0), "base.mass") == 4.0
    with pytest.raises(fa.ModelError, match=r"links\[1\].parent_station must be at most 1"):
        with_number(spec, "links[1].parent_station", 2.0)
    units = {
        "base.stiffness[0]": "N/m",
        "base.stiffness[2]": "N m/rad",
        "joints[0].stiffness": "N m/rad",
        "joints[1].stiffness": "N/m",
        "joints[1].mounting_angle": "rad",
        "joints[1].gear_ratio": "rad/m",
        "joints[1].rotor_inertia": "kg m^2",
        "joints[1].rest_angle": "m",
        "closures[1].angle": "rad",
        "payload.offset[1]": "m",
    }
    assert {path: unit_at(spec, path) for path in units} == units
    rubbing = ArmSpec(links=[RIGID], joints=[{**SLIDE, "friction": {"coulomb": 1.0}}])
    assert unit_at(rubbing, "joints[0].friction.coulomb") == "N"


def test_wrong_values_anywhere_are_accepted_or_refused_with_a_message():
    """Each number of a mechanism, and each of its entries, is replaced by each wrong value."""

    def places(value, path=()):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in items:
            yield (*path, key)
            if isinstance(item, dict | list):
                yield from places(item, (*path, key))

    messages, count = [], 0
    for path in places(MECHANISM):
        for wrong in WRONG:
            fields = copy.deepcopy(MECHANISM)
            inside = fields
            for key in path[:-1]:
                inside = inside[key]
            inside[path[-1]] = wrong
            count += 1
            try:
                implausible(ArmSpec(**fields))
            except fa.ModelError as error:
                messages.append(str(error))
    assert count > len(messages) > 0.5 * count
    assert all(message.startswith("Arm: ") for message in messages)


def test_variations_keep_the_mechanism():
    spec = ArmSpec(**MECHANISM)
    changed = varied_spec(spec, mass_factor=2.0, friction=fa.Friction(coulomb=0.1))
    for name in ("base", "closures", "parents"):
        assert getattr(changed, name) == getattr(spec, name)
    assert changed.links[1].mass_per_length == 2.0
    assert changed.links[1].parent_station == 0.25
    assert changed.joints[1].axis == (0.0, 2.0)
    assert changed.joints[1].friction == fa.Friction(coulomb=0.1)
