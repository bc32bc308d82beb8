"""Arrays that the kernels work on: what they hold, their shapes, units and frames.

A *body* is one flexible or rigid piece on a joint. Bodies with fewer modes than the widest one are
padded with modes of zero shape and unit mass, which stay at rest; so every array is rectangular.

==========  =====================================================================================
index       meaning
==========  =====================================================================================
``n``       bodies, from the base outwards
``m``       modes of the widest body
``c``       ``m`` where the sections of some body have rotary inertia, else 0
``g``       ``m`` with the second-order theory, else 0
``laws``    1 where some joint has friction, stops or a geared rotor, else 0
==========  =====================================================================================

The state is one array of shape (2, n, 1 + m): ``state[0]`` coordinates, ``state[1]`` rates; in each
row first the joint angle (rad), relative to the tip tangent of the body before, then the
mass-normalised modal coordinates (m sqrt(kg)).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

#: Numbers of one contact: their places are named in ``kernels.contact``.
LAW_PLACES = 15
#: What is seen of one contact: columns likewise.
LOOK_COLUMNS = 9


class Sizes(NamedTuple):
    """Loop lengths. Each field is something whose ``len`` counts.

    Tuples make the counts part of the type: the compiler sees constants, and compiles once for
    every model size. Arrays make them run-time numbers: one compilation serves every size.
    """

    bodies: Any
    modes: Any
    centrifugal: Any
    geometric: Any
    joint_laws: Any


class ArmConstants(NamedTuple):
    """Numbers of one arm. Body axes: origin at the joint, x along the clamped root tangent."""

    mass: Array  # (n,) kg
    inverse_mass: Array  # (n,) 1/kg; 0 of a body without mass
    first_moment_x: Array  # (n,) kg m, int mu x dx
    first_moment_y: Array  # (n,) kg m, of the undeformed body (a payload beside the axis)
    inertia: Array  # (n,) kg m^2 about the joint, with section rotary inertia and hub
    hub: Array  # (n,) kg m^2, the hub's part of it
    inverse_inertia: Array  # (n,) 1/(kg m^2), of the link's own about its centre of mass, or 0
    length: Array  # (n,) m
    S: Array  # (n, m) int mu Phi dx
    a: Array  # (n, m) int mu x Phi dx + int rho I Phi' dx
    P: Array  # (n, m) Phi(L)
    dP: Array  # (n, m) Phi'(L)
    w2: Array  # (n, m) squared frequencies, rad^2/s^2
    damping: Array  # (n, m) modal damping, 1/s
    centrifugal: Array  # (n, c, c) -R, theory page equation (L.19)
    D0: Array  # (n, g, g) int mu g(x) dx
    D1: Array  # (n, g, g) int mu x g(x) dx
    G: Array  # (n, g, g) g(L)
    residual_inertia: Array  # (n, 3) yy, yw, ww: (m, mc, I) less what the modes follow, (R.6)
    residual_tip: Array  # (n, 4) tip yy, yw, wy, ww: T less what the modes follow, (R.6)
    N: Array  # (n, 3) P.P, P.dP, dP.dP
    mobility: Array  # (n, m) acceleration per modal force: 1, or 1 / Delta of an implicit step
    joint_added: Array  # (n,) kg m^2 on the joint's diagonal: 0, but in an implicit step
    tip_mass: Array  # (n,) kg, point mass carried by the body's tip
    tip_inertia: Array  # (n,) kg m^2, turning with the tip section
    free: Array  # (n,) 1.0 for a joint moved by forces, 0.0: fixed, or its motion is given
    joint_damping: Array  # (n,) N m s/rad
    joint_stiffness: Array  # (n,) N m/rad, spring beside the motor
    joint_rest: Array  # (n,) rad, where that spring is free
    joint_angle: Array  # (n,) rad, added to the angle in the state: a fixed joint's
    friction: Array  # (n, 5) Coulomb, rise to static N m, Stribeck, smoothing rate rad/s, viscous
    limits: Array  # (n, 4) lower, upper rad, stiffness N m/rad, damping s/rad
    rotor: Array  # (n, 2) rotary inertia kg m^2 of the motor's rotor, and its gear ratio
    joint_laws: Array  # (1,) where some joint has friction, stops or a rotor, else (0,)
    gravity: Array  # (2,) m/s^2, world axes


class Contacts(NamedTuple):
    """Points of the arm that may touch surfaces, and the law of each touch."""

    body: Array  # (k,) integers, the body that holds the point
    rows: Array  # (k, m) Phi(x)
    shortening: Array  # (k, g, g) g(x)
    law: Array  # (k, LAW_PLACES) numbers of point, surface and law, see ``kernels.contact``
    knots: Array  # (pieces, 9) of tabulated surfaces: arc s, then cubics of x and y in s, m
    seen: Array  # (2, k, 9) scratch: at the start of a step, and where the forces were taken last


class Loads(NamedTuple):
    """External loads at one instant, besides gravity and the joint torques.

    A load is a force and a moment at a station of a body, or spread along it; spread ones are
    stored as integrals of their density p(x).
    """

    body: Array  # (k,) integers
    weight: Array  # (k,) 1 at a station; int p dx
    lever: Array  # (k,) m, station x; int p x dx
    rows: Array  # (k, m) Phi(x); int p Phi dx
    slopes: Array  # (k, m) Psi(x), for the moment: Phi'(x) without shear
    shortening: Array  # (k, g, g) g(x); int p g dx
    follower: Array  # (k,) 1.0: force in the axes of the body; 0.0: in world axes
    value: Array  # (k, 3) Fx, Fy, Mz: N, N, N m (spread: per unit of the density)
    base_acceleration: Array  # (2,) m/s^2 of the base joint, world axes
    contacts: Contacts


class Stations(NamedTuple):
    """Places along the links, with the shapes there."""

    body: Array  # (k,) integers, the body that holds each
    x: Array  # (k,) m from the root of the body
    rows: Array  # (k, m) Phi(x), shapes of the deflection
    turns: Array  # (k, m) Psi(x), shapes of the section's rotation
    shortening: Array  # (k, g, g) g(x)


class Workspace(NamedTuple):
    """Scratch and results of one evaluation; one per thread. Wrenches are (Fx, Fy, Mz)."""

    acceleration: Array  # (n, 1 + m) second derivatives of the coordinates
    force: Array  # (n, 1 + m) generalised forces (inverse dynamics)
    wrench: Array  # (n, 3) what the joint gives to its body, body axes, N and N m
    rotation: Array  # (n, 2) cosine, sine of the turn from the previous body's axes to these
    rate: Array  # (n,) w, angular rate of the body axes, rad/s
    tip: Array  # (n, 2) tip position L + u_L, v_L in body axes, m
    tip_bias: Array  # (n, 2) velocity products in the tip's acceleration, body axes, m/s^2
    # (n, 4) s, mu, what bending adds to the inertia, and what of that the modes leave
    moment: Array
    root_bias: Array  # (n, 3) velocity products in the root wrench
    flex_bias: Array  # (n, m) stiffness, damping and velocity products of the modal equations
    shortening: Array  # (n, g) D0 eta
    spin_shortening: Array  # (n, g) D1 eta
    rigid_shortening: Array  # (n, 2) alpha (m) and beta of (L.44)
    mean_shortening: Array  # (n, 6) rates of (R.46), then terms of (R.45)
    Fx: Array  # (n, g) first row of F: -G eta
    transfer: Array  # (n, 3, 3) residual transfer from root to tip
    N: Array  # (n, 6) N of the second-order theory: xx, xy, xw, yy, yw, ww
    drift: Array  # (n, 3) tip acceleration at zero root acceleration and zero tip force
    gain: Array  # (n, 3, 4) tip force per root acceleration, and at none
    joint: Array  # (n, 6) U_x, U_y, U_w, free / D, tau - h_w, given acceleration
    root_acceleration: Array  # (n, 3) of the joint less gravity, body axes (inverse dynamics)
    tip_acceleration: Array  # (n, 3) of the tip, likewise
    # (n, 6) cosine, sine of the absolute angle of the body axes (with loads); x, y of the body's
    # root and their rates, world axes (with contacts)
    world: Array


def new_workspace(constants: ArmConstants, dtype: Any = np.float64) -> Workspace:
    """Allocate scratch for an arm and a number type (``complex``, ``object``, ...)."""
    n, m = constants.S.shape
    g = constants.D0.shape[1]

    def zeros(*shape: int) -> Array:
        return np.zeros(shape, dtype=dtype)

    return Workspace(
        acceleration=zeros(n, 1 + m),
        force=zeros(n, 1 + m),
        wrench=zeros(n, 3),
        rotation=zeros(n, 2),
        rate=zeros(n),
        tip=zeros(n, 2),
        tip_bias=zeros(n, 2),
        moment=zeros(n, 4),
        root_bias=zeros(n, 3),
        flex_bias=zeros(n, m),
        shortening=zeros(n, g),
        spin_shortening=zeros(n, g),
        rigid_shortening=zeros(n, 2),
        mean_shortening=zeros(n, 6),
        Fx=zeros(n, g),
        transfer=zeros(n, 3, 3),
        N=zeros(n, 6),
        drift=zeros(n, 3),
        gain=zeros(n, 3, 4),
        joint=zeros(n, 6),
        root_acceleration=zeros(n, 3),
        tip_acceleration=zeros(n, 3),
        world=zeros(n, 6),
    )


def no_loads(constants: ArmConstants) -> Loads:
    """Return the loads of an arm that nothing acts on."""
    return empty_loads(constants, 0)


def empty_loads(constants: ArmConstants, count: int) -> Loads:
    """Allocate ``count`` loads of no magnitude on the first body's root, to be filled in."""
    m, g = constants.S.shape[1], constants.D0.shape[1]
    return Loads(
        body=np.zeros(count, dtype=np.intp),
        weight=np.zeros(count),
        lever=np.zeros(count),
        rows=np.zeros((count, m)),
        slopes=np.zeros((count, m)),
        shortening=np.zeros((count, g, g)),
        follower=np.zeros(count),
        value=np.zeros((count, 3)),
        base_acceleration=np.zeros(2),
        contacts=empty_contacts(constants, 0, 0),
    )


def empty_contacts(constants: ArmConstants, count: int, pieces: int) -> Contacts:
    """Allocate ``count`` contacts on the first body's root, to be filled in."""
    m, g = constants.S.shape[1], constants.D0.shape[1]
    return Contacts(
        body=np.zeros(count, dtype=np.intp),
        rows=np.zeros((count, m)),
        shortening=np.zeros((count, g, g)),
        law=np.zeros((count, LAW_PLACES)),
        knots=np.zeros((pieces, 9)),
        seen=np.zeros((2, count, LOOK_COLUMNS)),
    )


def run_time_sizes(constants: ArmConstants) -> Sizes:
    """Sizes that compile once for all arms."""
    counts = _counts(constants)
    return Sizes(*(np.zeros(count, dtype=np.int8) for count in counts))


def compile_time_sizes(constants: ArmConstants) -> Sizes:
    """Sizes that compile for this model size alone, to faster code."""
    return Sizes(*((0,) * count for count in _counts(constants)))


def _counts(constants: ArmConstants) -> tuple[int, ...]:
    n, m = constants.S.shape
    c, g = constants.centrifugal.shape[1], constants.D0.shape[1]
    return n, m, c, g, constants.joint_laws.size
