"""A link in segments: the same link for small motions, and a chain of links for large ones."""

from contextlib import nullcontext

import numpy as np
import pytest

import flexarm as fa

# Links bend further than their theory allows, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

TAPERED = {
    "table": {
        "x": [0.0, 0.37, 1.2],
        "flexural_rigidity": [30.0, 20.0, 8.0],
        "mass_per_length": [0.6, 0.5, 0.3],
        "rotary_inertia_per_length": [1e-3, 5e-4, 2e-4],
    }
}
UNIFORM = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
SOFT = {"flexural_rigidity": 1.0, "mass_per_length": 0.5}
THEORIES = ("linear", "second_order")


def arm(segments, theory="linear", description=TAPERED, **fields):
    """Return two links with all options at their ends, the first one in segments."""
    first = fa.Link(length=1.2, elements=8, segments=segments, **description, **fields)
    return fa.Arm(
        links=[first, fa.Link(length=0.8, elements=2, **UNIFORM)],
        joints=[fa.Joint(hub_inertia=0.02), fa.Joint(mass=0.4, housing_inertia=0.01)],
        payload=fa.Payload(mass=0.3, inertia=0.002, offset=(0.05, 0.02)),
        theory=theory,
    )


def whole_shape(of, nodal):
    """Return deflection and slope at the first link's nodes, relative to the link's root tangent.

    To first order in the bending, from values relative to the root of each segment.
    """
    link = of.spec.links[0]
    per = link.elements // link.segments
    h = link.length / link.elements
    deflection, slope, seen = 0.0, 0.0, []
    for k in range(link.segments):
        own = nodal[k * per : (k + 1) * per]
        x = h * np.arange(1, per + 1)
        seen.append(np.stack([deflection + slope * x + own[:, 0], slope + own[:, 1]], axis=1))
        deflection, slope = seen[-1][-1]
    return np.concatenate(seen)


@pytest.mark.parametrize("theory", THEORIES)
@pytest.mark.parametrize("segments", [2, 4, 8])
@pytest.mark.parametrize("joints", ["locked", "free"])
def test_segments_do_not_change_small_vibrations(segments, theory, joints):
    """At straight links both have the same shapes: cubic on each element, smooth at the nodes."""
    whole = fa.modes(arm(1, theory), [0.3, -0.8], joints)
    cut = fa.modes(arm(segments, theory), [0.3, -0.8], joints)
    # Frequencies of the stiffest modes are accurate to 1e-9 in both.
    np.testing.assert_allclose(cut.frequency_hz, whole.frequency_hz, rtol=1e-7, atol=1e-4)
    np.testing.assert_allclose(cut.frequency_hz[2:6], whole.frequency_hz[2:6], rtol=1e-9)


@pytest.mark.parametrize("segments", [2, 4, 8])
def test_segments_do_not_change_small_static_bending(segments):
    """In the limit of small loads, here 1e-5 of a visible deflection."""
    loads = [fa.Load(1, (0.0, -3e-5), 2e-5, station=0.5), fa.Load(2, (1e-5, 2e-5))]
    whole, cut = arm(1), arm(segments)
    wanted = whole.nodal(fa.equilibrium(whole, loads=loads).q)[0]
    found = whole_shape(cut, cut.nodal(fa.equilibrium(cut, loads=loads).q)[0])
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


@pytest.mark.parametrize("segments", [2, 4, 8])
def test_segments_do_not_change_rigid_motion(segments):
    """Energies, tip and inertia of straight links."""
    whole, cut = arm(1), arm(segments)
    angles, rates = [0.4, 1.1], [2.0, -3.0]
    one, other = (of.energy(of.rest(angles), of.rest(rates)).kinetic for of in (whole, cut))
    assert other == pytest.approx(one, rel=1e-13)
    np.testing.assert_allclose(cut.tip(cut.rest(angles)), whole.tip(whole.rest(angles)), rtol=1e-14)
    M, N = (of.mass_matrix(of.rest(angles)) for of in (whole, cut))
    i, j = whole.joint_index, cut.joint_index
    np.testing.assert_allclose(N[np.ix_(j, j)], M[np.ix_(i, i)], rtol=1e-13)


def far(theory):
    """Return a context that expects the bending warning of the linear theory."""
    return pytest.warns(fa.LargeDeflectionWarning) if theory == "linear" else nullcontext()


@pytest.mark.parametrize("theory", THEORIES)
def test_large_motion_conserves_energy(theory):
    """The ends of a soft link in eight segments turn by half a right angle."""
    of = arm(8, theory, SOFT)
    rates = of.rest([8.0, -20.0])
    result = fa.simulate(of, 0.5, initial_rate=rates, rate=500, rtol=1e-9, atol=1e-11)
    energy = (result.kinetic_energy + result.strain_energy).values
    assert abs(result.link_tip_slope.values[:, 0]).max() > 0.5
    # A tolerance of 1e-9 a step.
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


@pytest.mark.parametrize("theory", THEORIES)
def test_work_of_the_torques_is_the_change_of_energy(theory):
    """Torques act on the relative joint rates, which contain the tip slope of the whole link
    before."""
    of = arm(4, theory)

    def torque(t):
        return [3.0 * np.sin(6 * t), -1.5 * np.cos(5 * t)]

    result = fa.simulate(of, 0.5, torque=torque, rate=4000, rtol=1e-9, atol=1e-11)
    power = np.sum(result.torque.values * result.joint_rate.values, axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 / 4000)])
    energy = (result.kinetic_energy + result.strain_energy).values
    assert energy.max() > 0.5
    # The trapezoidal rule at 4 kHz.
    np.testing.assert_allclose(energy, work, rtol=0, atol=2e-4 * energy.max())


@pytest.mark.parametrize("theory", THEORIES)
def test_segments_converge_to_one_motion(theory):
    """Linear segments with second order, second-order segments with third, over a large motion."""
    tips = []
    for segments in (2, 4, 8):
        link = fa.Link(length=1.0, elements=16, segments=segments, modes=2, **SOFT)
        of = fa.Arm(links=[link], payload=fa.Payload(mass=0.2), theory=theory)
        with far(theory) if segments == 2 else nullcontext():
            result = fa.simulate(of, 0.4, torque=lambda t: [0.5], rate=50, rtol=1e-8, atol=1e-10)
        tips.append(result.tip.values)
    assert abs(result.link_tip_slope.values).max() > 0.2
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=(1, 2))
    order = {"linear": 2, "second_order": 3}[theory]
    # With more segments the modes that two per segment omit dominate; their effect has second
    # order.
    assert np.log2(steps[0] / steps[1]) == pytest.approx(order, abs=0.5)


@pytest.mark.parametrize("theory", THEORIES)
@pytest.mark.parametrize("segments", [2, 8])
def test_axis_is_smooth_across_segments(segments, theory):
    of = arm(segments, theory)
    rng = np.random.default_rng(1)
    q = of.rest([0.5, -0.4])
    for piece in of.assembly.pieces:
        q[piece.modal] = 0.1 * rng.normal(size=piece.shapes.w2.size) / np.sqrt(piece.shapes.w2)
    axis = of.shape(q, 2401)[0]
    step = np.diff(axis, axis=0)
    length = np.linalg.norm(step, axis=1)
    np.testing.assert_allclose(length, 1.2 / 2400, rtol=0.1)  # no gap, no overlap
    turn = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
    # Curvature times half a millimetre: the slope is continuous.
    assert abs(turn).max() < 0.01
    first, second = of.shape(q, 2)
    np.testing.assert_allclose(first[1], second[0], atol=1e-14)
    np.testing.assert_allclose(second[1], of.tip(q)[:2], atol=1e-14)


@pytest.mark.parametrize("theory", THEORIES)
def test_tip_deflection_and_slope_of_a_bent_link(theory):
    """Of the whole link relative to its root tangent, with exact rates."""
    gauge = fa.Gauge(station=0.0, distance=0.01)
    of = arm(4, theory, gauges=(gauge, gauge.replace(station=0.7)))
    whole = arm(1, theory, gauges=(gauge, gauge.replace(station=0.7)))

    def torque(t):
        return [0.3 * (1 - np.cos(20 * t)), 0.1 * (np.cos(13 * t) - 1)]

    found = fa.simulate(of, 0.2, torque=torque, rate=2000)
    wanted = fa.simulate(whole, 0.2, torque=torque, rate=2000)
    for name in ("link_tip_deflection", "link_tip_slope", "link_angle", "tip", "strain"):
        size = abs(wanted[name].values).max()
        # They differ by the square of slopes of a hundredth.
        np.testing.assert_allclose(found[name].values, wanted[name].values, atol=5e-3 * size)
    for name in ("link_tip_deflection", "link_tip_slope"):
        rate = np.gradient(found[name].values, found.time.values, axis=0, edge_order=2)
        exact = found[f"{name}_rate"].values
        # Differences at 2 kHz.
        np.testing.assert_allclose(rate[5:-5], exact[5:-5], atol=5e-3 * abs(exact).max())


def test_coordinates_name_the_segments():
    result = fa.simulate(arm(2, modes=2), 0.01, rate=100)
    assert list(result.coordinate.values) == [
        "joint_1",
        "link_1_segment_1_mode_1",
        "link_1_segment_1_mode_2",
        "link_1_segment_2_mode_1",
        "link_1_segment_2_mode_2",
        "joint_2",
        *(f"link_2_mode_{k}" for k in range(1, 5)),
    ]


def test_nodal_values_are_converted_and_back():
    of = arm(4)
    rng = np.random.default_rng(3)
    nodal = [0.01 * rng.normal(size=(link.elements, 2)) for link in of.spec.links]
    q = of.from_nodal([0.2, 0.4], nodal)
    np.testing.assert_allclose(of.joint_angles(q), [0.2, 0.4])
    for found, given in zip(of.nodal(q), nodal, strict=True):
        np.testing.assert_allclose(found, given, atol=1e-12)


def test_counts_and_the_rigid_model():
    of = arm(4, modes=3)
    assert of.dof == 2 + 4 * 3 + 4
    assert of.spec.links[0].coordinates == 12
    assert list(of.joint_index) == [0, 13]
    rigid = of.rigid()
    assert rigid.dof == 2
    rates = [1.0, 2.0]
    kinetic = of.energy(of.rest([0.1, 0.2]), of.rest(rates)).kinetic
    assert rigid.energy([0.1, 0.2], rates).kinetic == pytest.approx(kinetic, rel=1e-13)


@pytest.mark.parametrize("modes", [1, 2, 3, None])
@pytest.mark.parametrize("station", [0.2, 0.5])
def test_a_link_that_carries_another_one_is_not_stiffer(modes, station):
    """Static deflection of a cantilever under a force, with a light rod at a station."""
    beam = {"flexural_rigidity": 100.0, "mass_per_length": 1.0, "elements": 2, "modes": modes}
    rod = {"length": 0.1, "mass_per_length": 1e-6, "flexible": False}
    links = [fa.Link(length=1.0, **beam), fa.Link(**rod, parent=1, parent_station=station)]
    arm = fa.Arm(links=links)
    q = fa.equilibrium(arm, [0.0, 0.0], loads=[fa.Load(link=1, force=(0.0, 1.0))]).q
    tip = fa.simulate(arm, 1e-4, initial=q).link_tip_deflection.values[0, 0]
    # Exact statics of cubic elements; turned links shorten by squares of the slope of 5e-3.
    assert tip == pytest.approx(1.0 / 300.0, rel=2e-5)


def test_one_mode_in_each_segment_is_refused():
    beam = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 1.0, "elements": 4}
    with pytest.raises(fa.ModelError, match=r"at least 2 with segments.*moves 19% too little"):
        fa.Link(**beam, segments=4, modes=1)
