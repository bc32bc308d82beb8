"""Forces inside the links against Newton's law for material points, and against energies."""

from functools import cache

import numpy as np
import pytest

from oracles.lagrangian import LagrangianOracle
from oracles.sections import Section, by_lagrange, by_newton
from random_options import bent, busy

SEEDS = range(1200, 1216)
#: Sums of a few dozen terms of the size of the largest force.
ROUNDING = 1e-11


@cache
def case(seed):
    """Return a random arm, and its motion in the coordinates of the package and of the oracle."""
    b = busy(seed, theory=["linear", "second_order"][seed % 2])
    rng = np.random.default_rng(seed)
    speeding = rng.normal(size=b.arm.n_joints) * 5.0, bent(rng, b.arm.spec, 1.0)
    oracle = LagrangianOracle(b.arm.spec)
    pairs = [
        (b.state.angles, b.state.nodal),
        (b.state.angle_rates, b.state.nodal_rates),
        speeding,
    ]
    motion = [b.arm.from_nodal(*pair) for pair in pairs]
    return b, motion, [oracle.coordinates(*pair) for pair in pairs]


def found(b, motion, section, stations):
    surroundings = (b.tip_force, b.loads, b.base_acceleration)
    forces = b.arm.section_forces(*motion, stations, *surroundings)
    length = b.arm.spec.links[section.link - 1].length
    return forces[section.link - 1, round(section.station / length * (stations - 1))]


def scale(b, motion):
    """Return the size (3,) of the forces and moments that balance at a section."""
    forces = b.arm.section_forces(*motion, 11, b.tip_force, b.loads, b.base_acceleration)
    size = max(abs(forces[..., :2]).max(), 1.0)
    return np.array([size, size, max(abs(forces[..., 2]).max(), size)])


def sections(b, seed):
    """Return an inner station and an end of each link, none between segments or at a load."""
    rng = np.random.default_rng(seed)
    for link, one in enumerate(b.arm.spec.links, start=1):
        for k in (rng.choice([1, 3, 5, 7, 11]), rng.choice([0, 13])):
            yield Section(link, one.length * k / 13)


@pytest.mark.sampled("1205", "1206", "1210", "1212", "1213", "1215")
@pytest.mark.parametrize("seed", SEEDS)
def test_lagrange_equations_beyond_a_section(seed):
    """Both theories, all options."""
    b, motion, nodal = case(seed)
    # the inner one only, because an energy takes seconds
    for section in list(sections(b, seed))[::2]:
        if b.arm.spec.joints[section.link - 1].fixed:
            # no coordinate gives the moment here; the test by Newton's law includes this joint
            continue
        exact = by_lagrange(b.arm.spec, section, nodal, b.all_loads, b.base_acceleration)
        error = found(b, motion, section, 14) - exact
        assert np.all(abs(error) < ROUNDING * scale(b, motion)), (section, error, exact)


@pytest.mark.sampled("1202", "1208", "1215")
@pytest.mark.parametrize("seed", SEEDS)
def test_newtons_law_beyond_a_section(seed):
    """For the linear theory, and for the forces of the second-order one, which move points as
    stated."""
    b, motion, nodal = case(seed)
    parts = slice(None) if b.arm.spec.theory == "linear" else slice(2)
    for section in sections(b, seed):
        exact = by_newton(b.arm.spec, section, nodal, b.all_loads, b.base_acceleration)
        error = (found(b, motion, section, 14) - exact)[parts]
        assert np.all(abs(error) < ROUNDING * scale(b, motion)[parts]), (section, error, exact)


def test_moments_of_the_second_order_theory_omit_third_order_terms():
    """At a quarter of deflections and rates, the error of the moment is a 64th."""
    errors, moments = [], []
    for factor in (1.0, 0.25):
        b = busy(1201, theory="second_order")
        oracle = LagrangianOracle(b.arm.spec)
        pairs = [
            (b.state.angles, [factor * n for n in b.state.nodal]),
            (b.state.angle_rates, [factor * n for n in b.state.nodal_rates]),
            (
                b.state.angle_rates,
                [factor * n for n in bent(np.random.default_rng(1), b.arm.spec, 1.0)],
            ),
        ]
        motion = [b.arm.from_nodal(*pair) for pair in pairs]
        nodal = [oracle.coordinates(*pair) for pair in pairs]
        section = Section(1, b.arm.spec.links[0].length * 3 / 13)
        exact = by_newton(b.arm.spec, section, nodal, b.all_loads, b.base_acceleration)
        errors.append(abs(found(b, motion, section, 14) - exact)[2])
        moments.append(abs(exact[2]))
    assert errors[0] > 1e-8 * moments[0]  # far above rounding
    assert 40.0 < errors[0] / errors[1] < 90.0


def test_every_option_is_drawn():
    drawn = [case(seed)[0] for seed in SEEDS]
    links = [link for b in drawn for link in b.arm.spec.links]
    assert {link.segments for link in links} >= {1, 2, 3}
    assert {link.flexible for link in links} == {True, False}
    loads = [load for b in drawn for load in b.loads]
    assert {(load.frame, load.spread is None) for load in loads} == {
        (frame, point) for frame in ("world", "link") for point in (True, False)
    }
    assert {load.station is None for load in loads if load.spread is None} == {True, False}
    assert {any(b.base_acceleration) for b in drawn} == {True, False}
    assert {any(b.arm.spec.payload.offset) for b in drawn} == {True, False}
    joints = [joint for b in drawn for joint in b.arm.spec.joints]
    assert {joint.fixed for joint in joints} == {joint.elastic for joint in joints} == {True, False}
    assert {bool(joint.hub_inertia) for joint in joints} == {True, False}
