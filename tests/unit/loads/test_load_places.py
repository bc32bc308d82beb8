"""Places of loads, wrong loads, and sums of loads."""

from itertools import pairwise

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.actions import place_loads

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}


def arm(segments=1, theory="second_order"):
    links = [
        fa.Link(length=1.2, elements=4, segments=segments, **ROD),
        fa.Link(length=0.7, flexible=False, mass_per_length=0.4),
        fa.Link(length=0.9, elements=2, **ROD),
    ]
    return fa.Arm(links=links, theory=theory)


def bent(of):
    """Return coordinates of the arm at some angles, with slightly bent links; at rest."""
    rng = np.random.default_rng(5)
    q = of.rest([0.4, -0.9, 1.3])
    for piece in of.assembly.pieces:
        q[piece.modal] = 0.02 * rng.normal(size=piece.shapes.w2.size) / np.sqrt(piece.shapes.w2)
    return q


def force_of(of, *loads):
    """Return the generalised force of loads at a bent posture."""
    q, zero = bent(of), np.zeros(of.dof)
    without = of.inverse_dynamics(q, zero, zero)
    return without - of.inverse_dynamics(q, zero, zero, loads=loads)


# Two forces of about 10 N and N m are subtracted, beside stiffness forces of 1e3: a dozen digits.
ROUNDING = 1e-11


@pytest.mark.parametrize("segments", [1, 2, 4])
def test_tip_force_equals_a_load_at_the_end_of_the_last_link(segments):
    of = arm(segments)
    q, zero = bent(of), np.zeros(of.dof)
    by_tip = of.inverse_dynamics(q, zero, zero, (1.0, -2.0, 0.5))
    by_load = of.inverse_dynamics(q, zero, zero, loads=[fa.Load(3, (1.0, -2.0), 0.5)])
    np.testing.assert_array_equal(by_tip, by_load)
    at_station = fa.Load(3, (1.0, -2.0), 0.5, station=0.9)
    found = of.inverse_dynamics(q, zero, zero, loads=[at_station])
    np.testing.assert_allclose(found, by_tip, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("link", [1, 2])
def test_load_on_an_inner_tip_has_no_effect_beyond(link):
    of = arm()
    force = force_of(of, fa.Load(link, (1.0, -2.0), 0.5))
    beyond = of.joint_index[link]
    assert abs(force[:beyond]).max() > 0.1
    assert abs(force[beyond:]).max() < ROUNDING


@pytest.mark.parametrize("frame", ["world", "link"])
@pytest.mark.parametrize("segments", [1, 2, 4])
def test_distributed_load_equals_the_sum_of_its_parts(segments, frame):
    of, force = arm(segments), np.array([2.0, -3.0])
    whole = force_of(of, fa.Load(1, force, spread=(0.1, 1.1), frame=frame))
    parts = [fa.Load(1, force, spread=ends, frame=frame) for ends in ((0.1, 0.5), (0.5, 1.1))]
    np.testing.assert_allclose(whole, force_of(of, *parts), rtol=0, atol=ROUNDING)
    # And of point loads: many Gauss points on each element.
    node, weight = np.polynomial.legendre.leggauss(6)
    cuts = [0.1, 0.3, 0.6, 0.9, 1.1]
    points = []
    for a, b in pairwise(cuts):
        for s, w in zip(node, weight, strict=True):
            station = (a + b) / 2 + (b - a) / 2 * s
            points.append(fa.Load(1, force * w * (b - a) / 2, station=station, frame=frame))
    np.testing.assert_allclose(whole, force_of(of, *points), rtol=0, atol=ROUNDING)


def test_loads_are_added():
    of = arm(2)
    loads = [
        fa.Load(1, (1.0, 2.0), 0.3, station=0.45),
        fa.Load(2, (0.0, -1.0), spread=(0.0, 0.7)),
        fa.Load(3, (2.0, 0.0), -0.2, frame="link"),
    ]
    single = sum(force_of(of, load) for load in loads)
    np.testing.assert_allclose(force_of(of, *loads), single, rtol=0, atol=ROUNDING)
    three = [fa.Load(2, (3.0, 6.0), station=0.2)]
    one = [fa.Load(2, (1.0, 2.0), station=0.2)]
    np.testing.assert_allclose(force_of(of, *three), 3 * force_of(of, *one), atol=ROUNDING)


def test_follower_load_turns_with_its_link():
    """A rotation of the base joint turns a follower load; a dead load keeps its direction."""
    of = arm(theory="linear")
    q, zero = of.rest([0.0, 0.2, 0.3]), np.zeros(of.dof)
    turned = q.copy()
    turned[0] = 0.7
    c, s = np.cos(0.7), np.sin(0.7)
    follower = [fa.Load(2, (1.5, -0.5), frame="link")]
    np.testing.assert_allclose(
        of.inverse_dynamics(turned, zero, zero, loads=follower),
        of.inverse_dynamics(q, zero, zero, loads=follower),
        rtol=0,
        atol=ROUNDING,
    )
    dead = [fa.Load(2, (1.5, -0.5))]
    with_arm = [fa.Load(2, (c * 1.5 + s * 0.5, s * 1.5 - c * 0.5))]
    np.testing.assert_allclose(
        of.inverse_dynamics(turned, zero, zero, loads=with_arm),
        of.inverse_dynamics(q, zero, zero, loads=dead),
        rtol=0,
        atol=ROUNDING,
    )


def test_station_between_two_segments_belongs_to_either():
    of = arm(2)
    at = [force_of(of, fa.Load(1, (1.0, 2.0), 0.5, station=0.6 + d)) for d in (-1e-9, 0.0, 1e-9)]
    # A nanometre to either side changes the shapes there by a part in 1e8.
    np.testing.assert_allclose(at[0], at[1], rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(at[2], at[1], rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("elements", [2, 4])
def test_moment_turns_the_section_of_a_link_that_shears(elements):
    """It causes no shear force: beam theory's M a^2 / 2 EI + M a (L - a) / EI at the tip."""
    link = fa.Link(length=1.0, element="timoshenko", shear_rigidity=50.0, elements=elements, **ROD)
    moment, a = 1e-6, 0.5
    held = fa.equilibrium(fa.Arm(links=[link]), [0.0], loads=[fa.Load(1, moment=moment, station=a)])
    tip = fa.Arm(links=[link]).nodal(held.q)[0][-1]
    exact = moment / 20.0 * np.array([a**2 / 2 + a * (1.0 - a), a])
    np.testing.assert_allclose(tip, exact, rtol=1e-9)  # Newton's method ends at 1e-11


def test_base_acceleration_equals_opposite_gravity():
    of = arm()
    falling = fa.Arm(of.spec.replace(gravity=(1.0, -9.0)))
    rng = np.random.default_rng(2)
    q, qd, qdd = bent(of), *(0.1 * rng.normal(size=(2, of.dof)))
    np.testing.assert_array_equal(
        falling.inverse_dynamics(q, qd, qdd),
        of.inverse_dynamics(q, qd, qdd, base_acceleration=(-1.0, 9.0)),
    )
    np.testing.assert_array_equal(
        falling.forward_dynamics(q, qd, [1.0, 2.0, 3.0]),
        of.forward_dynamics(q, qd, [1.0, 2.0, 3.0], base_acceleration=(-1.0, 9.0)),
    )


def test_zero_loads_have_no_effect():
    of = arm()
    placed = place_loads(of, [])
    assert placed.body.size == 0
    assert np.all(placed.base_acceleration == 0.0)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (fa.Load(4, (0, 1)), "Load.link must be the number of a link, 1 to 3, got 4."),
        (
            fa.Load(2, (0, 1), station=0.71),
            "Load.station must be at most 0.7 (the length of the link), got 0.71.",
        ),
        (
            fa.Load(1, (0, 1), spread=(0.2, 1.3)),
            "Load.spread must be at most 1.2 (the length of the link), got 1.3.",
        ),
    ],
)
def test_loads_off_the_arm_are_rejected(load, message):
    of = arm()
    zero = np.zeros(of.dof)
    calls = {
        "Arm.forward_dynamics": lambda: of.forward_dynamics(zero, zero, [0, 0, 0], loads=[load]),
        "equilibrium": lambda: fa.equilibrium(of, loads=[load]),
        "simulate": lambda: fa.simulate(of, 0.1, loads=[load]),
    }
    for where, call in calls.items():
        with pytest.raises(fa.InputError) as reported:
            call()
        assert str(reported.value) == f"{where}: {message}"
