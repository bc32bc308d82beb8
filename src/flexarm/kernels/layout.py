"""Records of the arrays of the kernels, with shapes, units and frames.

A *body* is a flexible or rigid piece on a joint. Bodies with fewer modes than the body with most
modes are padded with modes of zero shape and unit mass, which stay at rest, so that every array is
rectangular.

============  ===================================================================================
index         meaning
============  ===================================================================================
``n``         bodies, from the base outwards; each follows the body that carries it
``m``         maximum number of modes of a body
``c``         ``m`` with rotary inertia of the sections of any body or bristles, else 0
``g``         ``m`` with the second-order theory, else 0
``laws``      1 if any joint has friction, stops or a geared rotor, else 0
``tree``      1 if any body is not on the tip of the one before, or any joint slides, else 0
``closures``  rows of closures: equations that close loops
``bristles``  1 if the last mode is the deflection of the bristles of joints, else 0
============  ===================================================================================

The state is one array of shape (2, n, 1 + m): ``state[0]`` coordinates, ``state[1]`` rates. Each
row contains first the joint angle (rad), relative to the tip tangent of the body that carries it,
or the position (m) of a joint that slides, then the mass-normalised modal coordinates (m sqrt(kg)).

Dry friction with bristles (``forces.joint_law``) has a state of first order. It is the *rate* of a
last, additional mode of unit mass without shape: the deflection of the bristles times the square
root of their stiffness (sqrt(J)), so that the energy of this mode is that of the bristles. The
coordinate of the mode is the integral of its rate, on which nothing depends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.kernels import columns

Array = NDArray[Any]

#: Columns of the law of one contact, named in ``kernels.forces.contact``.
LAW_PLACES = 16
#: Columns of the observed quantities of one contact, named in ``kernels.forces.contact``.
LOOK_COLUMNS = 9
#: The same, with two more columns, of what integrators observe.
SEEN_COLUMNS = 11


class Sizes(NamedTuple):
    """Loop lengths, and the order of the bodies; the ``len`` of all fields but the last two is a
    count.

    With tuples the counts are part of the type: the compiler sees constants, and compiles once for
    every model size. With arrays they are run-time values: one compilation serves every size.
    """

    bodies: Any
    modes: Any
    centrifugal: Any
    geometric: Any
    joint_laws: Any
    bristles: Any
    tree: Any
    closures: Any
    #: (n, 2) integers, always at run time: index of the body that carries body i, or -1; 1 if its
    #: joint slides, else 0
    joints: Array
    #: (r, 3) integers, always at run time: kind of the row, and the bodies of its points, or -1
    ends: Array


class Columns:
    """Descriptor that returns named columns of an array of a record as a view, for Python code.

    Kernels use the array and the column: ``constants.body[i, MASS]``, not ``constants.mass[i]``.
    """

    def __init__(self, array: str, first: int, count: int = 0) -> None:
        self._array = array
        self._columns = slice(first, first + count) if count else first

    def __get__(self, record: Any, owner: type | None = None) -> Array:
        """Return the view: without the last axis for one column, (..., count) for several."""
        view: Array = getattr(record, self._array)[..., self._columns]
        return view


class _ArmArrays(NamedTuple):
    arm: Array  # (ARM_COLUMNS,)
    body: Array  # (n, BODY_COLUMNS)
    mode: Array  # (n, m, MODE_COLUMNS)
    centrifugal: Array  # (n, c, c) -R, theory page equation (L.19)
    shortening: Array  # (n, g, g, SHORTENING_COLUMNS)
    closure: Array  # (r, CLOSURE_COLUMNS)
    ends: Array  # (r, 3) as ``Sizes.ends``
    knots: Array  # (pieces, 9) tabulated curves of closures, as ``Contacts.knots``


class ArmConstants(_ArmArrays):
    """Constants of one arm. Body axes: origin at the joint, x along the clamped root tangent.

    The constants of an arm must not be modified. The arrays are not marked as read-only, because
    Numba would then treat them as another type than those of an implicit step, which do change, and
    would compile every kernel for both.
    """

    __slots__ = ()

    gravity = Columns("arm", columns.GRAVITY_X, 2)
    mass = Columns("body", columns.MASS)
    inverse_mass = Columns("body", columns.INVERSE_MASS)
    first_moment_x = Columns("body", columns.FIRST_MOMENT_X)
    first_moment_y = Columns("body", columns.FIRST_MOMENT_Y)
    inertia = Columns("body", columns.INERTIA)
    hub = Columns("body", columns.HUB)
    inverse_inertia = Columns("body", columns.INVERSE_INERTIA)
    length = Columns("body", columns.LENGTH)
    residual_inertia = Columns("body", columns.RESIDUAL_YY, 3)  # yy, yw, ww
    residual_tip = Columns("body", columns.RESIDUAL_TIP_YY, 4)  # yy, yw, wy, ww
    N = Columns("body", columns.N_YY, 3)  # yy, yw, ww
    tip_mass = Columns("body", columns.TIP_MASS)
    tip_inertia = Columns("body", columns.TIP_INERTIA)
    free = Columns("body", columns.FREE)
    joint_added = Columns("body", columns.JOINT_ADDED)
    joint_drag = Columns("body", columns.JOINT_DRAG)
    joint_damping = Columns("body", columns.JOINT_DAMPING)
    joint_stiffness = Columns("body", columns.JOINT_STIFFNESS)
    joint_rest = Columns("body", columns.JOINT_REST)
    joint_angle = Columns("body", columns.JOINT_ANGLE)
    friction = Columns("body", columns.COULOMB, 7)  # from COULOMB to VISCOUS_EXCESS
    bristles = Columns("body", columns.BRISTLED, 3)  # from BRISTLED to BRISTLE_DAMPING
    holds = Columns("body", columns.HOLDS)
    limits = Columns("body", columns.LOWER_STOP, 4)  # from LOWER_STOP to STOP_DAMPING
    rotor = Columns("body", columns.ROTOR_INERTIA, 2)  # ROTOR_INERTIA, GEAR_RATIO
    parent = Columns("body", columns.PARENT)
    slides = Columns("body", columns.SLIDES)
    slide = Columns("body", columns.SLIDE_X, 2)
    place = Columns("body", columns.PLACE_X, 2)
    S = Columns("mode", columns.S)
    a = Columns("mode", columns.A)
    P = Columns("mode", columns.P)
    dP = Columns("mode", columns.DP)
    w2 = Columns("mode", columns.W2)
    damping = Columns("mode", columns.MODE_DAMPING)
    mobility = Columns("mode", columns.MODE_MOBILITY)
    D0 = Columns("shortening", columns.D0)
    D1 = Columns("shortening", columns.D1)
    G = Columns("shortening", columns.G)

    @property
    def has_joint_laws(self) -> bool:
        """Whether any joint has friction, stops or a geared rotor."""
        return bool(self.arm[columns.HAS_JOINT_LAWS] != 0.0)

    @property
    def is_tree(self) -> bool:
        """Whether any body is not on the tip of the one before, or any joint slides."""
        return bool(self.arm[columns.IS_TREE] != 0.0)

    @property
    def has_bristles(self) -> bool:
        """Whether states contain the deflections of bristles."""
        return bool(self.arm[columns.HAS_BRISTLES] != 0.0)


def empty_constants(n: int, m: int, c: int, g: int, r: int = 0, pieces: int = 0) -> ArmConstants:
    """Allocate the constants of a serial arm, otherwise filled with zeros."""
    constants = ArmConstants(
        arm=np.zeros(columns.ARM_COLUMNS),
        body=np.zeros((n, columns.BODY_COLUMNS)),
        mode=np.zeros((n, m, columns.MODE_COLUMNS)),
        centrifugal=np.zeros((n, c, c)),
        shortening=np.zeros((n, g, g, columns.SHORTENING_COLUMNS)),
        closure=np.zeros((r, columns.CLOSURE_COLUMNS)),
        ends=np.zeros((r, 3)),
        knots=np.zeros((pieces, 9)),
    )
    constants.parent[:] = np.arange(n) - 1
    return constants


class Contacts(NamedTuple):
    """Points of the arm that may be in contact with surfaces, and their contact laws."""

    body: Array  # (k,) integers, the body of the point
    rows: Array  # (k, m) Phi(x)
    shortening: Array  # (k, g, g) g(x)
    law: Array  # (k, LAW_PLACES) constants of point, surface and law; see ``forces.contact``
    knots: Array  # (pieces, 9) tabulated surfaces: arc length s, then cubics of x and y in s, m
    seen: Array  # (2, k, 11) scratch: at the start of a step, and at the last evaluation of forces


class Loads(NamedTuple):
    """External loads at one instant, besides gravity and the joint torques.

    A load is a force and a moment at a station of a body, or distributed along it. Distributed
    loads are stored as integrals of their density p(x).
    """

    body: Array  # (k,) integers
    weight: Array  # (k,) 1 at a station; int p dx
    lever: Array  # (k,) m, station x; int p x dx
    rows: Array  # (k, m) Phi(x); int p Phi dx
    slopes: Array  # (k, m) Psi(x), for the moment: Phi'(x) without shear
    shortening: Array  # (k, g, g) g(x); int p g dx
    follower: Array  # (k,) 1.0: force in the axes of the body; 0.0: in world axes
    value: Array  # (k, 3) Fx, Fy, Mz: N, N, N m (distributed: per unit of the density)
    base_acceleration: Array  # (2,) m/s^2 of the base joint, world axes
    contacts: Contacts


class Stations(NamedTuple):
    """Stations along the links, and the shapes there."""

    body: Array  # (k,) integers, the body of each station
    x: Array  # (k,) m from the root of the body
    rows: Array  # (k, m) Phi(x), shapes of the deflection
    turns: Array  # (k, m) Psi(x), shapes of the section's rotation
    shortening: Array  # (k, g, g) g(x)


class _WorkArrays(NamedTuple):
    acceleration: Array  # (n, 1 + m) second derivatives of the coordinates
    force: Array  # (n, 1 + m) generalised forces (inverse dynamics)
    body: Array  # (n, WORK_BODY_COLUMNS)
    mode: Array  # (n, m, WORK_MODE_COLUMNS)
    closure: Array  # (r, CLOSURE_WORK_COLUMNS)
    column: Array  # (r, n, COLUMN_COLUMNS)
    reaction: Array  # (r, r) J M^-1 J', then its factors


class Workspace(_WorkArrays):
    """Scratch and results of one evaluation, one per thread. Wrenches are (Fx, Fy, Mz)."""

    __slots__ = ()

    rotation = Columns("body", columns.COSINE, 2)  # cosine, sine
    wrench = Columns("body", columns.WRENCH_X, 3)


def new_workspace(constants: ArmConstants, dtype: Any = np.float64) -> Workspace:
    """Allocate scratch for an arm and a number type (``complex``, ``object``, ...)."""
    n, m = constants.mode.shape[:2]
    r = len(constants.closure)
    return Workspace(
        acceleration=np.zeros((n, 1 + m), dtype=dtype),
        force=np.zeros((n, 1 + m), dtype=dtype),
        body=np.zeros((n, columns.WORK_BODY_COLUMNS), dtype=dtype),
        mode=np.zeros((n, m, columns.WORK_MODE_COLUMNS), dtype=dtype),
        closure=np.zeros((r, columns.CLOSURE_WORK_COLUMNS), dtype=dtype),
        column=np.zeros((r, n, columns.COLUMN_COLUMNS), dtype=dtype),
        reaction=np.zeros((r, r), dtype=dtype),
    )


def no_loads(constants: ArmConstants) -> Loads:
    """Return empty loads for an arm without external loads."""
    return empty_loads(constants, 0)


def empty_loads(constants: ArmConstants, count: int) -> Loads:
    """Allocate ``count`` loads of zero magnitude at the root of the first body."""
    m, g = constants.mode.shape[1], constants.shortening.shape[1]
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
    """Allocate ``count`` contacts at the root of the first body, filled with zeros."""
    m, g = constants.mode.shape[1], constants.shortening.shape[1]
    return Contacts(
        body=np.zeros(count, dtype=np.intp),
        rows=np.zeros((count, m)),
        shortening=np.zeros((count, g, g)),
        law=np.zeros((count, LAW_PLACES)),
        knots=np.zeros((pieces, 9)),
        seen=np.zeros((2, count, SEEN_COLUMNS)),
    )


def run_time_sizes(constants: ArmConstants) -> Sizes:
    """Return sizes for code that is compiled once for all arms."""
    counts = _counts(constants)
    arrays = (np.zeros(count, dtype=np.int8) for count in counts)
    return Sizes._make((*arrays, *_structure(constants)))


def compile_time_sizes(constants: ArmConstants) -> Sizes:
    """Return sizes for faster code that is compiled for this model size alone."""
    tuples = ((0,) * count for count in _counts(constants))
    return Sizes._make((*tuples, *_structure(constants)))


def _counts(constants: ArmConstants) -> tuple[int, ...]:
    n, m = constants.mode.shape[:2]
    c, g = constants.centrifugal.shape[1], constants.shortening.shape[1]
    laws, bristles = int(constants.has_joint_laws), int(constants.has_bristles)
    return n, m, c, g, laws, bristles, int(constants.is_tree), len(constants.closure)


def _structure(constants: ArmConstants) -> tuple[Array, Array]:
    """Return the arrays ``Sizes.joints`` and ``Sizes.ends``."""
    joints = np.stack([constants.parent, constants.slides], axis=1)
    return joints.real.astype(np.int16), constants.ends.real.astype(np.int16)
