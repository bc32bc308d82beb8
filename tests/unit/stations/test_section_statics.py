"""Forces inside links at rest, against the balance of loads beyond the section."""

from itertools import pairwise

import numpy as np
import pytest

import flexarm as fa

L, EI, MU = 1.3, 40.0, 0.8
STATIONS = 11
X = np.linspace(0.0, L, STATIONS)
# Sums of a few numbers near one.
EXACT = {"rtol": 0, "atol": 2e-14}
KINDS = {
    "one element": {"elements": 1},
    "a mesh": {"elements": 7},
    "reduced": {"elements": 6, "modes": 3},
    "segments": {"elements": 8, "segments": 4},
    "a segment a station": {"elements": 10, "segments": 10},
    "rotary inertia": {"elements": 3, "rotary_inertia_per_length": 0.01},
    "with shear": {
        "elements": 3,
        "element": "timoshenko",
        "shear_rigidity": 300.0,
        "rotary_inertia_per_length": 0.01,
    },
    "rigid": {"flexible": False},
}


def cantilever(kind="a mesh", theory="linear", gravity=(0.0, 0.0)):
    fields = dict(KINDS[kind])
    if fields.get("flexible", True):
        fields["flexural_rigidity"] = EI
    joint = fa.Joint(hub_inertia=0.3)
    link = fa.Link(length=L, mass_per_length=MU, **fields)
    return fa.Arm(links=[link], joints=[joint], theory=theory, gravity=gravity)


def straight(arm, angle=0.0, **surroundings):
    """Return section forces (stations,) each, of a straight arm at rest."""
    zero = np.zeros(arm.dof)
    return arm.section_forces(arm.rest([angle]), zero, zero, STATIONS, **surroundings)[0].T


def turned(angle, x, y):
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle", [0.0, 2.1])
class TestCantilever:
    """Forces along and across the link; the world is turned with it."""

    def test_tip_force(self, kind, angle):
        """The convention: an upward tip force P gives V = P and M = P (L - x); tension has N >
        0."""
        force = turned(angle, 3.0, 2.0)
        axial, shear, moment = straight(cantilever(kind), angle, tip_force=force)
        np.testing.assert_allclose(axial, 3.0 + 0 * X, **EXACT)
        np.testing.assert_allclose(shear, 2.0 + 0 * X, **EXACT)
        np.testing.assert_allclose(moment, 2.0 * (L - X), **EXACT)

    def test_tip_moment(self, kind, angle):
        forces = straight(cantilever(kind), angle, tip_force=(0.0, 0.0, 1.5))
        np.testing.assert_allclose(forces, np.outer([0.0, 0.0, 1.5], 1 + 0 * X), **EXACT)

    def test_weight(self, kind, angle):
        gx, gy = 3.0, -9.81
        arm = cantilever(kind, gravity=turned(angle, gx, gy))
        axial, shear, moment = straight(arm, angle)
        np.testing.assert_allclose(axial, MU * gx * (L - X), **EXACT)
        np.testing.assert_allclose(shear, MU * gy * (L - X), **EXACT)
        np.testing.assert_allclose(moment, MU * gy * (L - X) ** 2 / 2, **EXACT)

    def test_base_acceleration(self, kind, angle):
        lifted = turned(angle, 0.0, 4.0)
        _, _, moment = straight(cantilever(kind), angle, base_acceleration=lifted)
        np.testing.assert_allclose(moment, -MU * 4.0 * (L - X) ** 2 / 2, **EXACT)

    @pytest.mark.parametrize(("start", "end"), [(0.0, L), (0.2, 0.9), (0.26, 0.65)])
    def test_distributed_load(self, kind, angle, start, end):
        """On the whole link, on a part of it, and from one station to another."""
        load = fa.Load(1, turned(angle, 0.5, -4.0), spread=(start, end))
        axial, shear, moment = straight(cantilever(kind), angle, loads=[load])
        loaded = end - np.clip(X, start, end)
        np.testing.assert_allclose(axial, 0.5 * loaded, **EXACT)
        np.testing.assert_allclose(shear, -4.0 * loaded, **EXACT)
        middle = end - loaded / 2 - X
        np.testing.assert_allclose(moment, -4.0 * loaded * middle, **EXACT)

    @pytest.mark.parametrize("frame", ["world", "link"])
    def test_point_load_at_mid_span(self, kind, angle, frame):
        """Zero beyond it; the value at the load is that inboard of it."""
        force = (1.0, 2.0) if frame == "link" else turned(angle, 1.0, 2.0)
        load = fa.Load(1, force, 0.7, station=L / 2, frame=frame)
        axial, shear, moment = straight(cantilever(kind), angle, loads=[load])
        inboard = X < L / 2 + 1e-12
        assert inboard.sum() == 6
        np.testing.assert_allclose(axial, 1.0 * inboard, **EXACT)
        np.testing.assert_allclose(shear, 2.0 * inboard, **EXACT)
        np.testing.assert_allclose(moment, (2.0 * (L / 2 - X) + 0.7) * inboard, **EXACT)

    def test_loads_at_the_ends(self, kind, angle):
        """A load at the root acts on the joint only; a load at the tip acts on all sections."""
        force = turned(angle, 1.0, 2.0)
        at_root = straight(cantilever(kind), angle, loads=[fa.Load(1, force, 0.7, station=0.0)])
        np.testing.assert_allclose(at_root, 0.0, **EXACT)
        at_tip = straight(cantilever(kind), angle, loads=[fa.Load(1, force, 0.7, station=L)])
        np.testing.assert_allclose(at_tip[1], 2.0 + 0 * X, **EXACT)
        np.testing.assert_allclose(at_tip[2], 2.0 * (L - X) + 0.7, **EXACT)


@pytest.mark.parametrize("kind", ["a mesh", "segments", "a segment a station"])
def test_station_that_rounds_beside_a_load_is_inboard_of_it(kind):
    """Tenths of 1.3 m as products, as sums and as literals differ in the last digit."""
    arm = cantilever(kind)
    for station in (0.13, 0.26, 0.39, 0.52, 0.65, 0.78, 0.91, 1.04, 1.17):
        for rounding in (-1e-12, 0.0, 1e-12):
            load = fa.Load(1, (0.0, 1.0), station=station + rounding)
            shear = straight(arm, loads=[load])[1]
            np.testing.assert_allclose(shear, station + 1e-9 > X, **EXACT)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("kind", ["a mesh", "segments"])
def test_distributed_load_equals_the_sum_of_its_points(kind, theory):
    """On a bent link; Gauss points between neighbours among stations and nodes."""
    arm = cantilever(kind, theory)
    q, force, (start, end) = bent(arm), np.array([-3.0, 2.0]), (0.2, 1.1)
    (link,) = arm.spec.links
    cuts = np.union1d(X, np.linspace(0.0, L, link.elements + 1)).round(12)
    cuts = np.unique([start, *cuts[(cuts > start) & (cuts < end)], end])
    node, weight = np.polynomial.legendre.leggauss(5)
    points = [
        fa.Load(1, force * w * (b - a) / 2, station=a + (b - a) * (s + 1) / 2)
        for a, b in pairwise(cuts)
        for s, w in zip(node, weight, strict=True)
    ]
    spread = [fa.Load(1, force, spread=(start, end))]
    by_points, found = (
        arm.section_forces(q, 0 * q, 0 * q, STATIONS, loads=loads) for loads in (points, spread)
    )
    np.testing.assert_allclose(found, by_points, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_derivative_of_the_moment_is_the_shear_force(kind):
    """dM/dx = -V: differences of parabolas are exact at the middle."""
    load = fa.Load(1, (0.0, 2.0), spread=(0.0, L))
    arm = cantilever(kind, gravity=(0.0, -9.81))
    _, shear, moment = straight(arm, loads=[load], tip_force=(0.0, 5.0))
    slope = np.diff(moment) / np.diff(X)
    np.testing.assert_allclose(slope, -(shear[1:] + shear[:-1]) / 2, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "rigid"])
def test_moment_of_a_tip_force_is_curvature_times_rigidity(kind):
    """Cubic elements represent this bending exactly."""
    arm = cantilever(kind)
    force = 1e-6  # so small that the slope of segments has no effect on each other
    held = fa.equilibrium(arm, [0.0], tip_force=(0.0, force))
    moment = arm.section_forces(held.q, 0 * held.q, 0 * held.q, STATIONS, (0.0, force))[0, :, 2]
    for piece in arm.assembly.pieces:
        local = X - piece.start
        own = (local > -1e-9) & (local < piece.shapes.length * (1 - 1e-9))
        curvature = piece.shapes.curvature(np.maximum(local[own], 0.0)) @ held.q[piece.modal]
        # Newton's method ends at 1e-11 of the forces.
        np.testing.assert_allclose(EI * curvature, moment[own], rtol=0, atol=1e-10 * force * L)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("kind", KINDS)
def test_bent_link_balances_its_loads_in_the_deformed_position(kind, theory):
    """For any deflection, in the axes of the bent section: levers end on the bent axis."""
    arm = cantilever(kind, theory)
    q, rng = bent(arm), np.random.default_rng(3)
    forces = rng.normal(size=(3, 2))
    stations = (3, 7, 10)
    loads = [fa.Load(1, f, 0.2, station=X[k]) for f, k in zip(forces, stations, strict=True)]
    found = arm.section_forces(q, 0 * q, 0 * q, STATIONS, loads=loads)[0]
    axis = arm.shape(q, STATIONS)[0]
    angle = section_angles(arm, q)
    for k in range(STATIONS):
        beyond = [i for i in range(3) if stations[i] >= k]
        force = forces[beyond].sum(axis=0)
        arms = [axis[stations[i]] - axis[k] for i in beyond]
        moment = sum(
            r[0] * f[1] - r[1] * f[0] + 0.2 for r, f in zip(arms, forces[beyond], strict=True)
        )
        c, s = np.cos(angle[k]), np.sin(angle[k])
        exact = [c * force[0] + s * force[1], c * force[1] - s * force[0], moment]
        # The root's moment less that of inboard loads: ten terms.
        np.testing.assert_allclose(found[k], exact, rtol=0, atol=1e-13)


def bent(arm):
    """Return coordinates of a link with large bending."""
    rng, q = np.random.default_rng(3), arm.rest([0.4])
    for piece in arm.assembly.pieces:
        size = piece.shapes.w2.size
        q[piece.modal] = 0.5 * rng.normal(size=size) / np.sqrt(np.maximum(piece.shapes.w2, 1.0))
    return q


def section_angles(arm, q):
    """Return world angles (stations,) of the sections of a single link."""
    angles, root = np.zeros(STATIONS), q[0]
    for piece in arm.assembly.pieces:
        length, eta = piece.shapes.length, q[piece.modal]
        own = piece.start - 1e-9 < X if piece.start == 0.0 else piece.start + 1e-9 < X
        angles[own] = root
        if eta.size:
            local = np.minimum(X[own] - piece.start, length)
            angles[own] += piece.shapes.rotation(np.maximum(local, 0.0)) @ eta
            root += piece.shapes.dP @ eta
    return angles


@pytest.mark.parametrize("stations", [1, 0, -3, 2.0, "ten", True, 1001, None])
def test_wrong_numbers_of_stations_are_rejected(stations):
    arm = cantilever()
    zero = np.zeros(arm.dof)
    with pytest.raises(fa.InputError) as reported:
        arm.section_forces(zero, zero, zero, stations)
    assert str(reported.value).startswith(
        "Arm.section_forces: stations must be a whole number from 2 to 1000, got"
    )


def test_two_stations_are_root_and_tip():
    arm = cantilever()
    zero = np.zeros(arm.dof)
    few = arm.section_forces(zero, zero, zero, 2, (0.0, 1.0))
    many = arm.section_forces(zero, zero, zero, 31, (0.0, 1.0))
    again = arm.section_forces(zero, zero, zero, np.int64(2), (0.0, 1.0))
    assert few.shape == (1, 2, 3)
    np.testing.assert_array_equal(few, many[:, [0, -1]])
    np.testing.assert_array_equal(few, again)
