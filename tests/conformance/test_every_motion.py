"""Every kind of motion, and every torque along one: copies, pickles and tables."""

import copy
import pickle
from functools import cache
from inspect import Parameter, signature
from typing import get_args

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import five_bar, four_bar
from flexarm.cases.scenario.references import MOTION_FUNCTIONS, motion_of
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import Scenario
from flexarm.model.scenarios.motions import PlainMotionSpec, ShapingSpec, SmoothingSpec
from flexarm.motion import Motion

ROD = {"flexural_rigidity": 60.0, "mass_per_length": 0.5}


@cache
def two_links():
    return fa.Arm(links=[fa.Link(length=1.0, elements=1, **ROD)] * 2)


@cache
def line():
    return fa.line_motion(two_links(), (1.2, 0.8), (0.8, 1.2), 1.0, start_time=2.0)


@cache
def long_line():
    three = fa.Arm(links=[fa.Link(length=0.7, elements=1, **ROD)] * 3)
    return fa.line_motion(three, (1.2, 0.8), (0.8, 1.2), 1.0, profile="trapezoidal")


@cache
def driven_crank():
    closed = four_bar()
    return fa.joint_motion(
        fa.Arm(**closed.fields), closed.joints, closed.joints + 1.0, 0.9, driven=[1]
    )


@cache
def line_of_a_five_bar():
    closed = five_bar()
    arm = fa.Arm(**closed.fields)
    x, y, *_ = arm.tip(fa.assembled(arm, arm.rest(closed.joints)).q)
    end = [float(x) + 0.05, float(y) + 0.03]
    return fa.line_motion(arm, [float(x), float(y)], end, 0.9, posture=closed.joints)


@cache
def spline():
    return fa.spline_motion(two_links(), [(1.2, 0.8), (0.8, 1.2), (0.1, 1.3)], 1.0)


def joints(profile):
    return fa.joint_motion(two_links(), [0.2, -0.4], [0.9, 0.5], 0.8, profile, start_time=0.1)


@cache
def optimal():
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02)]
    arm = fa.Arm(links=[fa.Link(length=1.0, modes=1, **ROD)] * 2, joints=joints)
    return fa.optimal_motion(arm, [0.2, -0.4], [0.9, 0.5], "energy", duration=1.5, intervals=40)


@cache
def inversion():
    return fa.tip_inversion(two_links(), line(), reduction=0.5)


def scenario(**parts):
    """Return a scenario of two links that runs for a second; other parts as in files."""
    arm = two_links().spec
    return Scenario(arm=arm, run={"duration": 1.0}, **parts)


def motion_of_file(**parts):
    return motion_of(two_links(), scenario(**parts))


def default_of(field):
    return Parameter.empty if field.is_required() else field.default


CALLS = {
    **{
        spec: MOTION_FUNCTIONS[spec.model_fields["kind"].default]
        for spec in get_args(PlainMotionSpec)
    },
    ShapingSpec: fa.shaped,
    SmoothingSpec: fa.smoothed,
}


@pytest.mark.parametrize("record", CALLS, ids=lambda record: record.__name__)
def test_keys_of_files_are_the_arguments_of_the_function(record):
    """Names and defaults are the same, but for arguments that only Python has."""
    around = {"kind", "shaping", "smoothing"}
    keys = {k: default_of(f) for k, f in record.model_fields.items() if k not in around}
    arguments = {k: p.default for k, p in signature(CALLS[record]).parameters.items()}
    only_python = {"arm", "motion", "posture"}
    assert keys == {k: value for k, value in arguments.items() if k not in only_python}


PATH = {"kind": "joint", "start": [0.3, 0.5], "end": [0.5, 0.8], "duration": 1.0}
CIRCLE = {"kind": "round", "center": [0.0, 0.0], "radius": 3.0, "inside": True}
FORCE = {"times": [0.0, 0.5, 1.0], "values": [0.0, 2.0, 1.0]}

MOTIONS = {
    "joint": lambda: joints("quintic"),
    "joint, trapezoidal": lambda: joints("trapezoidal"),
    "line": line,
    "line of three links": long_line,
    "spline": spline,
    "via points": lambda: fa.via_point_motion(two_links(), [(1, 0.5), (1, 1), (0, 1)], 1.0),
    "circle": lambda: fa.circle_motion(two_links(), (0.8, 0.8), (1.0, 0.8), -6.0, 1.0),
    "quasi-static on a spline": lambda: fa.quasi_static_reference(two_links(), spline()),
    "smoothed spline": lambda: fa.smoothed(spline(), 0.2),
    "shaped spline": lambda: fa.shaped(spline(), two_links()),
    "smoothed": lambda: fa.smoothed(long_line(), 0.2),
    "shaped": lambda: fa.shaped(line(), two_links()),
    "quasi-static": lambda: fa.quasi_static_reference(two_links(), line()),
    "quasi-static, order 2": lambda: fa.quasi_static_reference(two_links(), line(), order=2),
    "optimal": optimal,
    "inversion": lambda: inversion().reference,
    "sampled": lambda: joints("trapezoidal").sampled(300.0),
    "driven crank": driven_crank,
    "line of a five-bar": line_of_a_five_bar,
    "of a file": lambda: motion_of_file(motion={**PATH, "smoothing": {"duration": 0.1}}),
}
PRESSED = {
    "pressed": lambda: fa.pressed_motion(two_links(), line(), 2.0, (1.0, 1.0), interval=0.5),
    "pressed, of a file": lambda: motion_of_file(
        motion={"kind": "pressed", "path": PATH, "force": FORCE, "interval": 0.2},
        contacts=[{"surface": CIRCLE, "stiffness": 1e4}],
    ),
}
FUNCTIONS = {
    "rigid torque": lambda: fa.rigid_torque(two_links(), line()),
    "corrected torque": lambda: inversion().torque,
    "quasi-static torque": lambda: fa.quasi_static_reference(two_links(), line()).torque,
    "torque of an optimal motion": lambda: optimal().torque,
    "flexible torque": lambda: fa.flexible_torque(two_links(), joints("quintic")),
    "balanced torque of a file": lambda: prepare(
        scenario(
            motion=PATH,
            drive={"kind": "rigid_inverse_dynamics"},
            loads=[{"link": 2, "force": [0.0, -1.0]}],
            initial={"equilibrium": True, "balance": True},
        )
    ).options["torque"],
}
PRESCRIBED = {
    "hold": lambda: fa.PrescribedAngle.hold(0.3),
    "table": lambda: fa.PrescribedAngle.table([0.0, 0.5, 1.0], [0.0, 0.3, 0.1]),
}

TIMES = [-1.0, 0.0, 0.1, 0.3, 0.97, 2.0, 2.5, 9.0]
OF_THE_JOINTS = ("joint_angle", "joint_rate", "joint_acceleration", "tip")
OF_THE_FORCE = ("contact_force", "normal", "holding_torque", "pressing_torque")


def answers(value):
    """Return all values of a motion or a function of time at a few times, in one row."""
    if isinstance(value, fa.PrescribedAngle):
        functions = [value.angle, value.rate, value.acceleration]
    elif callable(value):
        functions = [value]
    else:
        names = [*OF_THE_JOINTS, *OF_THE_FORCE]
        functions = [getattr(value, name) for name in names if hasattr(value, name)]
    return np.concatenate([np.ravel(function(t)) for function in functions for t in TIMES])


def kinds(base):
    """Return all classes of motions that are not abstract, subclasses of subclasses included."""
    for kind in base.__subclasses__():
        if not kind.__abstractmethods__:
            yield kind
        yield from kinds(kind)


@pytest.mark.thorough
def test_every_kind_of_motion_is_tested_here():
    here = {type(make()) for make in MOTIONS.values()}
    missing = {
        kind.__name__ for kind in kinds(Motion) if kind.__module__.startswith("flexarm.")
    } - {kind.__name__ for kind in here}
    assert not missing


EVERY = MOTIONS | PRESSED | FUNCTIONS | PRESCRIBED


@pytest.mark.sampled("joint", "via points", "sampled", "quasi-static torque", "table")
@pytest.mark.parametrize("make", EVERY.values(), ids=EVERY)
def test_copies_and_pickles_give_the_same_values(make):
    """Studies pass them to other processes, and a lambda cannot be pickled."""
    value = make()
    expected = answers(value)
    for copied in (copy.copy(value), copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        np.testing.assert_array_equal(answers(copied), expected)
        assert type(copied) is type(value)


@pytest.mark.sampled("joint", "line of three links", "circle", "optimal", "of a file")
@pytest.mark.parametrize("make", MOTIONS.values(), ids=MOTIONS)
def test_table_equals_the_motion_within_its_stated_error(make):
    motion = make()
    table = motion.sampled(500.0)
    assert (table.breaks, table.start_time, table.end_time, table.joints) == (
        motion.breaks,
        motion.start_time,
        motion.end_time,
        motion.joints,
    )
    beside = np.nextafter(motion.breaks, -np.inf)
    ends = [-np.inf, motion.start_time - 1.0, motion.end_time + 1.0, np.inf]
    spread = np.linspace(motion.start_time, motion.end_time, 1777)
    times = np.concatenate([spread, motion.breaks, beside, ends])
    found, exact = table.state(times), motion.state(times)
    for part, (got, want) in enumerate(zip(found, exact, strict=True)):
        # Rounding of a spline with interval h: a few bits of the angle, over h once or twice.
        rounding = 1e-14 * 500.0**part
        # Four instants of each interval find the largest error of a smooth motion; the inversion is
        # a spline with its own knots.
        largest = 1.25 * table.error[part] + rounding
        np.testing.assert_array_less(np.max(abs(got - want), axis=0), largest)
    resting = (times < motion.start_time) | (times >= motion.end_time)
    assert not np.any(found.rate[resting])
    assert not np.any(found.acceleration[resting])
    for name, part in zip(OF_THE_JOINTS, found, strict=False):
        np.testing.assert_array_equal(getattr(table, name)(times), part)
        np.testing.assert_array_equal(getattr(table, name)(float(times[70])), part[70])
    np.testing.assert_array_equal(table.tip(spread), motion.tip(spread))


def test_error_of_a_table_falls_with_the_sixth_power_of_the_interval():
    """The error of angles; that of rates falls with the fifth power, that of accelerations with the
    fourth."""
    motion = line()
    coarse, fine = motion.sampled(20.0), motion.sampled(40.0)
    for power, more, less in zip((6, 5, 4), coarse.error, fine.error, strict=True):
        assert np.all(more / less > 0.7 * 2.0**power)
    assert np.all(fine.error.angle < 1e-5)


def test_run_along_a_table_equals_that_along_the_motion():
    arm, motion = two_links().rigid(), joints("trapezoidal")
    run = {"controller": fa.JointPD([10.0, 4.0], [2.0, 0.5]), "progress": False}
    exact = fa.simulate(arm, 1.0, reference=motion, **run)
    table = fa.simulate(arm, 1.0, reference=motion.sampled(1000.0), **run)
    np.testing.assert_allclose(table.tip, exact.tip, rtol=0, atol=1e-9)
