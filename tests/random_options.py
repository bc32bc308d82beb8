"""Arms with random options, under random loads and on moving bases.

In addition to ``random_arms``: links in segments; joints with springs, friction, stops and geared
rotors, elastic and fixed ones; point and distributed loads in both frames; an accelerating base;
joints with a prescribed motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import flexarm as fa
from flexarm.model import ArmSpec, Friction, Joint, JointLimits, Link, RayleighDamping
from oracles.chain import cut
from random_arms import MODERATE, NodalState, decide, maybe, random_bending, random_spec


@dataclass(frozen=True)
class Busy:
    """An arm with a state (modal and nodal coordinates), its loads and prescribed motions.

    torque (joints,) N m; tip_force (3,); loads without the tip force; base_velocity and
    base_acceleration (2,); given: joint number from 1 to acceleration, rad/s^2.
    """

    arm: fa.Arm
    state: NodalState
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    tip_force: np.ndarray
    loads: list[fa.Load]
    base_velocity: np.ndarray
    base_acceleration: np.ndarray
    given: dict[int, float]

    @property
    def all_loads(self) -> list[fa.Load]:
        """Return the loads and the tip force."""
        force = fa.Load(link=self.arm.n_links, force=self.tip_force[:2], moment=self.tip_force[2])
        return [*self.loads, force]


def busy(seed: int, theory: str | None = None, reduced: bool = False) -> Busy:
    """Draw an arm, its state and what acts on it."""
    rng = np.random.default_rng(seed)
    plain = random_spec(rng, theory=theory)
    links = [in_segments(rng, link, reduced) for link in plain.links]
    angles = rng.uniform(-np.pi, np.pi, len(links))
    joints = [
        with_laws(rng, joint, angle) for joint, angle in zip(plain.joints, angles, strict=True)
    ]
    joints = [fixed(rng, joint) if decide(rng, None, 0.15) else joint for joint in joints]
    # Drawn separately, so that the other numbers do not depend on the options below.
    more = np.random.default_rng([seed, 1])
    links = [link.replace(hub_radius=maybe(more, 0.02, 0.3)) for link in links]
    joints = [one_sided(more, with_drive(more, joint)) for joint in joints]
    turning = [i for i, joint in enumerate(joints) if not joint.fixed]
    angles = angles[turning]
    spec = ArmSpec(
        links=links,
        joints=joints,
        payload=plain.payload,
        gravity=plain.gravity,
        theory=plain.theory,
    )
    arm = fa.Arm(spec)
    state = NodalState(
        angles=angles,
        nodal=bent(rng, spec, MODERATE),
        angle_rates=rng.uniform(-2, 2, len(turning)),
        nodal_rates=bent(rng, spec, 0.1),
    )
    moved = [j + 1 for j in turning if rng.random() < 0.3]
    q = arm.from_nodal(state.angles, state.nodal)
    qd = arm.from_nodal(state.angle_rates, state.nodal_rates)
    for seat in arm.assembly.seats:
        if seat.twist is not None:
            q[seat.twist], qd[seat.twist] = rng.normal(size=2) * [0.1, 1.0]
    return Busy(
        arm=arm,
        state=state,
        q=q,
        qd=qd,
        torque=rng.normal(size=arm.n_joints) * 5.0,
        tip_force=rng.normal(size=3) * [3.0, 3.0, 1.0],
        loads=random_loads(rng, spec),
        base_velocity=rng.normal(size=2) * 3.0,
        base_acceleration=rng.normal(size=2) * 5.0 if decide(rng, None) else np.zeros(2),
        given={joint: float(rng.normal() * 5.0) for joint in moved},
    )


def in_segments(rng: np.random.Generator, link: Link, reduced: bool) -> Link:
    """Return the same link as a chain of 1 to 4 segments."""
    if not link.flexible:
        return link
    count = int(rng.integers(1, 5))
    mesh = int(rng.integers(1, 4 if count < 3 else 2))
    modes = max(int(rng.integers(1, 2 * mesh + 1)), min(count, 2)) if reduced else None
    damping = link.damping
    if damping is not None and count > 1:  # segments accept no other kind
        damping = RayleighDamping(stiffness_coefficient=float(rng.uniform(0, 1e-3)))
    elif getattr(damping, "kind", None) == "modal" and isinstance(damping.ratio, tuple):
        damping = damping.replace(ratio=damping.ratio[0])  # there may be fewer modes
    return link.replace(segments=count, elements=count * mesh, modes=modes, damping=damping)


def bent(rng: np.random.Generator, spec: ArmSpec, size: float) -> list[np.ndarray]:
    """Draw nodal values per link, with every segment bent from its own root tangent."""
    nodal = [np.zeros((link.elements, 2)) for link in spec.links]
    for piece in cut(spec):
        if piece.link.flexible:
            nodal[piece.owner][piece.rows] = random_bending(rng, piece.link, size)
    return nodal


def with_laws(rng: np.random.Generator, joint: Joint, angle: float) -> Joint:
    """Return the joint with a spring, friction and stops; the given angle may be beyond a stop.

    It keeps a distance from the corner of a stop, which the package rounds.
    """
    friction, limits = None, None
    if decide(rng, None):
        coulomb = float(rng.uniform(0.1, 3.0))
        friction = Friction(
            coulomb=coulomb,
            static=coulomb + maybe(rng, 0.1, 2.0) if decide(rng, None) else None,
            stribeck_rate=float(rng.uniform(0.1, 2.0)),
            smoothing_rate=float(rng.uniform(0.01, 2.0)),
            viscous=maybe(rng, 0.1, 2.0),
        )
    if decide(rng, None):
        # Angle less a stop: within the range, beyond the lower one, beyond the upper one.
        below, above = [(-1.0, 1.0), (0.2, 1.0), (-1.0, -0.3)][int(rng.integers(3))]
        limits = JointLimits(
            lower=angle + below,
            upper=angle + above,
            stiffness=float(rng.uniform(10.0, 1e3)),
            damping=maybe(rng, 0.1, 3.0),
        )
    stiffness, rotor = maybe(rng, 0.5, 50.0), maybe(rng, 1e-5, 1e-2)
    return joint.replace(
        stiffness=stiffness,
        rest_angle=0.0 if stiffness and rotor else float(rng.normal()),
        rotor_inertia=rotor,
        gear_ratio=float(rng.choice([1.0, 0.5, 50.0])) if rotor else 1.0,
        friction=friction,
        limits=limits,
    )


def one_sided(rng: np.random.Generator, joint: Joint) -> Joint:
    """Return the joint with other friction at negative rates, if it has friction."""
    if joint.friction is None or decide(rng, None):
        return joint
    friction = joint.friction.replace(
        coulomb_negative=float(rng.uniform(0.1, 3.0)), viscous_negative=maybe(rng, 0.1, 2.0)
    )
    return joint.replace(friction=friction)


def with_drive(rng: np.random.Generator, joint: Joint) -> Joint:
    """Return the joint with a backlash if it is elastic, and with a motor driven by a voltage."""
    backlash = maybe(rng, 0.01, 0.2) if joint.elastic else 0.0
    winding = fa.Winding(torque_constant=0.05, resistance=float(rng.uniform(0.5, 5.0)))
    driven = decide(rng, None, 0.3) and not joint.fixed
    return joint.replace(backlash=backlash, winding=winding if driven else None)


def fixed(rng: np.random.Generator, joint: Joint) -> Joint:
    """Return a rigid connection in the joint's place, with the same lumps."""
    carried = joint.model_dump(include={"hub_inertia", "mass", "housing_inertia"})
    return Joint(fixed=True, rest_angle=float(rng.normal()), **carried)


def random_loads(rng: np.random.Generator, spec: ArmSpec) -> list[fa.Load]:
    """Draw up to four loads: at tips and stations, with moments, or distributed over an
    interval."""
    loads = []
    for _ in range(int(rng.integers(0, 5))):
        link = int(rng.integers(1, len(spec.links) + 1))
        length = spec.links[link - 1].length
        frame = str(rng.choice(["world", "link"]))
        force = rng.normal(size=2) * 4.0
        if decide(rng, None):
            start, end = np.sort(rng.uniform(0.0, length, 2))
            loads.append(fa.Load(link, force=force, spread=(start, end), frame=frame))
        else:
            station = float(rng.uniform(0.0, length)) if decide(rng, None) else None
            moment = float(rng.normal())
            loads.append(fa.Load(link, force=force, moment=moment, station=station, frame=frame))
    return loads
