"""The oracle of mechanisms against descriptions of the same mechanism in another way."""

import copy

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

import flexarm as fa
from arm_states import drawn
from closed_mechanisms import CLOSED
from flexarm.model import ArmSpec, Base, Closure, Joint, Link, Payload, RayleighDamping
from random_mechanisms import random_mechanism, random_motion

from .jets import Rate
from .joint_laws import joint_loss
from .lagrangian import LagrangianOracle
from .mechanisms import MechanismOracle, oracle_of

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
    turned = {} if kind == "pin" else {"angle": angle}
    closure = Closure(link=5, station=0.0, to_link=2, to_offset=offset, kind=kind, **turned)
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


def in_motion(seed, closures, **more):
    """Return the oracle of a random mechanism, and its state: (oracle, q, qd, torque)."""
    spec = ArmSpec(**{**random_mechanism(seed, closures=closures), **more})
    oracle = MechanismOracle(spec)
    return oracle, *random_motion(np.random.default_rng(seed), oracle)


@pytest.mark.sampled("1", "2", "4")
@pytest.mark.parametrize("closures", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("seed", range(10))
def test_power_balance(seed, closures):
    """dE/dt = torque . joint rate - dissipation + closure force . rate of the gap."""
    oracle, q, qd, torque = in_motion(seed, closures)
    found = oracle.at(q, qd, torque)
    terms = [torque @ qd[oracle.joint_index], -qd @ oracle.damping @ qd]
    terms += [found.closure_force @ (found.gap_jacobian @ qd)]
    terms += [
        joint_loss(oracle.spec.joints[i], q[at], qd[at]) * qd[at]
        for i, at in oracle.angle_of.items()
    ]
    # The accelerations are rounded to float64; inertia multiplies the error. Rates are those of
    # bodies that fall.
    rounding = 1e-14 * abs(qd) @ abs(found.mass) @ abs(found.acceleration)
    power = oracle.power(q, qd, found.acceleration)
    scale = max(map(abs, terms))
    np.testing.assert_allclose(power, sum(terms), rtol=0, atol=1e-12 * scale + rounding)


@pytest.mark.sampled("1", "2", "4")
@pytest.mark.parametrize("closures", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("seed", range(10))
def test_equations_of_motion_and_of_closures(seed, closures):
    """The mass matrix is positive definite and gives the kinetic energy; gaps accelerate to zero.

    The Jacobian and the velocity products are differences of the gaps.
    """
    oracle, q, qd, torque = in_motion(seed, closures)
    found = oracle.at(q, qd, torque)
    np.linalg.cholesky(found.mass)  # raises unless positive definite
    np.testing.assert_allclose(qd @ found.mass @ qd / 2, found.kinetic, rtol=1e-11)
    force = -oracle.bias_force(q, qd) + found.closure_force @ found.gap_jacobian
    force[oracle.joint_index] += torque
    # Rounding of forces in balance.
    terms = abs(found.mass) @ abs(found.acceleration) + abs(force)
    assert (abs(found.mass @ found.acceleration - force) < 1e-13 * terms.max()).all()
    remaining = found.gap_jacobian @ found.acceleration + found.gap_bias
    sizes = abs(found.gap_jacobian) @ abs(found.acceleration) + abs(found.gap_bias)
    assert (abs(remaining) <= 1e-14 * sizes).all()
    np.testing.assert_allclose(found.gap_jacobian, oracle.gap_jacobian(q), rtol=1e-13, atol=1e-15)
    if not closures:
        return
    step = 1e-3 / abs(qd).max()
    ahead, behind, far, back = (oracle.gaps(q + k * step * qd) for k in (1, -1, 2, -2))
    slope = (8 * (ahead - behind) - (far - back)) / (12 * step)
    curvature = (16 * (ahead + behind) - (far + back) - 30 * found.gap) / (12 * step**2)
    # Differences of fourth order; rounding of gaps, by step and step^2.
    size = abs(found.gap).max() + abs(found.gap_jacobian @ qd).max() / abs(qd).max()
    atol = 1e-9 * size / step
    np.testing.assert_allclose(slope, found.gap_jacobian @ qd, rtol=0, atol=atol)
    np.testing.assert_allclose(curvature, found.gap_bias, rtol=0, atol=atol / step)


@pytest.mark.sampled("1", "2", "3")
@pytest.mark.parametrize("closures", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("seed", range(6))
def test_momentum_of_a_free_mechanism_is_constant(seed, closures):
    """Closures between links close at zero coordinates; a gap would turn the mechanism."""
    fields = random_mechanism(seed, closures=closures)
    base = Base(mass=1.0, inertia=0.2, centre=(0.1, 0.05), free=("x", "y", "angle"))
    ties = [
        tie.replace(to_link=0) if tie.to_link is None else tie for tie in fields.get("closures", ())
    ]
    oracle = MechanismOracle(
        ArmSpec(**{**fields, "base": base, "gravity": (0.0, 0.0), "closures": ties})
    )
    q, qd, torque = random_motion(np.random.default_rng(seed), oracle)
    q *= not closures
    found = oracle.at(q, qd, torque)
    rate = oracle.momentum_rate(q, qd, found.acceleration)
    rows = oracle.mass_matrix(q)[:3]  # force and moment on the origin of the base
    moved = np.array([0.0, 0.0, abs(q[0]) + abs(q[1])])
    terms = abs(rows) @ abs(found.acceleration)
    terms += moved * terms[:2].sum() + abs(found.closure_force).sum()
    assert (abs(rate) < 1e-13 * terms).all()


def test_momentum_changes_by_gravity():
    oracle, q, qd, torque = in_motion(
        3, False, base=Base(mass=2.0, free=("x", "y", "angle")), gravity=(1.0, -9.0)
    )
    mass = oracle.mass_matrix(q)[0, 0]
    rate = oracle.momentum_rate(q, qd, oracle.acceleration(q, qd, torque))
    np.testing.assert_allclose(rate[:2], mass * np.array([1.0, -9.0]), rtol=1e-9)
    speed = np.zeros(oracle.dof)
    speed[:2] = 3.0, 2.0
    np.testing.assert_allclose(oracle.momentum(q, speed)[:2], mass * speed[:2], rtol=1e-13)


@pytest.mark.parametrize("theory", THEORIES)
def test_default_parents_are_those_of_a_serial_arm(theory):
    """The tip as a station, and a base and closures that have no effect."""
    joints = [Joint(rotor_inertia=1e-3, stiffness=40.0), Joint(mass=0.3, housing_inertia=0.02)]
    fields = {"joints": [*joints, joints[0]], "gravity": (1.0, -9.0), "theory": theory}
    serial = LagrangianOracle(ArmSpec(links=[rod(), rod(0.7), rod(0.4)], **fields))
    links = [rod(parent=0), rod(0.7, parent=1, parent_station=1.0), rod(0.4, parent=2)]
    base = Base(mass=3.0, inertia=1.0, centre=(1.0, 2.0))
    tree = MechanismOracle(ArmSpec(links=links, base=base, **fields))
    q, qd, torque = arbitrary(serial)
    exact, found = serial.acceleration(q, qd, torque), tree.at(q, qd, torque)
    np.testing.assert_array_equal(found.acceleration, exact)
    np.testing.assert_array_equal(found.mass, serial.mass_matrix(q))
    np.testing.assert_array_equal(
        [found.kinetic, found.strain, found.gravity], serial.energy(q, qd)
    )
    np.testing.assert_array_equal(found.tips[-1], serial.tip(q))


@pytest.mark.parametrize("flexible", [True, False])
@pytest.mark.parametrize("theory", THEORIES)
def test_station_of_a_parent_divides_it(theory, flexible):
    """A branch on a link equals a branch on the end of the first of two links on a fixed joint."""
    fields = {"gravity": (1.0, -9.0), "theory": theory}
    branch, held = rod(0.5, parent=1), Joint(fixed=True)
    motor = Joint(mass=0.2, housing_inertia=0.01)
    divided = MechanismOracle(
        ArmSpec(
            links=[
                rod(0.9, elements=3, hub_radius=0.1, flexible=flexible),
                branch.replace(parent_station=0.3),
            ],
            joints=[Joint(), motor],
            **fields,
        )
    )
    bent = {"flexible": flexible}
    links = [rod(0.3, hub_radius=0.1, **bent), rod(0.6, elements=2, **bent), branch]
    joined = MechanismOracle(ArmSpec(links=links, joints=[Joint(), held, motor], **fields))
    assert [piece.link.elements for piece in divided.pieces] == [1, 2, 1]
    q, qd, torque = arbitrary(joined)
    exact, found = joined.at(q, qd, torque), divided.at(q, qd, torque)
    assert_close(found.acceleration, exact.acceleration)
    assert_close(found.mass, exact.mass)
    assert_close(found.tips, exact.tips[1:])
    assert_close(
        [found.kinetic, found.strain, found.gravity], [exact.kinetic, exact.strain, exact.gravity]
    )


@pytest.mark.sampled("1", "2", "3")
@pytest.mark.parametrize("seed", range(8))
def test_forces_of_closures_are_loads_on_the_open_mechanism(seed):
    """At any gap: the force on the second point of a line acts at the place of the first."""
    fields = random_mechanism(seed, closures=True)
    fields["closures"] = [
        tie.replace(to_link=None) if tie.to_link == 0 else tie for tie in fields["closures"]
    ]
    oracle = MechanismOracle(ArmSpec(**fields))
    q, qd, torque = random_motion(np.random.default_rng(seed), oracle)
    found = oracle.at(q, qd, torque)
    loads, remaining = [], list(found.closure_force)
    for tie in oracle.spec.closures:
        first, second = oracle.points_of(tie, q)
        size = {"pin": 2, "weld": 3, "line": 1}[tie.kind]
        force, remaining = np.array([*remaining[:size], 0.0, 0.0]), remaining[size:]
        if tie.kind == "line":
            force = np.append(turned(second[2] + tie.angle, (0.0, force[0])), 0.0)
        bare = tie.replace(offset=(0.0, 0.0), to_offset=(0.0, 0.0))
        sections = oracle.points_of(bare, q)
        acting = [first, first if tie.kind == "line" else second]
        for k, (link, station) in enumerate(
            [(tie.link, tie.station), (tie.to_link, tie.to_station)]
        ):
            arm = acting[k] - sections[k]
            moment = arm[0] * force[1] - arm[1] * force[0] + force[2]
            if link is not None:
                push = (-1.0 if k else 1.0) * np.array([*force[:2], moment])
                loads.append(fa.Load(link=link, station=station, force=push[:2], moment=push[2]))
    opened = copy.copy(oracle)  # with the same division of the links
    opened.spec = oracle.spec.replace(closures=[])
    exact = opened.moving(q, qd, torque, loads=loads)
    scale = np.sqrt(np.diag(found.mass))
    error = scale * (found.acceleration - exact.acceleration)
    # Loads are numbers in float64, and are weighted by the condition number.
    assert np.linalg.norm(error) < 1e-9 * np.linalg.norm(scale * exact.acceleration)
    closed = oracle.moving(q, qd, torque)
    np.testing.assert_allclose(closed.closure_force, found.closure_force, rtol=1e-11)
    size = abs(exact.joint_force).max()
    np.testing.assert_allclose(closed.joint_force, exact.joint_force, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "three_rrr", "cylinder_boom"])
def test_momentum_changes_by_reactions_on_the_ground(name):
    """The sum of the reactions of all joints on the ground and of the weight."""
    case = CLOSED[name](gravity=(1.0, -9.0))
    oracle = MechanismOracle(case.spec)
    q, qd, torque = arbitrary(oracle)
    found = oracle.moving(q, qd, torque)
    grounded = [piece.owner for piece in oracle.pieces if piece.joint and piece.seat.piece is None]
    weight = sum(np.sum(points.mass) for points in oracle.points) * np.array([1.0, -9.0])
    forces = found.joint_force[grounded].sum(axis=0) + weight.astype(float)
    rate = oracle.momentum_rate(q, qd, found.acceleration)[:2]
    np.testing.assert_allclose(rate, forces, rtol=0, atol=1e-11 * abs(found.joint_force).max())


@pytest.mark.parametrize("theory", THEORIES)
def test_prescribed_crank_of_a_four_bar(theory):
    """The torque that a prescribed acceleration requires produces it."""
    case = CLOSED["four_bar"](theory=theory)
    oracle = MechanismOracle(case.spec)
    q, qd, torque = arbitrary(oracle)
    driven = oracle.moving(q, qd, torque, given={1: 3.0})
    assert driven.acceleration[0] == 3.0
    free = oracle.at(q, qd, driven.torque)
    assert_close(free.acceleration, driven.acceleration)
    assert_close(free.closure_force, driven.closure_force)


def test_acceleration_of_the_base_acts_like_gravity():
    """On both arms of a fixed base; its velocity has no effect."""
    case, shaken = CLOSED["five_bar"](), np.array([2.0, -3.0])
    bare = MechanismOracle(ArmSpec(**{**case.fields, "closures": []}))
    pulled = MechanismOracle(bare.spec.replace(gravity=tuple((-shaken).tolist())))
    q, qd, torque = arbitrary(bare)
    found = bare.moving(q, qd, torque, base_velocity=(5.0, 7.0), base_acceleration=shaken)
    exact = pulled.moving(q, qd, torque)
    assert_close(found.acceleration, exact.acceleration)
    assert_close(found.joint_force, exact.joint_force)


def test_oracle_of_an_arm_has_its_coordinates():
    d = drawn(5, links=2, reduced=True, theory="second_order")
    found = oracle_of(d.arm).at(d.q, d.qd, d.torque)
    exact = d.arm.forward_dynamics(d.q, d.qd, d.torque)
    scale = np.sqrt(np.diag(found.mass))
    error = scale * (found.acceleration - exact)
    assert np.linalg.norm(error) < 1e-10 * np.linalg.norm(scale * exact)
    np.testing.assert_allclose(found.tips[-1], d.arm.tip(d.q), atol=1e-13)
    assert found.momentum.shape == (3,)


def turned(angle, vector):
    """Return a vector turned by an angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def test_places_of_branches():
    """At the root, behind an elastic joint and a hub; at the tip, on a slide; on the base."""
    slide = {"kind": "prismatic", "axis": (3.0, 4.0), "offset": (0.1, 0.2), "mounting_angle": 0.5}
    joints = [
        Joint(rotor_inertia=0.1, stiffness=5.0, offset=(0.2, 0.1), mounting_angle=-0.3),
        Joint(offset=(0.05, -0.02)),
        Joint(**slide),
        Joint(fixed=True, rest_angle=0.7, mounting_angle=0.2),
    ]
    links = [
        rod(1.0, hub_radius=0.15),
        rod(0.5, parent=1, parent_station=0.0),
        rod(0.4, parent=1),
        rod(0.3, parent=0, hub_radius=0.1),
    ]
    base = Base(mass=1.0, inertia=1.0, free=("x", "y", "angle"))
    oracle = MechanismOracle(ArmSpec(links=links, joints=joints, base=base))
    x, y, psi, motor, twist, second, position, bent, slope = (
        *(0.3, -0.4, 0.6, 0.5, 0.1, -0.8, 0.25, 0.04, 0.07),
    )
    q = np.zeros(oracle.dof)
    q[:7] = x, y, psi, motor, twist, bent, slope
    q[oracle.angle_of[1]], q[oracle.angle_of[2]] = second, position
    first = psi - 0.3 + motor + twist
    root = np.array([x, y]) + turned(psi, (0.2, 0.1)) + turned(first, (0.15, 0.0))
    tip = root + turned(first, (1.0, bent))
    on_root = root + turned(first, (0.05, -0.02)) + turned(first + second, (0.5, 0.0))
    end = first + slope
    sliding = tip + turned(end, (0.1 + 0.6 * position, 0.2 + 0.8 * position))
    on_tip = sliding + turned(end + 0.5, (0.4, 0.0))
    on_base = np.array([x, y]) + turned(psi + 0.9, (0.4, 0.0))
    exact = [
        [*tip, end], [*on_root, first + second], [*on_tip, end + 0.5], [*on_base, psi + 0.9]
    ]  # fmt: skip
    np.testing.assert_allclose(oracle.tips(q), exact, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_rotor_housing_and_mass_ride_on_the_section_of_the_parent(kind):
    """On a branch of a free base: what each of them adds to the kinetic energy."""

    def oracle(**fields):
        axis = {"axis": (1.0, 2.0)} if kind == "prismatic" else {}
        joints = [Joint(), Joint(kind=kind, offset=(0.1, 0.3), **axis, **fields)]
        base = Base(mass=2.0, inertia=0.1, free=("x", "y", "angle"))
        return MechanismOracle(ArmSpec(links=[rod(), rod(0.5)], joints=joints, base=base))

    plain = oracle()
    q, qd, _ = arbitrary(plain)
    step = 1e-5  # central differences of fourth order: truncation and rounding are below 1e-10
    ahead, behind, far, back = (plain.tips(q + k * step * qd)[0] for k in (1, -1, 2, -2))
    vx, vy, rate = (8 * (ahead - behind) - (far - back)) / (12 * step)
    joint_rate = qd[plain.angle_of[1]]
    added = {
        "mass": 0.7 * (vx**2 + vy**2) / 2,
        "housing_inertia": 0.7 * rate**2 / 2,
        "rotor_inertia": 0.7 * (rate + 30.0 * joint_rate) ** 2 / 2,
        "hub_inertia": 0.7 * (rate + joint_rate * (kind == "revolute")) ** 2 / 2,
    }
    for name, energy in added.items():
        ratio = {"gear_ratio": 30.0} if name == "rotor_inertia" else {}
        found = oracle(**{name: 0.7}, **ratio).energy(q, qd)[0] - plain.energy(q, qd)[0]
        np.testing.assert_allclose(found, energy, rtol=1e-8)


@pytest.mark.thorough
def test_cooperating_arms_keep_energy_and_momentum():
    """Rigid arms on a free base in motion, for half a second without gravity."""
    case = CLOSED["cooperating_arms"]()
    links = [link.replace(flexible=False) for link in case.fields["links"]]
    oracle = MechanismOracle(ArmSpec(**{**case.fields, "links": links}), precision=np.float64)
    n = oracle.dof
    start = np.zeros(2 * n)
    start[oracle.joint_index] = case.joints
    rates = scipy.linalg.null_space(oracle.gap_jacobian(start[:n]))
    start[n:] = rates @ np.array([1.0, -2.0, 1.5, 2.5])

    def rate(t, y):
        return np.concatenate([y[n:], oracle.acceleration(y[:n], y[n:], np.zeros(4))])

    end = solve_ivp(rate, (0, 0.5), start, "DOP853", rtol=1e-9, atol=1e-11).y[:, -1]
    states = [(y[:n], y[n:]) for y in (start, end)]
    assert abs(states[1][0] - states[0][0]).max() > 0.3  # it has moved
    energies = [oracle.energy(*state)[0] for state in states]
    # A hundred times the tolerance of the steps.
    np.testing.assert_allclose(energies[1], energies[0], rtol=1e-7)
    np.testing.assert_allclose(oracle.momentum(*states[1]), oracle.momentum(*states[0]), atol=1e-7)
    np.testing.assert_allclose(oracle.gaps(states[1][0]), 0.0, atol=1e-7)


def test_random_mechanisms_have_every_option_on_and_off():
    mechanisms = [random_mechanism(seed) for seed in range(80)]
    links = [link for fields in mechanisms for link in fields["links"]]
    joints = [joint for fields in mechanisms for joint in fields["joints"]]
    bases = [fields.get("base") for fields in mechanisms]
    assert {len(fields["links"]) for fields in mechanisms} == {2, 3, 4, 5, 6}
    assert {fields["theory"] for fields in mechanisms} == {"linear", "second_order"}
    places = {(link.parent, link.parent_station and link.parent_station > 0) for link in links}
    assert {(None, None), (0, None), (1, 0.0), (1, None), (1, True)} <= places
    assert {joint.kind for joint in joints} == {"revolute", "prismatic"}
    for name in ("fixed", "elastic", "mass", "rotor_inertia", "damping", "stiffness", "friction"):
        assert {bool(getattr(joint, name)) for joint in joints} == {True, False}, name
    assert {joint.offset == (0.0, 0.0) for joint in joints} == {True, False}
    assert {link.flexible for link in links} == {True, False}
    assert {link.segments for link in links} == {1, 2}
    assert {None if base is None else len(base.free) for base in bases} == {None, 1, 2, 3}
    assert {any(base.stiffness) for base in bases if base is not None} == {True, False}
    lengths = [fields["links"][0].length for fields in mechanisms]
    assert min(lengths) < 0.03
    assert max(lengths) > 5.0


@pytest.mark.thorough
def test_random_closures_have_every_kind():
    loops = [random_mechanism(seed, closures=True)["closures"] for seed in range(12)]
    assert {len(closures) for closures in loops} == {1, 2}
    kinds = {closure.kind for closures in loops for closure in closures}
    assert kinds == {"pin", "weld", "line"}
    ends = {
        (closure.to_link is None, closure.to_link == 0)
        for closures in loops
        for closure in closures
    }
    assert ends == {(True, False), (False, True), (False, False)}
