"""Axial loads of links, which the linear theory neglects, and their warning.

Tension stiffens a link and compression softens it, until it buckles. The second-order theory
contains this: a state bent by eta shortens a piece by eta^T G eta / 2, and the work of the axial
force over the shortening is its geometric stiffness. The *share* of a piece is that stiffness over
the elastic one, for the shape of the lowest buckling load: positive for tension, -1 at the
buckling load of the clamped piece. Frequencies change by about sqrt(1 + share). Theory page "link",
section 11.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, Piece
from flexarm.arm.assembly.coordinates import carriers_of, once_per_arm
from flexarm.arm.bending import bending_warning, warn_of_first
from flexarm.arm.closed import stiffness_of
from flexarm.arm.observe import contact_forces, poses_of
from flexarm.kernels.columns import FIRST_MOMENT_X, LENGTH, MASS, TIP_MASS
from flexarm.kernels.forces.contact import LEVER
from flexarm.kernels.layout import Loads
from flexarm.model import Contact, Load

#: Share of a link that is reported: frequencies of the linear theory err by 13 % to 22 %.
LARGEST_SHARE = 1.0 / 3.0
#: Share below which the stability of an equilibrium does not depend on it.
_NEGLIGIBLE = 0.01
#: Samples of a period at which the loads are evaluated.
_SAMPLES = 8
_PAGE = "see docs/how-to/large-deflection.md."
_NO_FORCES: FloatArray = np.zeros(0)
_QUARTER: FloatArray = np.array([-1.0, 1.0])


def geometric_stiffness(
    arm: Arm, q: FloatArray, environment: Environment, closure_forces: FloatArray = _NO_FORCES
) -> FloatArray:
    """Return the stiffness (dof, dof) by axial forces at q (dof,) that the linear theory neglects.

    It is zero for an arm of the second-order theory, which contains it, and for axial forces below
    a hundredth of the buckling loads. Forces of contacts act as constant loads, and those of
    closures, (rows,), as their wrenches.
    """
    nothing = np.zeros((arm.dof, arm.dof))
    if arm.spec.theory != "linear":
        return nothing
    shares = _estimate(arm).shares(np.zeros(1), *_at_rest(arm, q, environment))
    if not closure_forces.size and np.abs(shares).max(initial=0.0) < _NEGLIGIBLE:
        return nothing
    loads = [*environment.loads, *_contact_loads(arm, q, environment.contacts)]
    stiff, plain = (stiffness_of(a, q, closure_forces, loads) for a in (_second_order(arm), arm))
    return stiff - plain


@once_per_arm
def _second_order(arm: Arm) -> Arm:
    """Return the arm with the second-order theory, which has the same coordinates."""
    return Arm(arm.spec.replace(theory="second_order"))


def _contact_loads(arm: Arm, q: FloatArray, contacts: Sequence[Contact]) -> list[Load]:
    if not contacts:
        return []
    placed = Environment((), None, contacts).placed(arm).contacts
    state = arm.padded(np.stack([q, np.zeros_like(q)]))
    forces = contact_forces(arm, placed, state[None])[0]
    return [
        Load(link=contact.link or arm.n_links, force=tuple(force.tolist()), station=contact.station)
        for contact, force in zip(contacts, forces, strict=True)
    ]


class AxialLoads:
    """Estimate of the shares of all pieces at states; the bodies count as rigid, in their places.

    Shares of tip forces, uniform fields and rotation are exact alone, and add up within some
    percent.
    """

    def __init__(self, arm: Arm) -> None:
        constants = arm.assembly.constants
        self._arm = arm
        self.pieces = [piece for piece in arm.assembly.pieces if piece.shapes.w2.size]
        self.gains = np.array([_gains(piece) for piece in self.pieces]).reshape(-1, 3)
        slowest = np.array([piece.shapes.w2[0] for piece in self.pieces])
        self._periods = 2.0 * np.pi / np.sqrt(np.maximum(slowest, np.finfo(float).tiny))
        body = constants.body
        self._tip = body[:, TIP_MASS], body[:, TIP_MASS] * body[:, LENGTH]
        self._mass = body[:, MASS] + self._tip[0]
        self._moment = body[:, FIRST_MOMENT_X] + self._tip[1]
        self._gravity = np.asarray(arm.spec.gravity, dtype=float)
        self._carriers = carriers_of(arm)
        self._sliding = np.flatnonzero(constants.slides).tolist()
        self._bodies = np.array([piece.body for piece in self.pieces], dtype=np.intp)
        self._offset = np.array([piece.offset for piece in self.pieces])

    def shares(self, times: FloatArray, states: FloatArray, acting: Acting) -> FloatArray:
        """Return the shares (k, pieces), averages over the lowest period of each piece.

        The states (k, 2, n, 1 + m) are those of one or several runs, one after the other, at the
        same times (samples,).
        """
        if not self.pieces:
            return np.zeros((len(states), 0))
        acting = acting.repeated(len(states) // len(times))
        poses = poses_of(self._arm, states)
        place, angle, rate = poses[:, :, :2], poses[:, :, 2], poses[:, :, 5]
        turning, n = self._turning(times, rate), angle.shape[1]
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)  # (samples, bodies, 2)
        # Accelerations less gravity, of the roots, then of the centres of mass times the mass.
        root = np.zeros((len(states), n, 2)) + (acting.base - self._gravity)[:, None]
        for b, a in enumerate(self._carriers):
            if a >= 0:
                link = place[:, b] - place[:, a]
                spun = turning[:, a, None] * _turned(link) - rate[:, a, None] ** 2 * link
                root[:, b] = root[:, a] + spun
            if b in self._sliding:
                root[:, b] += self._slid(times, b, states, angle, rate[:, b, None])
        spun = turning[..., None] * _turned(along) - rate[..., None] ** 2 * along
        forces = acting.forces(self._arm, states, along)
        needed = self._mass[:, None] * root + self._moment[:, None] * spun
        for body, _, force in forces:
            needed[:, body] -= force
        outboard = needed  # force on each root
        carried = np.zeros_like(needed)  # forces on the roots of the bodies on each tip
        for b in reversed(range(n)):
            outboard[:, b] += carried[:, b]
            if (a := self._carriers[b]) >= 0:
                carried[:, a] += outboard[:, b]
        bodies, (tip, uniform, spinning) = self._bodies, self.gains.T
        t, spin = along[:, bodies], rate[:, bodies] ** 2
        field = -(root[:, bodies] * t).sum(axis=2)
        pull = self._tip[0][bodies] * field + self._tip[1][bodies] * spin
        pull -= (carried[:, bodies] * t).sum(axis=2)
        for body, x, force in forces:
            for k in np.flatnonzero(bodies == body):
                ratio = min(max((x - self._offset[k]) / self.pieces[k].shapes.length, 0.0), 1.0)
                # Part of the shortening inboard of the load, for Euler's buckling mode.
                part = ratio - np.sin(np.pi * ratio) / np.pi
                pull[:, k] += part * (force * t[:, k]).sum(axis=1)
        shares = tip * pull + uniform * (field + self._offset * spin) + spinning * spin
        return self._averaged(times, shares)

    def _slid(
        self, times: FloatArray, b: int, states: FloatArray, angle: FloatArray, rate: FloatArray
    ) -> FloatArray:
        """Return the acceleration (samples, 2) of a body by its joint that slides."""
        speed = states[:, 1, b, 0]
        x, y = self._arm.assembly.constants.slide[b]
        cosine, sine = np.cos(angle[:, b]), np.sin(angle[:, b])
        axis = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
        slowing = self._turning(times, speed[:, None])
        return np.asarray(slowing * axis + 2.0 * rate * speed[:, None] * _turned(axis))

    def _turning(self, times: FloatArray, rate: FloatArray) -> FloatArray:
        """Return accelerations (k, bodies), averages of rates over the longest period."""
        k = _window(times, float(self._periods.max()))
        if k >= len(times):
            return np.zeros_like(rate)
        runs = rate.reshape(-1, len(times), rate.shape[1])
        middle = (runs[:, k:] - runs[:, :-k]) / (times[k:] - times[:-k])[:, None]
        places = np.clip(np.arange(len(times)) - k // 2, 0, middle.shape[1] - 1)
        return np.asarray(middle[:, places].reshape(rate.shape))

    def _averaged(self, times: FloatArray, shares: FloatArray) -> FloatArray:
        runs = shares.reshape(-1, len(times), shares.shape[1])
        averages = np.empty_like(runs)
        for k, period in enumerate(self._periods):
            width = min(_window(times, float(period)), len(times))
            total = np.zeros((len(runs), len(times) + 1))
            np.cumsum(runs[..., k], axis=1, out=total[:, 1:])
            means = (total[:, width:] - total[:, :-width]) / width
            averages[:, : means.shape[1], k] = means
            averages[:, means.shape[1] :, k] = means[:, -1:]
        return averages.reshape(shares.shape)

    def describe(self, times: FloatArray, states: FloatArray, acting: Acting) -> list[str]:
        """Describe the largest axial load of a link in each of several runs, or "".

        states: (runs, samples, 2, n, 1 + m).
        """
        if not len(times) or not self.pieces:
            return [""] * len(states)
        if not acting.changing:  # a few samples in each period are enough
            stride = max(1, _window(times, float(self._periods.min())) // _SAMPLES)
            times, states = times[::stride], states[:, ::stride]
        shares = self.shares(times, states.reshape(-1, *states.shape[2:]), acting)
        of_runs = shares.reshape(len(states), len(times), -1)
        return list(map(self._described, of_runs.min(axis=1), of_runs.max(axis=1)))

    def _described(self, lowest: FloatArray, highest: FloatArray) -> str:
        """Describe the largest load from the extreme shares (pieces,) of a run, or ""."""
        extreme = np.where(-lowest > highest, lowest, highest)
        worst = int(np.argmax(np.abs(extreme)))
        share = float(extreme[worst])
        if not abs(share) > LARGEST_SHARE:
            return ""
        link = self.pieces[worst].link
        name = f"link {link + 1}"
        if self._arm.spec.links[link].segments > 1:
            name = f"a segment of {name}"
        kind = "tension" if share > 0.0 else "compression"
        effect = "buckles it"
        if share > -1.0:
            effect = f"changes its frequencies by {abs(np.sqrt(1.0 + share) - 1.0):.0%}"
        return (
            f"{name} carries an axial {kind} of {abs(share):.3g} times its buckling load, which "
            f"{effect} and which the linear theory neglects. Use theory='second_order'; {_PAGE}"
        )


def _window(times: FloatArray, period: float) -> int:
    """Return the number of samples in a period (s)."""
    spacing = float(times[1] - times[0]) if len(times) > 1 else 0.0
    return max(1, round(min(period / spacing, 1e9))) if spacing > 0.0 else 1


def _turned(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 2) turned by a right angle."""
    return vectors[..., ::-1] * _QUARTER


def _gains(piece: Piece) -> list[float]:
    """Return shares of a piece: of a tip force (1/N), of a uniform field (s^2/m) and spin (s^2)."""
    root = 1.0 / np.sqrt(piece.shapes.w2)
    matrices = piece.shapes.G, piece.shapes.D0, piece.shapes.D1
    return [float(np.linalg.eigvalsh(root[:, None] * M * root)[-1]) for M in matrices]


@dataclass(frozen=True, eq=False)
class Acting:
    """Loads of a run."""

    loads: Loads  # as placed
    factors: FloatArray  # of their values (samples or 1, loads)
    base: FloatArray  # accelerations of the base (samples or 1, 2), m/s^2

    @classmethod
    def constant(cls, loads: Loads) -> Acting:
        """Return loads that are constant over time."""
        return cls(loads, np.ones((1, loads.body.size)), loads.base_acceleration[None])

    def repeated(self, runs: int) -> Acting:
        """Return the same loads in several runs, one after the other."""
        if runs == 1 or len(self.base) == 1:
            return self
        return replace(
            self, factors=np.tile(self.factors, (runs, 1)), base=np.tile(self.base, (runs, 1))
        )

    @property
    def changing(self) -> bool:
        """Whether loads may change within a few samples."""
        return len(self.factors) > 1 or bool(self.loads.contacts.body.size)

    def forces(
        self, arm: Arm, states: FloatArray, along: FloatArray
    ) -> list[tuple[int, float, FloatArray]]:
        """Return body, place along it (m) and force (samples or 1, 2) N of loads and contacts."""
        found = []
        for k, body in enumerate(self.loads.body.tolist()):
            weight = float(self.loads.weight[k])
            force = self.factors[:, k, None] * (weight * self.loads.value[k, :2])
            if self.loads.follower[k]:
                axis = along[:, body]
                force = force[:, :1] * axis + force[:, 1:] * _turned(axis)
            found.append((body, float(self.loads.lever[k]) / (weight or 1.0), force))
        touched = self.loads.contacts
        if touched.body.size:
            pushes = contact_forces(arm, touched, states)
            for k, body in enumerate(touched.body.tolist()):
                found.append((body, float(touched.law[k, LEVER]), pushes[:, k]))
        return found


_estimate = once_per_arm(AxialLoads)


def closure_warning(arm: Arm, forces: FloatArray) -> str:
    """Describe the largest force of a closure beside the buckling load of its links, or ""."""
    if arm.spec.theory != "linear" or not forces.size:
        return ""
    estimate, gains = _estimate(arm), dict.fromkeys(range(arm.n_links), 0.0)
    for piece, (gain, *_) in zip(estimate.pieces, estimate.gains.tolist(), strict=True):
        gains[piece.link] = max(gains[piece.link], gain)
    numbers, largest = np.array(arm.closure_numbers), np.abs(forces).max(axis=0)
    for number, closure in enumerate(arm.spec.closures, start=1):
        rows = np.flatnonzero(numbers == number)[:2]  # not the moment of a weld
        force = float(np.hypot.reduce(largest[rows]))
        for link in (closure.link, closure.to_link or 0):
            share = force * gains.get(link - 1, 0.0)
            if share > LARGEST_SHARE:
                return (
                    f"closure {number} loads link {link} with a force of up to {share:.3g} times "
                    "the load under which the link with a free tip buckles. The linear theory "
                    f"neglects its effect on bending. Use theory='second_order'; {_PAGE}"
                )
    return ""


def axial_warnings(arm: Arm, times: FloatArray, states: FloatArray, acting: Acting) -> list[str]:
    """Describe the largest axial load that the theory of an arm neglects in each run, or "".

    states: (runs, samples, 2, n, 1 + m).
    """
    if arm.spec.theory != "linear":
        return [""] * len(states)
    return _estimate(arm).describe(times, states, acting)


def _at_rest(
    arm: Arm, q: FloatArray, environment: Environment, qd: FloatArray | None = None
) -> tuple[FloatArray, Acting]:
    """Return states and loads for the estimate at q and qd, each (dof,)."""
    rates = np.zeros_like(q) if qd is None else qd
    states = arm.padded(np.stack([q, rates]))[None]
    return states, Acting.constant(environment.placed(arm))


def warn_of_theory(
    arm: Arm, q: FloatArray, environment: Environment, qd: FloatArray | None = None
) -> None:
    """Warn once of bending or axial loads at q and qd, each (dof,), as `warn_of_bending` does."""
    states, acting = _at_rest(arm, q, environment, qd)
    loaded = axial_warnings(arm, np.zeros(1), states[None], acting)
    warn_of_first([bending_warning(arm, q), *loaded])
