"""A hub radius against a massless rigid link with a fixed joint, and in the other descriptions."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.model.paths import number_at, with_number
from random_options import busy

#: The two descriptions compute the same sums in different order.
ROUNDING = 1e-11


def expanded(spec):
    """Return the arm with a massless rigid link and a fixed joint for every hub."""
    links, joints = [], []
    for link, joint in zip(spec.links, spec.joints, strict=True):
        if link.hub_radius:
            links.append(fa.Link(length=link.hub_radius, mass_per_length=0.0, flexible=False))
            joints.append(joint)
            joint = fa.Joint(fixed=True)
        links.append(link.replace(hub_radius=0.0))
        joints.append(joint)
    return fa.Arm(spec.replace(links=links, joints=joints))


def moved(spec, loads):
    """Return loads with the numbers of the links of ``expanded``."""
    numbers = np.cumsum([1 + bool(link.hub_radius) for link in spec.links])
    return [load.replace(link=int(numbers[load.link - 1])) for load in loads]


@pytest.mark.parametrize("seed", range(900, 916))
def test_same_as_a_massless_link_on_a_fixed_joint(seed):
    b = busy(seed, theory=["linear", "second_order"][seed % 2], reduced=seed % 3 == 0)
    one, two = b.arm, expanded(b.arm.spec)
    assert one.dof == two.dof
    acting = b.torque, b.tip_force
    found = one.forward_dynamics(b.q, b.qd, *acting, b.loads, b.base_acceleration)
    other = two.forward_dynamics(b.q, b.qd, *acting, moved(one.spec, b.loads), b.base_acceleration)
    M = two.mass_matrix(b.q)
    scale = np.sqrt(np.diag(M))
    limit = ROUNDING + 4 * np.finfo(float).eps * np.linalg.cond(M / np.outer(scale, scale))
    assert np.linalg.norm(scale * (found - other)) < limit * np.linalg.norm(scale * other)
    assert one.energy(b.q, b.qd).total == pytest.approx(two.energy(b.q, b.qd).total, rel=ROUNDING)
    assert np.allclose(one.mass_matrix(b.q), M, rtol=ROUNDING, atol=ROUNDING * np.abs(M).max())
    assert np.allclose(one.tip(b.q), two.tip(b.q), rtol=0, atol=ROUNDING)
    own = [k for k, link in enumerate(two.spec.links) if link.flexible or link.mass_per_length != 0]
    assert np.allclose(one.shape(b.q), two.shape(b.q)[own], rtol=0, atol=ROUNDING)


def test_some_arms_have_hubs_and_some_links_do_not():
    radii = [link.hub_radius for seed in range(900, 916) for link in busy(seed).arm.spec.links]
    assert any(radii)
    assert not all(radii)


@pytest.mark.thorough
def test_results_of_a_run():
    """Tip, strain, forces in the links and reactions, with a joint that carries the hub."""
    beam = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 3}
    gauge = fa.Gauge(station=0.0, distance=0.01)
    links = [
        fa.Link(length=0.8, hub_radius=0.1, gauges=[gauge], **beam),
        fa.Link(length=0.5, hub_radius=0.05, segments=3, **beam),
    ]
    joints = [fa.Joint(hub_inertia=0.02), fa.Joint(hub_inertia=0.01, mass=0.3)]
    spec = fa.Arm(links=links, joints=joints, gravity=(0.0, -9.81), theory="second_order").spec
    loads = [
        fa.Load(1, force=(0.0, 2.0), spread=(0.2, 0.7)),
        fa.Load(2, force=(1.0, 0.0), station=0.2),
    ]

    def run(arm, loads):
        return fa.simulate(
            arm, 0.2, torque=lambda t: [1.0, 0.2], initial=arm.rest([0.3, -0.5]), loads=loads,
            integrator="dormand_prince_8", rtol=1e-10, atol=1e-12, stations=5,
        )  # fmt: skip

    one, two = run(fa.Arm(spec), loads), run(expanded(spec), moved(spec, loads))
    own = [1, 3]  # places of the beams in the second description
    for name in ("joint_angle", "tip", "strain", "torque"):
        assert np.allclose(one[name], two[name], rtol=1e-7, atol=1e-8), name
    for name in ("axial_force", "shear_force", "bending_moment"):
        assert np.allclose(one[name], two[name].values[:, own], rtol=1e-6, atol=1e-6), name
    for name in ("joint_force", "joint_moment"):
        assert np.allclose(one[name], two[name].values[:, [0, 2]], rtol=1e-6, atol=1e-6), name


def test_a_rigid_arm_has_the_reach_of_its_hubs():
    links = [fa.Link(length=0.6, hub_radius=0.1, mass_per_length=1.0, flexible=False)] * 2
    arm = fa.Arm(links=links)
    assert arm.lengths == pytest.approx([0.7, 0.7])
    assert arm.tip(arm.rest([0.0, 0.0]))[0] == pytest.approx(1.4)
    angles = fa.inverse_kinematics(arm, (0.9, 0.3))
    assert arm.tip(arm.rest(angles))[:2] == pytest.approx((0.9, 0.3))


@pytest.mark.parametrize("path", ["links[1].hub_radius", "links[0].length", "links[1].length"])
def test_derivatives_of_the_constants(path):
    """The formulas that derivatives of runs use, against a central difference."""
    from flexarm.linear.step_derivatives.parameters import constants_at

    beam = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    links = [
        fa.Link(length=0.8, hub_radius=0.1, **beam),
        fa.Link(length=0.5, hub_radius=0.2, **beam),
    ]
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2, theory="second_order")
    for factor in (0.5, 2.0):
        value = factor * number_at("", arm.spec, path)
        exact = fa.Arm(with_number(arm.spec, path, value)).assembly.constants
        found, _ = constants_at(arm, {path: value}, float)
        for a, b in zip(found, exact, strict=True):
            assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max(initial=0.0))
