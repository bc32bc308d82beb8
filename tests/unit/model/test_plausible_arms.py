"""Mistakes of unit and sign are noticed, and arms that exist are not."""

import copy
import importlib
import math
import pickle
import pkgutil
import re
import warnings
from pathlib import Path

import gallery.cases
import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cli.main import app
from flexarm.model import ArmSpec, load_arm_spec
from flexarm.model.identification import locate_identification
from flexarm.model.paths import number_at, number_paths, with_number, with_numbers
from flexarm.model.plausible import implausible, weights
from plausible_arms import plausible_spec

ROOT = Path(__file__).parents[3]
STRIP = {
    "length": 0.5,
    "material": fa.Material(density=2700, youngs_modulus=70e9),
    "section": fa.Rectangle(width=0.03, height=0.002),
}
#: A resonator of silicon, 0.1 mm long, and an instrument boom of carbon fibre, 15 m.
BEAM = {
    "length": 1e-4,
    "material": fa.Material(density=2330, youngs_modulus=169e9),
    "section": fa.Rectangle(width=20e-6, height=2e-6),
}
BOOM = {
    "length": 15.0,
    "material": fa.Material(density=1600, youngs_modulus=120e9),
    "section": fa.Tube(outer_diameter=0.12, thickness=2e-3),
}
#: An arm of two links, described by constants, with geared elastic joints.
REACH = {"length": 0.8, "flexural_rigidity": 900.0, "mass_per_length": 1.2}
GEARED = {"rotor_inertia": 5e-5, "gear_ratio": 100, "stiffness": 1.2e4, "hub_inertia": 0.02}


def strip(link=(), joint=(), payload=(), gravity=(0.0, -9.81)):
    return ArmSpec(
        links=[{**STRIP, **dict(link)}],
        joints=[{"hub_inertia": 1e-3, **dict(joint)}],
        payload={"mass": 0.1, **dict(payload)},
        gravity=gravity,
    )


def beam(link=(), payload=()):
    return ArmSpec(
        links=[{**BEAM, **dict(link)}],
        joints=[{"fixed": True}],
        payload={"mass": 0.0, **dict(payload)},
    )


def boom(link=(), joint=(), payload=(), gravity=(0.0, 0.0)):
    payload = {"mass": 30.0, "inertia": 4.0, "offset": (0.2, 0.0), **dict(payload)}
    return ArmSpec(
        links=[{**BOOM, **dict(link)}],
        joints=[{"hub_inertia": 50.0, **dict(joint)}],
        payload=payload,
        gravity=gravity,
    )


def reach(link=(), joint=(), payload=(), gravity=(0.0, -9.81), first=()):
    return ArmSpec(
        links=[{**REACH, **dict(first)}, {**REACH, **dict(link)}],
        joints=[{**GEARED, **dict(joint)}, {**GEARED, "mass": 2.0}],
        payload={"mass": 1.5, "inertia": 2e-3, **dict(payload)},
        gravity=gravity,
    )


def material(density, modulus):
    return {"material": {"density": density, "youngs_modulus": modulus}}


def rectangle(width, height):
    return {"section": {"kind": "rectangle", "width": width, "height": height}}


def constants(rigidity, mass):
    link = {"length": 0.5, "flexural_rigidity": rigidity, "mass_per_length": mass}
    return ArmSpec(links=[link], joints=[{"hub_inertia": 1e-3}])


def winding(constant, resistance):
    return {"winding": {"torque_constant": constant, "resistance": resistance}}


def stops(lower, upper, stiffness=100.0):
    return {"limits": {"lower": lower, "upper": upper, "stiffness": stiffness}}


#: A link alone.
ALONE = {"joint": {"hub_inertia": 0.0}, "payload": {"mass": 0.0}}
#: Each with the text that names the number and what was meant.
MISTAKES = [
    (strip(material(2700, 70)), r"youngs_modulus is 70 Pa.*7e\+10 Pa \(GPa\)"),
    (strip(material(2700, 7e4)), r"youngs_modulus is 7e\+04 Pa.*7e\+10 Pa \(MPa\)"),
    (strip(material(2.7, 70e9)), r"density is 2.7 kg/m\^3.*2700 kg/m\^3 \(g/cm\^3\)"),
    (strip(material(7.5e6, 1.2e9)), r"density is 7.5e\+06 kg/m\^3"),
    (strip({"length": 500}), r"length is 500 m.*mean 0.5 m \(mm\)"),
    (strip(rectangle(30, 2)), r"width is 30 m, 60 times the length.*mean 0.03 m \(mm\)"),
    (strip(rectangle(0.03, 2)), r"height is 2 m, 4 times the length.*mean 0.002 m \(mm\)"),
    (
        strip(
            {"length": 500, **material(2.7e-9, 70e3), **rectangle(30, 2)},
            {"hub_inertia": 1.0},
            {"mass": 1e-4},
            (0.0, -9810.0),
        ),
        r"gravity is 9810 m/s\^2.*density is 2.7e-09 kg/m\^3.*2700 kg/m\^3 \(t/mm\^3\)",
    ),
    (constants(1.4e6, 0.162), r"flexural_rigidity is 1.4e\+06 N m\^2.*1.4 N m\^2 \(N mm\^2\)"),
    (constants(1.4, 162), r"mass_per_length is 162 kg/m.*0.162 kg/m \(g/m\)"),
    (strip(payload={"mass": 100}), r"payload.mass is 100 kg.*mean 0.1 kg \(g\)"),
    (
        strip(joint={"hub_inertia": 1e4}),
        r"hub_inertia is 1e\+04 kg m\^2.*0.001 kg m\^2 \(g cm\^2\)",
    ),
    (strip(gravity=(0.0, 9.81)), r"gravity is \[0, 9.81\].*mean \[0, -9.81\]"),
    (strip(gravity=(0.0, -9810.0)), r"gravity is 9810 m/s\^2.*9.81 m/s\^2 \(mm/s\^2\)"),
    (strip(joint={"fixed": True, "rest_angle": 90}), r"rest_angle is 90 rad.*1.571 rad \(deg\)"),
    (
        strip(joint={"rotor_inertia": 4.5e-4, "gear_ratio": 100, "stiffness": 1.6e-4}),
        r"stiffness is 0.00016 N m/rad, so soft",
    ),
    (
        strip(joint={"rotor_inertia": 4.5e-4, "gear_ratio": 0.01, "stiffness": 1.6e4}),
        r"gear_ratio is 0.01.*mean 100",
    ),
    (strip(joint=stops(-90, 90)), r"limits contains 90 rad.*looks like degrees"),
    (strip(payload={"offset": (30.0, 0.0)}), r"payload.offset is 30 m.*0.03 m \(mm\)"),
    (strip(joint=winding(7.68, 2.6)), r"torque_constant is 7.68 N m/A.*0.00768 N m/A \(mN m/A\)"),
    (strip(joint=winding(7.68e-3, 2600.0)), r"resistance is 2600 ohm.*mean 2.6 ohm \(mohm\)"),
    # Arms from 0.1 mm to 15 m.
    (beam({"length": 100.0}), r"length is 100 m.*\(um\)"),
    (beam({"length": 0.1}), r"length is 0.1 m.*0.0001 m \(mm\)"),
    (beam(rectangle(20e-3, 2e-6)), r"width is 0.02 m, 200 times the length.*2e-05 m \(mm\)"),
    (beam(rectangle(20e-6, 2e-3)), r"height is 0.002 m, 20 times the length.*2e-06 m \(mm\)"),
    (beam(rectangle(20.0, 2.0)), r"width is 20 m.*2e-05 m \(um\)"),
    (beam(material(2330, 169)), r"youngs_modulus is 169 Pa.*\(GPa\)"),
    (beam(material(2330, 169e6)), r"youngs_modulus is 1.69e\+08 Pa, but no solid"),
    (beam(material(2.33, 169e9)), r"density is 2.33 kg/m\^3.*2330 kg/m\^3"),
    (beam(payload={"mass": 0.05}), r"payload.mass is 0.05 kg"),
    (boom({"length": 15e3}), r"length is 1.5e\+04 m.*mean 15 m \(mm\)"),
    (boom({"length": 0.015}), r"outer_diameter is 0.12 m, 8 times the length"),
    (
        boom({"section": fa.Tube(outer_diameter=120, thickness=2)}),
        r"outer_diameter is 120 m.*0.12 m \(mm\)",
    ),
    (boom({"section": fa.Tube(outer_diameter=0.12, thickness=2e-6)}), r"thickness is 2e-06 m"),
    (boom(material(1.6, 120e9)), r"density is 1.6 kg/m\^3.*1600 kg/m\^3 \(g/cm\^3\)"),
    (boom(material(1600, 120)), r"youngs_modulus is 120 Pa.*1.2e\+11 Pa \(GPa\)"),
    (boom(joint={"hub_inertia": 5e8}), r"hub_inertia is 5e\+08 kg m\^2"),
    (boom(payload={"mass": 30e3}), r"payload.mass is 3e\+04 kg.*mean 30 kg \(g\)"),
    (boom(payload={"inertia": 4e7}), r"payload.inertia is 4e\+07 kg m\^2"),
    (boom(payload={"offset": (200.0, 0.0)}), r"payload.offset is 200 m.*0.2 m \(mm\)"),
    (boom({"hub_radius": 400.0}), r"hub_radius is 400 m.*0.4 m \(mm\)"),
    (boom({"gauges": [fa.Gauge(station=1.0, distance=60.0)]}), r"distance is 60 m.*0.06 m \(mm\)"),
    (boom({"gauges": [fa.Gauge(station=1.0, distance=6e-5)]}), r"distance is 6e-05 m"),
    (boom(gravity=(0.0, 9.8)), r"gravity is \[0, 9.8\].*upward"),
    (reach({"length": 800.0}), r"links\[1\].length is 800 m.*mean 0.8 m \(mm\)"),
    (reach(first={"length": 800.0}), r"links\[0\].length is 800 m.*mean 0.8 m \(mm\)"),
    (
        reach({"flexural_rigidity": 900e6}),
        r"flexural_rigidity is 9e\+08 N m\^2.*900 N m\^2 \(N mm\^2\)",
    ),
    (
        reach({"flexural_rigidity": 900e-6}),
        r"its weight would bend the link by 837 times its length",
    ),
    (reach({"mass_per_length": 1200.0}), r"mass_per_length is 1200 kg/m.*1.2 kg/m \(g/m\)"),
    (reach({"mass_per_length": 1.2e-3}), r"links\[1\].*a modulus of 3e\+16 Pa"),
    (reach(payload={"mass": 1500.0}), r"payload.mass is 1500 kg.*1.5 kg \(g\)"),
    (reach(joint={"stiffness": 12.0}), r"stiffness is 12 N m/rad.*1.2e\+04 N m/rad \(kN m/rad\)"),
    (
        reach(joint={"rotor_inertia": 500.0}),
        r"rotor_inertia is 500 kg m\^2.*5e-05 kg m\^2 \(g cm\^2\)",
    ),
    (reach(joint=winding(50.0, 1.5)), r"torque_constant is 50 N m/A.*0.05 N m/A \(mN m/A\)"),
    (reach(joint=winding(0.05, 1500.0)), r"resistance is 1500 ohm.*1.5 ohm \(mohm\)"),
    (reach(joint=stops(-170.3, 170.3)), r"limits.lower is -170.3 rad.*-2.972 rad \(deg\)"),
    (reach(joint={"backlash": 2.0}), r"backlash is 2 rad.*0.03491 rad \(deg\)"),
    (
        reach(joint={"friction": {"coulomb": 2e4}}),
        r"friction.coulomb is 2e\+04 N m.*20 N m \(N mm\)",
    ),
]


@pytest.mark.parametrize(("spec", "text"), MISTAKES, ids=[text for _, text in MISTAKES])
def test_mistakes_are_named_with_the_unit_that_was_meant(spec, text):
    findings = implausible(spec)
    assert re.search(text, " ".join(findings)), findings


@pytest.mark.parametrize("spec", [strip(), beam(), boom(), reach(), constants(1.4, 0.162)])
def test_the_same_arms_without_the_mistake_are_plausible(spec):
    assert implausible(spec) == []


@pytest.mark.parametrize(
    "spec",
    [
        strip(gravity=(9.81, 0.0)),
        strip(gravity=(0.0, -1.62)),
        strip(gravity=(0.0, 1.62)),  # an arm upside down on the Moon
        strip(gravity=(0.0, -0.02)),  # a table that is not quite level
        strip(joint=stops(-1000.0, 0.5)),  # a single stop
        strip(joint=stops(-12.5, 12.5)),  # almost two turns
        strip(**ALONE),
        boom(payload={"mass": 2000.0, "inertia": 800.0}),  # an arm of a space station
        # A tentacle of soft silicone, and a steel tape.
        strip(
            {"length": 0.3, **material(1070, 7e4), "section": fa.Circle(diameter=0.02)},
            **ALONE,
        ),
        strip({"length": 0.6, **material(7850, 2e11), **rectangle(0.01, 1e-4)}, **ALONE),
        # Elastomer with iron, PTFE, aerogel, diamond.
        strip({**material(3000, 1e6), **rectangle(0.03, 0.03)}, **ALONE),
        strip(material(2200, 4e8)),
        beam(material(3515, 1.2e12)),
        strip({"length": 0.1, **material(100, 1e6), **rectangle(0.05, 0.02)}, **ALONE),
        # A leaf spring wider than long, and a rigid block.
        strip({"length": 0.01, **rectangle(0.04, 1e-4)}, **ALONE),
        strip({"length": 0.1, "flexible": False, **rectangle(0.2, 0.2)}),
    ],
)
def test_unusual_arms_are_plausible(spec):
    assert implausible(spec) == []


def test_plausible_random_arms_are_plausible():
    rng = np.random.default_rng(32)
    for _ in range(300):
        spec = plausible_spec(rng)
        assert implausible(spec) == [], spec


def test_arms_of_examples_library_and_gallery_are_plausible():
    files = [*ROOT.glob("examples/**/*.yaml"), *ROOT.glob("src/flexarm/library/*.yaml")]
    records = [file for file in files if "\nrecords:" in file.read_text()]
    specs = [load_arm_spec(file) for file in files if file not in records]
    specs += [locate_identification(file)[0].arm for file in records]
    assert len(specs) >= 5
    with warnings.catch_warnings():
        warnings.simplefilter("error", fa.ImplausibleValueWarning)
        for module in pkgutil.iter_modules(gallery.cases.__path__):
            case = importlib.import_module(f"gallery.cases.{module.name}")
            specs += [value.spec for value in vars(case).values() if isinstance(value, fa.Arm)]
    for spec in specs:
        assert implausible(spec) == []


#: Numbers whose size says nothing about their unit.
_WITHOUT_UNIT = ("ratio", "poissons_ratio", "stribeck_rate", "smoothing_rate", "gear_ratio", "x")
_ANGLES = ("rest_angle", "lower", "upper", "backlash")


def _mistake(rng, spec):
    """Return an arm with a random number, or a column of a table, in a wrong unit."""
    paths = [
        path
        for path in number_paths(spec)
        if path.rpartition(".")[2].partition("[")[0] not in _WITHOUT_UNIT
        and number_at("path", spec, path)
    ]
    path = str(rng.choice(paths))
    name = path.rpartition(".")[2].partition("[")[0]
    factor = 180.0 / math.pi if name in _ANGLES else float(rng.choice([1000.0, 1e-3]))
    column = path.rpartition("[")[0] if ".table." in path else path
    together = [other for other in paths if other.startswith(column)]
    return with_numbers(spec, {p: factor * number_at("path", spec, p) for p in together})


@pytest.mark.thorough
def test_half_of_all_mistakes_of_a_factor_of_1000_are_noticed():
    """A floor for random numbers: many remain plausible, such as a thousandth of an inertia."""
    rng, noticed, count = np.random.default_rng(7), 0, 400
    for _ in range(count):
        try:
            noticed += bool(implausible(_mistake(rng, plausible_spec(rng))))
        except InputError:
            noticed += 1
    assert noticed >= 0.53 * count, noticed / count


#: A gantry: a bridge and a trolley on belts, with a mast that bends, in SI units.
GANTRY = {
    "links": [
        {"length": 0.05, "mass_per_length": 400.0, "flexible": False},
        {"length": 0.005, "mass_per_length": 2000.0, "flexible": False},
        {
            "length": 1.5,
            "material": "steel",
            "section": fa.Box(width=0.1, height=0.1, thickness=0.005),
        },
    ],
    "joints": [
        {
            "kind": "prismatic",
            "rotor_inertia": 2e-3,
            "gear_ratio": 60.0,
            "friction": {"coulomb": 40.0},
            "limits": {"lower": -6.0, "upper": 6.0, "stiffness": 1e6},
        },
        {"kind": "prismatic", "axis": [0.0, 1.0], "rest_angle": 0.4, "mass": 5.0},
        {"mounting_angle": -1.57, "offset": [0.0, -0.2], "fixed": True},
    ],
    "payload": {"mass": 10.0},
    "gravity": [0.0, -9.81],
}


def gantry(k=0, **joint):
    joints = [{**old, **joint} if i == k else old for i, old in enumerate(GANTRY["joints"])]
    return ArmSpec(**{**GANTRY, "joints": joints})


def test_sliding_joints_are_not_judged_as_turning_ones():
    assert implausible(gantry()) == []
    assert implausible(gantry(limits={"lower": -90.0, "upper": 90.0, "stiffness": 1e6})) == []
    assert weights(gantry())[:2] == [0.0, 0.0]
    assert weights(gantry())[2] > 100.0


@pytest.mark.parametrize(
    ("k", "joint", "text"),
    [
        (0, {"limits": {"lower": -6.0, "upper": 6000.0, "stiffness": 1e6}}, r"mean 6 m \(mm\)"),
        (1, {"rest_angle": 800.0}, r"joints\[1\].rest_angle is 800 m.*mean 0.8 m \(mm\)"),
        (0, {"gear_ratio": 0.02}, "gear_ratio is 0.02 rad/m.*mean 50 rad/m"),
        (2, {"mounting_angle": 90.0}, r"mounting_angle is 90 rad.*mean 1.571 rad \(deg\)"),
        (2, {"offset": [0.0, 200.0]}, r"joints\[2\].offset is 200 m.*mean 0.2 m \(mm\)"),
        (0, {"rotor_inertia": 2e4}, r"joints\[0\].rotor_inertia .*mass of the arm outboard"),
        (0, {"friction": {"coulomb": 4e5}}, r"coulomb is 4e\+05 N, .*mean 400 N \(mN\)"),
        (1, {"mass": 5e4}, r"joints\[1\].mass is 5e\+04 kg.*mean 50 kg \(g\)"),
    ],
)
def test_mistakes_at_sliding_and_mounted_joints_are_noticed(k, joint, text):
    (finding,) = implausible(gantry(k, **joint))
    assert re.search(text, finding), finding


def test_arms_on_one_link_load_its_joint_together():
    """Two equal arms that point in opposite directions balance."""
    arm = {"length": 1.0, "mass_per_length": 2.0, "flexible": False}
    links = [arm, arm, {**arm, "parent": 1}]
    side, both = {}, {"mounting_angle": math.pi}
    together = weights(ArmSpec(links=links, gravity=(0.0, -10.0)))
    apart = weights(ArmSpec(links=links, joints=[{}, side, both], gravity=(0.0, -10.0)))
    assert together == pytest.approx([10.0 * (1.0 + 2 * 3.0), 10.0, 10.0], rel=1e-12)
    assert apart == pytest.approx([10.0 * (1.0 + 2 * 2.0), 10.0, 10.0], rel=1e-12)


def _warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(w.message) for w in caught if w.category is fa.ImplausibleValueWarning]


def test_an_arm_warns_once_where_the_user_describes_it(tmp_path):
    wrong = strip(rectangle(30, 2))
    fields = {name: getattr(wrong, name) for name in ("links", "joints", "payload", "gravity")}
    arms = []
    assert len(_warned(lambda: arms.append(fa.Arm(**fields)))) == 1
    assert len(_warned(lambda: fa.Arm(wrong))) == 1
    fa.save_arm(arms[0], tmp_path / "arm.yaml")
    (text,) = _warned(lambda: fa.load_arm(tmp_path / "arm.yaml"))
    assert "width is 30 m" in text
    assert "height is 2 m" in text
    for inside in (
        arms[0].rigid,
        lambda: pickle.loads(pickle.dumps(arms[0])),
        lambda: copy.deepcopy(arms[0]),
        lambda: fa.varied(arms[0], payload_factor=0.5),
    ):
        assert _warned(inside) == []
    heavy = "payload.mass is 100 kg"
    (text,) = _warned(lambda: fa.varied(fa.Arm(strip()), payload_mass=100.0))
    assert heavy in text


def test_a_filter_silences_the_warning():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", category=fa.ImplausibleValueWarning)
        fa.Arm(strip(rectangle(30, 2)))
    assert caught == []


@pytest.mark.parametrize("size", [1e-300, 1e-100, 1e100, 1e300])
def test_extreme_numbers_are_judged_without_errors(size):
    for spec in (strip(), boom(), reach(joint=winding(0.05, 1.5))):
        for path in number_paths(spec):
            implausible(with_number(spec, path, size, checked=False))


def test_long_findings_are_shortened():
    links = [{**STRIP, **rectangle(30, 2)}] * 4
    (text,) = _warned(lambda: fa.Arm(links=links))
    assert text.endswith("(3 more implausible numbers.)")


def test_check_does_not_say_ok_to_an_implausible_arm(tmp_path):
    path = tmp_path / "arm.yaml"
    fa.save_arm(fa.Arm(strip(rectangle(30, 2))), path)
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0
    assert (
        "width is 30 m, 60 times the length of the link: did you mean 0.03 m (mm)?" in result.stderr
    )
    assert result.stdout.rstrip().endswith("valid, but not plausible: see the warning")
    result = CliRunner().invoke(
        app,
        [
            "check",
            str(path),
            "--set",
            "arm.links[0].section={kind: rectangle, width: 30 mm, height: 2 mm}",
        ],
    )
    assert result.stdout.rstrip().endswith("ok")
