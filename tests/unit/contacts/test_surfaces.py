"""Distances from walls, circles and tabulated surfaces, by dense sampling or by hand."""

import numpy as np
import pytest
from matplotlib.path import Path
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

import flexarm as fa
from flexarm.arm.actions import place_contacts
from flexarm.arm.assembly.surfaces import pieces_of
from flexarm.arm.observe import contact_forces, contact_values
from flexarm.kernels.forces.contact import BEND, FORCE, GAP, POSITION

ARM = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)] * 2)


def views_from(surface, points, **law):
    """Return columns of ``look_many`` (points, 9) with the tip at each of the points (k, 2)."""
    law = {"stiffness": 1e3, **law}
    x, y = np.transpose(points)
    far = np.hypot(x, y)
    bend = 2.0 * np.arccos(far / 2.0)
    q = np.stack([np.arctan2(y, x) - bend / 2.0, bend], axis=1)
    states = ARM.padded(np.stack([q, np.zeros_like(q)], axis=1))
    placed = place_contacts(ARM, [fa.Contact(surface, **law)])
    values = contact_values(ARM, placed, states)[:, 0]
    np.testing.assert_allclose(values[:, POSITION : POSITION + 2], points, atol=1e-14)
    np.testing.assert_array_equal(
        values[:, FORCE : FORCE + 2], contact_forces(ARM, placed, states)[:, 0]
    )
    return values


def some_points(count=40, seed=3):
    rng = np.random.default_rng(seed)
    radius, angle = rng.uniform(0.2, 1.9, count), rng.uniform(-np.pi, np.pi, count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_wall():
    points = some_points()
    found = views_from(fa.Wall((0.3, -0.2), (3.0, 4.0)), points)
    np.testing.assert_allclose(
        found[:, GAP], (points - [0.3, -0.2]) @ [0.6, 0.8], rtol=0, atol=1e-15
    )
    pushed = found[:, GAP] < -1e-6
    np.testing.assert_allclose(
        found[pushed, FORCE : FORCE + 2],
        -1e3 * found[pushed, GAP, None] * [0.6, 0.8],
        rtol=1e-6,  # the corner, 1e-9 m wide
    )


@pytest.mark.parametrize("inside", [False, True])
def test_circle(inside):
    points, center = some_points(), np.array([0.4, 0.3])
    found = views_from(fa.RoundWall(center, 0.7, inside), points)
    away = points - center
    distance = np.linalg.norm(away, axis=1)
    sign = -1.0 if inside else 1.0
    np.testing.assert_allclose(found[:, GAP], sign * (distance - 0.7), rtol=0, atol=1e-15)
    pushed = found[:, GAP] < -1e-6
    assert pushed.any()
    normal = sign * away / distance[:, None]
    np.testing.assert_allclose(
        found[pushed, FORCE : FORCE + 2],
        -1e3 * found[pushed, GAP, None] * normal[pushed],
        rtol=1e-6,
    )
    np.testing.assert_allclose(found[:, BEND], sign / 0.7, rtol=1e-14)


@pytest.mark.parametrize("inside", [False, True])
def test_large_circle_equals_a_wall(inside):
    points = some_points()
    normal, sign = np.array([0.0, 1.0]), -1.0 if inside else 1.0
    wall = views_from(fa.Wall((0.1, 0.2), normal), points)
    radius = 1e7
    circle = fa.RoundWall(np.array([0.1, 0.2]) - sign * radius * normal, radius, inside)
    found = views_from(circle, points)
    # The sagitta over 2 m is 2e-7 m; rounding at 1e7 m 2e-9 m.
    np.testing.assert_allclose(found[:, GAP], wall[:, GAP], atol=5e-7)


def test_table_of_a_line_equals_a_wall_also_beyond_its_ends():
    points = some_points()
    wall = views_from(fa.Wall((0.0, -0.1), (-0.6, 0.8)), points, damping=1.0)
    x = np.array([-0.4, 0.0, 0.1, 0.4])
    found = views_from(fa.SurfaceTable(x, -0.1 + 0.75 * x), points, damping=1.0)
    np.testing.assert_allclose(found[:, GAP:], wall[:, GAP:], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(found[:, FORCE : FORCE + 2], wall[:, FORCE : FORCE + 2], atol=1e-10)


@pytest.mark.parametrize("inside", [False, True])
def test_closed_table_of_a_circle_equals_a_circle(inside):
    points = some_points(200)
    turn = np.linspace(0.0, 2.0 * np.pi, 49) * (1.0 if inside else -1.0)
    table = fa.SurfaceTable(0.3 + 0.8 * np.cos(turn), 0.8 * np.sin(turn), closed=True)
    found = views_from(table, points)
    exact = views_from(fa.RoundWall((0.3, 0.0), 0.8, inside), points)
    # A cubic spline with knots at every 0.13 rad: 0.8 (0.13)^4 / 384, plus the error of its
    # parameter.
    away = abs(exact[:, GAP]) < 0.7  # near the centre all points have the same distance
    np.testing.assert_allclose(found[away, GAP], exact[away, GAP], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found[away, BEND], exact[away, BEND], rtol=3e-3)


@pytest.mark.thorough
def test_distance_from_a_wavy_table():
    """Against the smallest of 200 000 distances along the curve."""
    knots = np.linspace(-2.0, 2.0, 81)
    table = fa.SurfaceTable(knots, 0.2 * np.sin(3.0 * knots))
    points = some_points(60)
    found = views_from(table, points)
    rows = pieces_of(table)
    s = np.linspace(rows[1, 0], rows[-1, 0], 200_000, endpoint=False)
    row = np.searchsorted(rows[1:, 0], s, side="right")
    u = s - rows[row, 0]
    powers = u[:, None] ** np.arange(4)
    curve = np.stack([np.sum(rows[row, k : k + 4] * powers, axis=1) for k in (1, 5)], axis=1)
    inner = abs(curve[:, 0]) < 1.8  # at its ends the spline is straight, the sine is not
    np.testing.assert_allclose(curve[inner, 1], 0.2 * np.sin(3.0 * curve[inner, 0]), atol=1e-5)
    points = points[abs(points[:, 0]) < 1.7]
    found = views_from(table, points)
    distance = [np.linalg.norm(curve - point, axis=1).min() for point in points]
    side = np.sign(points[:, 1] - 0.2 * np.sin(3.0 * points[:, 0]))
    near = np.array(distance) < 0.25  # within the smallest radius of curvature, 1 / 1.8
    assert near.sum() > 5
    np.testing.assert_allclose(found[near, GAP], (side * distance)[near], rtol=0, atol=1e-8)
    # Far away another point may be as near; the sign, which decides about contact, is correct.
    np.testing.assert_array_equal(np.sign(found[:, GAP]), side)


def test_force_of_a_table_is_continuous_at_knots():
    x = np.linspace(0.2, 1.8, 9)
    table = fa.SurfaceTable(x, 0.3 + 0.1 * np.cos(4.0 * x))
    knot = pieces_of(table)[4, [1, 5]]
    near = knot - [0.0, 0.02] + np.linspace(-1e-7, 1e-7, 5)[:, None] * [1.0, 0.0]
    force = views_from(table, near)[:, FORCE : FORCE + 2]
    np.testing.assert_allclose(np.diff(force, 2, axis=0), 0.0, atol=1e-9)
    assert abs(np.diff(force, axis=0)).max() > 1e-8


def sharp_bodies():
    """Return closed bodies (k, 2), clockwise, with quarter circles between knots at their ends."""
    for count, width in ((8, 0.05), (24, 0.05), (24, 0.01), (48, 0.01)):
        angle = -np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        yield f"ellipse of {count}, {width}", 0.5 * np.cos(angle), width * np.sin(angle)
    along = np.linspace(0.0, 1.0, 15)
    x, y = 0.8 * along**2 - 0.4, 0.24 * along * (1.0 - along**2)
    yield "wing", np.append(x, x[-2:0:-1]), np.append(y, -y[-2:0:-1])


def points_outside(x, y):
    """Return points (400, 2) beyond an end of a body where its line starts, with two pieces as
    near."""
    rng = np.random.default_rng(1)
    away, angle = rng.uniform(0.0, 0.6, 400), rng.uniform(-0.9, 0.9, 400)
    return np.stack([x + np.sign(x) * away * np.cos(angle), y + away * np.sin(angle)], axis=1)


@pytest.mark.sampled("wing", "ellipse of 24, 0.01")
@pytest.mark.parametrize(("x", "y"), [pytest.param(*b[1:], id=b[0]) for b in sharp_bodies()])
def test_nearest_point_is_found_around_sharp_ends(x, y):
    points = np.concatenate([some_points(1000, 5), points_outside(x[0], y[0])])
    found = views_from(fa.SurfaceTable(x, y, closed=True), points)[:, GAP]
    knots = np.stack([np.append(x, x[0]), np.append(y, y[0])], axis=1)
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1)))
    curve = CubicSpline(s, knots, bc_type="periodic")(np.linspace(0.0, s[-1], 60_001))
    expected = cKDTree(curve).query(points)[0]
    expected[Path(curve).contains_points(points)] *= -1.0
    # The curve's points are 3e-5 apart: near it the nearest one is half of that away.
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


def test_closed_line_that_crosses_itself_is_rejected():
    """A lemniscate, one loop larger than the other; and a star of five points."""
    turn = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False) + 0.05
    size = np.where(np.cos(turn) > 0.0, 1.0, 0.5)
    with pytest.raises(fa.InputError, match=r"x and y are a polygon that crosses itself"):
        fa.SurfaceTable(size * np.cos(turn), size * np.sin(2.0 * turn), closed=True)
    star = 2.0 * np.pi * np.arange(5) * 2.0 / 5.0
    with pytest.raises(fa.InputError, match=r"after the points \[0\] and \[2\]"):
        fa.SurfaceTable(np.cos(star), np.sin(star), closed=True)
    around = np.sort(star % (2.0 * np.pi))
    fa.SurfaceTable(np.cos(around), np.sin(around), closed=True)


def first_crossing(points):
    """Return the first two sides of a closed polygon (k, 2) that cross, from all pairs; or None."""
    sides = np.roll(points, -1, axis=0) - points
    for k in range(len(points)):
        for other in range(k + 2, len(points) - (k == 0)):
            matrix = np.stack([sides[k], -sides[other]], axis=1)
            along = np.linalg.solve(matrix, points[other] - points[k])
            if np.all((along >= 0.0) & (along <= 1.0)):
                return k, other
    return None


def test_crossing_is_the_first_of_all_pairs():
    rng = np.random.default_rng(11)
    counts = [0, 0]
    for count in (4, 4, 4, 5, 5, 6, 9, 14) * 8:
        x, y = rng.uniform(-1.0, 1.0, (2, count)) * rng.uniform(0.1, 1.0, (2, 1))
        expected = first_crossing(np.stack([x, y], axis=1))
        counts[expected is None] += 1
        if expected is None:
            fa.SurfaceTable(x, y, closed=True)
            continue
        places = rf"\[{expected[0]}\] and \[{expected[1]}\]"
        with pytest.raises(fa.InputError, match=places):
            fa.SurfaceTable(x, y, closed=True)
    assert min(counts) > 5
