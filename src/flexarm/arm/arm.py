"""Arm, the main public object: its coordinates, dynamics and observables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from os import PathLike
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import Environment
from flexarm.arm.assembly.assemble import FloatArray, table_error
from flexarm.arm.assembly.coordinates import check_state
from flexarm.arm.dynamics import Dynamics
from flexarm.arm.stations import (
    MOST_STATIONS,
    Cut,
    cuts_at,
    forces_at,
    place_gauges,
    place_stations,
)
from flexarm.base.arguments import check_count, check_kind, check_last_axes, check_path
from flexarm.base.errors import (
    AccuracyWarning,
    ArgumentError,
    Problem,
    Rule,
    called_by_user,
    check_result,
    public_call,
    raise_any,
    warn_caller,
)
from flexarm.base.notebook import html_table
from flexarm.kernels.layout import Stations
from flexarm.kernels.observation.observables import POSE_COLUMNS, energies, poses, poses_many
from flexarm.kernels.observation.shapes import axis_points, gauge_strains
from flexarm.model import ArmSpec, Contact, Friction, Load, load_arm_spec, save_arm_spec
from flexarm.model.arm.spec import varied_spec
from flexarm.model.checks import signature_of
from flexarm.model.plausible import implausible, warn_of

#: Relative error of a frequency by the points of a table that is worth a warning.
_COARSE = 0.005


class Energy(NamedTuple):
    """Energy of a state, in J. Gravity energy is zero at the base joint."""

    kinetic: float
    strain: float
    gravity: float

    @property
    def total(self) -> float:
        """Sum of the three energies."""
        return self.kinetic + self.strain + self.gravity


def _range(values: Sequence[float] | None) -> str:
    """Format a constant property, or its smallest and largest value along a link."""
    if not values:
        return ""
    least, most = min(values), max(values)
    return f"{least:.5g}" if least == most else f"{least:.5g} to {most:.5g}"


class Arm(Dynamics):
    """A planar serial arm of rigid and flexible links.

    Args:
        links: `Link` objects (or mappings of their fields), from the base outwards, 1 to 256.
        joints: one `Joint` for each link, at its root; None: plain revolute joints.
        payload: `Payload` on the last tip.
        gravity: (gx, gy) in world axes, m/s^2; zero by default, for an arm in a horizontal plane.
        theory: "linear", the paper's kinematics, or "second_order", which adds the shortening of
            bent links and therefore centrifugal and axial stiffening (theory page "link").

    Raises:
        ModelError: if a quantity is missing or not possible; all problems are listed.

    Warns:
        ImplausibleValueWarning: if numbers look like those of another unit; it names all of them.

    Coordinates ``q`` (dof,): for each link its joint angle (rad), relative to the tip tangent of
    the previous link (the first: to world x), then its modal coordinates. World frame: origin at
    the base joint, x to the right, y up.
    """

    #: Without this attribute, ``help`` would show ``**fields``.
    __signature__ = signature_of(ArmSpec)
    #: Rule of the arguments with this type, as that of an annotated type, for ``public_call``.
    __metadata__: ClassVar[tuple[Rule, ...]]

    @public_call
    def __init__(self, spec: ArmSpec | None = None, /, **fields: Any) -> None:
        if spec is None:
            spec = ArmSpec(**fields)
        elif not isinstance(spec, ArmSpec):
            hint = "Use Arm(links=[...], joints=[...])."
            raise ArgumentError(Problem("links", "must be given by name.", hint=hint))
        super().__init__(spec)
        gauges = [(i, gauge) for i, link in enumerate(spec.links) for gauge in link.gauges]
        self.gauges = tuple((i, gauge.station, gauge.distance) for i, gauge in gauges)
        self._gauge_rows, self._gauge_bodies = place_gauges(self, self.gauges)
        if called_by_user():
            warn_of(implausible(spec))
            coarse = [
                f"links[{i}].table has {len(link.table.x)} points; if they sample a smooth taper, "
                "linear interpolation between them changes the first frequency by about "
                f"{100.0 * error:.1f} %. Give more points."
                for i, link in enumerate(spec.links)
                if link.table is not None and (error := table_error(link)) > _COARSE
            ]
            if coarse:
                warn_caller(" ".join(coarse), AccuracyWarning)
        self._cuts: tuple[Cut, ...] = ()
        self._placed: dict[int, Stations] = {}

    def rigid(self) -> Arm:
        """Return the rigid model: the same masses and inertias, no bending, no elastic joints."""
        links = tuple(
            link.model_copy(update={"flexible": False, "segments": 1, "modes": None, "gauges": ()})
            for link in self.spec.links
        )
        joints = tuple(
            joint.model_copy(update={"stiffness": 0.0, "damping": 0.0, "backlash": 0.0})
            if joint.elastic
            else joint
            for joint in self.spec.joints
        )
        return Arm(self.spec.model_copy(update={"links": links, "joints": joints}))

    def __reduce__(self) -> tuple[Callable[[ArmSpec], Arm], tuple[ArmSpec]]:
        # Create the arm from its specification, so that its arrays have the types of the kernels.
        return _copy_of, (self.spec,)

    def __repr__(self) -> str:
        theory = self.spec.theory
        return f"<flexarm.Arm: {self.n_links} links, {self.dof} coordinates, {theory} theory>"

    def _repr_html_(self) -> str:
        heads = ("", "length (m)", "flexural rigidity (N m²)", "mass per length (kg/m)", "modes")
        rows: list[tuple[object, ...]] = []
        for number, link in enumerate(self.spec.links, 1):
            beam = link.beam()
            rigidity = _range(beam.flexural_rigidity) if link.flexible else "rigid"
            mass = _range(beam.mass_per_length)
            rows.append((f"link {number}", link.reach, rigidity, mass, link.coordinates))
        if self.spec.payload.mass > 0.0:
            rows.append(("payload", "", "", f"{self.spec.payload.mass:.5g} kg", ""))
        return html_table(repr(self).strip("<>"), heads, rows)

    @public_call
    def energy(self, q: ArrayLike, qd: ArrayLike) -> Energy:
        """Return kinetic, strain and gravity energy (J), and their ``total``."""
        state = self._state(q, qd)
        kernels, values = self._kernels.take(), np.zeros(3)
        kernels.call(energies, state, *kernels.pose_arrays(), values)
        self._kernels.append(kernels)
        return Energy(*(float(value) for value in check_result(values, q, qd)))

    def _poses(self, q: ArrayLike, qd: ArrayLike | None = None) -> tuple[FloatArray, ...]:
        state = self._state(q, qd)
        kernels = self._kernels.take()
        body_poses, tip = kernels.pose_arrays()
        kernels.call(poses, state, body_poses, tip)
        self._kernels.append(kernels)
        check_result(tip, q, qd)
        return state, body_poses, tip

    @public_call
    def tip(self, q: ArrayLike) -> FloatArray:
        """Return x, y (m) and angle (rad) of the last tip in world axes, (3,).

        ``q`` (dof,), or joint angles (joints,) of straight links.
        """
        return self._poses(check_state(self, "q", q))[2][:3]

    @public_call
    def tip_velocity(self, q: ArrayLike, qd: ArrayLike) -> FloatArray:
        """Return the rates of x, y (m/s) and angle (rad/s) of the last tip, (3,)."""
        return self._poses(q, qd)[2][3:]

    @public_call
    def shape(self, q: ArrayLike, stations: int = 50) -> FloatArray:
        """Return points of the neutral axis in world axes: (links, stations, 2) m.

        The stations divide each link evenly, including root and tip. With the second-order
        theory each point also moves back along the root tangent as the link shortens. ``q`` (dof,),
        or joint angles (joints,) of straight links.

        Raises:
            InputError: if ``q`` has the wrong shape or is not finite, or there are fewer than two
                stations.
        """
        count = check_count("stations", stations, 2, 10**6)
        shape: FloatArray = shapes_along(self, check_state(self, "q", q)[None], count)[0]
        return shape

    @public_call
    def motor_torque(self, voltage: ArrayLike, rate: ArrayLike | None = None) -> FloatArray:
        """Return the torques (..., joints) of motors under voltages, at the joints, N m.

        Args:
            voltage: (..., joints) V; zero at joints without a winding, whose torque is then zero.
            rate: (..., joints) joint rates, rad/s. By default the torques are those at standstill,
                which are the ``torque`` of such an arm in all functions.

        Raises:
            InputError: if no joint has a winding, there is a voltage at a joint without one, or the
                shapes are wrong.
        """
        turning = [(seat.link, self.spec.joints[seat.link]) for seat in self.assembly.seats]
        voltage = check_last_axes("voltage", voltage, (self.n_joints,))
        bare = np.array([joint.winding is None for _, joint in turning])
        driven = np.any(voltage != 0.0, axis=tuple(range(voltage.ndim - 1)))
        problems = [
            Problem(f"arm.joints[{turning[i][0]}]", "has no winding, so its voltage must be zero")
            for i in np.flatnonzero(bare & (driven | bare.all()))
        ]
        raise_any(problems)
        torque = np.array([joint.torque_per_voltage for _, joint in turning]) * voltage
        if rate is None:
            return np.asarray(torque)
        rate = check_last_axes("rate", rate, (self.n_joints,))
        return np.asarray(torque - np.array([joint.braking for _, joint in turning]) * rate)

    @public_call
    def strain(self, q: ArrayLike) -> FloatArray:
        """Return the strain at each gauge of the links, (gauges,): -distance * v''."""
        values: FloatArray = self.strains(self._state(q, None)[None])[0]
        return check_result(values, q)

    @public_call
    def strains(self, states: ArrayLike) -> FloatArray:
        """Return the strains (samples, gauges) for states of the kernels (samples, 2, n, 1 + m).

        Raises:
            InputError: if the states do not have that shape.
        """
        shape = (2, self.assembly.bodies, 1 + self.assembly.modes)
        states = check_last_axes("states", states, shape, axes=4)
        strains = np.zeros((len(states), len(self.gauges)), dtype=states.dtype)
        gauge_strains(self.assembly.sizes, states, self._gauge_bodies, self._gauge_rows, strains)
        return strains

    @public_call
    def section_forces(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        stations: int = 11,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
        closure_forces: ArrayLike | None = None,
    ) -> FloatArray:
        """Return axial force N, shear force V and bending moment M: (links, stations, 3).

        These are the forces of the part outboard of a section on the part inboard of it, in N and
        N m: N along the normal of the bent section (tension positive), V across it, M
        counter-clockwise; a positive moment bends with v'' > 0. They follow from the balance of
        momentum, not from EI v''. The stations divide each link evenly; values at root and tip
        are those just inside the link, values at a load those inboard of it. Other arguments as in
        ``joint_reactions``; (R.40) to (R.43).
        """
        self._require_forces(closure_forces)
        if len(self._cuts) != check_count("stations", stations, 2, MOST_STATIONS):
            self._cuts = cuts_at(self, int(stations))
        given = tip_force, loads, base_acceleration, contacts
        environment = Environment.of(self, *given)
        placed = environment.placed(self)
        scratch = self._newton_euler(q, qd, qdd, placed, closure_forces)
        motion = scratch.state, scratch.third
        forces = forces_at(self, self._cuts, *motion, environment.loads, placed, scratch.work)
        self._inverse.append(scratch)
        return forces


Arm.__metadata__ = (Rule(partial(check_kind, kind=Arm)),)


def _copy_of(spec: ArmSpec) -> Arm:
    """Return the arm of a pickled description, without the warnings of a call by the user."""
    return Arm(spec)


def described_arm(spec: ArmSpec) -> Arm:
    """Return the arm of a description by the user, such as that of a file, with its warnings."""
    arm = Arm(spec)
    warn_of(implausible(spec))  # an arm that cannot be assembled raises
    return arm


@public_call
def varied(
    arm: Arm,
    *,
    payload_factor: float = 1.0,
    payload_mass: float | None = None,
    flexural_rigidity_factor: float | Sequence[float] = 1.0,
    mass_factor: float | Sequence[float] = 1.0,
    friction: Friction | Sequence[Friction | None] | None = None,
) -> Arm:
    """Return a copy of an arm with some changed parameters, for ``simulate(..., plant=...)``.

    Args:
        arm: the nominal arm.
        payload_factor: factor on mass and inertia of the payload, at least 0.
        payload_mass: replacement of the payload mass, kg, for an arm without payload.
        flexural_rigidity_factor: factor on E I, positive, one number or one for each link.
        mass_factor: factor on mass and rotary inertia per length, as above.
        friction: friction of every joint that is not fixed, or a list with one or None per joint.

    Raises:
        InputError: if a factor is negative or not a number, or a list has the wrong length.

    Warns:
        ImplausibleValueWarning: if a changed number looks like one of another unit.
    """
    spec = varied_spec(
        arm.spec,
        payload_factor=payload_factor,
        payload_mass=payload_mass,
        flexural_rigidity_factor=flexural_rigidity_factor,
        mass_factor=mass_factor,
        friction=friction,
    )
    changed = Arm(spec)
    if called_by_user():
        notices = implausible(arm.spec)
        warn_of([finding for finding in implausible(spec) if finding not in notices])
    return changed


#: Divisions of the links whose stations an arm keeps, and most points that one call computes.
_KEPT, _TOGETHER = 8, 20_000


def shapes_along(arm: Arm, q: FloatArray, stations: int) -> FloatArray:
    """Return the points of `Arm.shape` for samples q (samples, dof), without checks of their form:
    (samples, links, stations, 2) m."""
    # Keep the stations, because frames and paths of an animation share them.
    placed = arm._placed.get(stations) or place_stations(arm, stations)
    if stations <= MOST_STATIONS and len(arm._placed) < _KEPT:  # more would occupy much memory
        arm._placed[stations] = placed
    states = arm.padded(np.stack([q, np.zeros_like(q)], axis=1))
    sizes, body_poses = arm.assembly.sizes, np.empty((len(q), arm.assembly.bodies, POSE_COLUMNS))
    poses_many(sizes, arm.assembly.run_constants, states, body_poses, np.empty((len(q), 6)))
    # A call for the points of many samples, as those of an arm with more bodies, is quicker.
    batch = max(1, min(len(q), _TOGETHER // len(placed.x)))
    bodies = (arm.assembly.bodies * np.arange(batch)[:, None] + placed.body).ravel()
    parts = placed.x, placed.rows, placed.shortening
    columns = [np.concatenate([part] * batch) for part in parts]
    shapes = np.empty((len(q), arm.n_links * stations, 2))
    for first in range(0, len(q), batch):
        state = np.concatenate(states[first : first + batch], axis=1)
        points = shapes[first : first + batch].reshape(-1, 2)
        x, rows, shortening = (column[: len(points)] for column in columns)
        body = np.concatenate(body_poses[first : first + batch])
        axis_points(sizes, state, body, bodies[: len(points)], x, rows, shortening, points)
    return check_result(shapes, q).reshape(len(q), arm.n_links, stations, 2)


@public_call
def load_arm(path: str | PathLike[str]) -> Arm:
    """Read an arm from a YAML file; a scenario file is also accepted.

    Raises:
        ModelError: if the file does not describe an arm; all problems are listed with their lines.

    Warns:
        ImplausibleValueWarning: see ``Arm``.
    """
    return described_arm(load_arm_spec(check_path("path", path)))


@public_call
def save_arm(arm: Arm, path: str | PathLike[str]) -> None:
    """Write an arm to a YAML file for ``load_arm``; the file is never written partially.

    Raises:
        InputError: if the file cannot be written.
    """
    save_arm_spec(arm.spec, check_path("path", path))
