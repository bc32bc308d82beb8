"""The oracle of mechanisms against descriptions of the same mechanism in another way."""

import numpy as np
import pytest

from flexarm.model import ArmSpec, Base, Closure, Joint, Link, Payload, RayleighDamping

from .jets import Rate
from .mechanisms import MechanismOracle

THEORIES = ("linear", "second_order")
#: Rounding of results in float64, in which states and results are, times a few operations.
ROUNDING = 1e-12


def rod(length=1.0, **fields):
    """Return a flexible link."""
    beam = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "rotary_inertia_per_length": 1e-3}
    damping = RayleighDamping(stiffness_coefficient=1e-3)
    return Link(length=length, **{**beam, "elements": 1, "damping": damping, **fields})


def massless(**fields):
    """Return a rigid link without mass, for the root of another link."""
    return Link(length=1.0, mass_per_length=0.0, flexible=False, **fields)


def arbitrary(oracle, seed=1, bending=0.05):
    """Return coordinates, rates and torques."""
    rng = np.random.default_rng(seed)
    q, qd = rng.normal(size=(2, oracle.dof))
    for where in oracle.shape_slice:
        q[where] *= bending
        qd[where] *= bending
    return q, qd, rng.normal(size=len(oracle.joint_index))


def assert_close(found, exact):
    """Compare arrays by the largest component of the second."""
    found, exact = np.asarray(found), np.asarray(exact)
    np.testing.assert_allclose(found, exact, rtol=0, atol=ROUNDING * abs(exact).max(initial=1e-3))


@pytest.mark.parametrize("theory", THEORIES)
def test_free_base_equals_massless_links_on_slides(theory):
    """x, y and angle of the base are two sliding joints and one that turns."""
    joint = Joint(rotor_inertia=1e-3, gear_ratio=20.0, mass=0.3, housing_inertia=0.02)
    body = {"payload": Payload(mass=0.4, offset=(0.1, 0.05)), "gravity": (1.0, -9.0)}
    body["theory"] = theory
    base = Base(
        mass=2.0,
        inertia=0.3,
        centre=(0.2, -0.1),
        free=("angle", "x", "y"),
        stiffness=(30.0, 0.0, 5.0),
        damping=(0.5, 0.2, 0.1),
    )
    floating = MechanismOracle(
        ArmSpec(links=[rod(), rod(0.7)], joints=[joint, joint], base=base, **body)
    )
    # The centre of mass of the base is the payload of a link that no other is on.
    slides = [
        Joint(kind="prismatic", axis=(2.0, 0.0), stiffness=30.0, damping=0.5),
        Joint(kind="prismatic", axis=(0.0, 1.0), damping=0.2),
        Joint(stiffness=5.0, damping=0.1, hub_inertia=0.3),
    ]
    centre = Link(length=0.2, mass_per_length=0.0, flexible=False, parent=3, parent_station=0.0)
    carried = Link(length=0.5, mass_per_length=0.0, flexible=False, parent_station=0.0, parent=4)
    held = Joint(fixed=True, offset=(0.2, -0.1), mounting_angle=0.3)
    weight = Joint(fixed=True, mass=2.0)
    stations = {"parent_station": 0.0}
    links = [
        *(massless(), massless(**stations), massless(**stations), centre, carried),
        *(rod(parent=3, **stations), rod(0.7)),
    ]
    jointed = MechanismOracle(
        ArmSpec(links=links, joints=[*slides, held, weight, joint, joint], **body)
    )
    q, qd, torque = arbitrary(floating)
    exact = floating.at(q, qd, torque)
    found = jointed.at(q, qd, np.append(np.zeros(3), torque))
    assert_close(found.mass, exact.mass)
    assert_close(found.acceleration, exact.acceleration)
    energies = [[r.kinetic, r.strain, r.gravity] for r in (found, exact)]
    assert_close(*energies)
    assert_close(found.tips[-2:], exact.tips)
    assert_close(found.momentum, exact.momentum)


def in_two(theory, kind):
    """Return the oracle of an arm, and that of the arm cut at the root of its last link.

    The part that is cut off hangs on slides of the base, and a closure takes it to its place.
    """
    inner, angle, offset = [rod(), rod(0.7, hub_radius=0.1)], 0.4, (0.03, -0.05)
    general = {"theory": theory, "gravity": (1.0, -9.0), "payload": Payload(mass=0.3, inertia=0.02)}
    # The last joint: it turns about a point on the second link, or about one that slides on it.
    guides = [massless()] if kind == "line" else []
    axis = (np.cos(angle), np.sin(angle))
    slide = Joint(kind="prismatic", axis=axis, offset=offset)
    joints = [slide, Joint()] if kind == "line" else [Joint(offset=offset)]
    last = rod(0.8, **({"parent_station": 0.0} if kind == "line" else {}))
    whole = ArmSpec(
        links=[*inner, *guides, last], joints=[Joint(damping=0.1), Joint(), *joints], **general
    )
    slides = [Joint(kind="prismatic", axis=axis) for axis in ((1.0, 0.0), (0.0, 1.0))]
    free = [massless(parent=0), massless(parent_station=0.0), rod(0.8, parent_station=0.0)]
    closure = Closure(link=5, station=0.0, to_link=2, to_offset=offset, kind=kind, angle=angle)
    cut = ArmSpec(
        links=[*inner, *free],
        joints=[Joint(damping=0.1), Joint(), *slides, Joint()],
        closures=[closure],
        **general,
    )
    return MechanismOracle(whole), MechanismOracle(cut)


@pytest.mark.parametrize("kind", ["pin", "weld", "line"])
@pytest.mark.parametrize("theory", THEORIES)
def test_closure_equals_the_joint_that_it_stands_for(theory, kind):
    """Accelerations, and forces of the closure as reactions of the joint."""
    whole, cut = in_two(theory, kind)
    q, qd, torque = arbitrary(whole)
    joint, given = len(whole.spec.links), {}
    torque[2:] = 0.0
    if kind == "weld":
        q[whole.angle_of[2]], qd[whole.angle_of[2]], given = 0.4, 0.0, {3: 0.0}
    (x, y), angle = whole._energies(Rate(q, qd)).roots[-1]
    inner, outer = whole.angle_of[2], whole.shape_slice[-1]
    place = {"value": [x.value, y.value, angle.value], "rate": [x.rate, y.rate, angle.rate]}
    state = [
        np.concatenate([v[:inner], place[name], v[outer]])
        for v, name in ((q, "value"), (qd, "rate"))
    ]
    exact = whole.moving(q, qd, torque, given=given)
    found = cut.at(*state, np.append(torque[:2], np.zeros(3)))
    assert_close(found.gap, np.zeros(len(found.gap)))
    assert_close(found.gap_jacobian @ state[1], np.zeros(len(found.gap)))
    kept = [*range(inner), *range(inner + 3, cut.dof)]
    same = [*range(inner), *range(outer.start, outer.stop)]
    assert_close(found.acceleration[kept], exact.acceleration[same])
    reaction = exact.joint_force[joint - 1]
    if kind == "line":
        turned = whole.tips(q)[1, 2] + 0.4
        reaction = [reaction @ [-np.sin(turned), np.cos(turned)]]
    elif kind == "weld":
        reaction = [*reaction, exact.torque[2]]
    assert_close(found.closure_force, reaction)
