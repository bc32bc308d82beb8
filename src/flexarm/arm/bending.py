"""Estimated error of the tip at a bent state, and its warning.

Both theories measure the deflection of a link, or of each segment, from the tangent at its root.
Bending shortens a piece of length L by delta = eta^T G eta / 2. The linear theory neglects this.
The second-order theory includes it and neglects terms of third order, of the size
1.7 delta sqrt(delta/L): the constant is calibrated on the elastica, between a force at the tip and
a moment there. Both estimates saturate, because the error of a piece cannot exceed a few times its
deflection. Theory page "link", section 11.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, Piece
from flexarm.arm.assembly.coordinates import once_per_arm, station_of
from flexarm.base.errors import LargeDeflectionWarning, kept_warnings, warn_caller
from flexarm.model.arm.links import Link, ModalDamping

#: Error of a link relative to its length above which a state is reported: 10 % deflection of a link
#: in one piece in the linear theory, 20 % in the second-order theory.
LARGEST_ERROR = 0.006
#: Error of the second-order theory over delta sqrt(delta/L).
_THIRD_ORDER = 1.7
#: Margin for rounding errors: a bound has to be below this fraction of the largest error.
_CLEARLY = 0.99
#: Maximum shortening relative to length, which keeps the estimate finite.
_LARGEST = 1e6
#: Number of states processed together, which bounds the scratch memory of long runs.
_CHUNK = 4096

_PAGE = "see docs/how-to/large-deflection.md."


class BendingErrors:
    """Estimate of the errors of an arm's states by its own theory, or by another one."""

    def __init__(self, arm: Arm, theory: str | None = None) -> None:
        self._linear = (arm.spec.theory if theory is None else theory) == "linear"
        pieces = arm.assembly.pieces
        self._body = np.array([piece.body for piece in pieces])
        self._link = np.array([piece.link for piece in pieces])
        self._length = np.array([piece.shapes.length for piece in pieces])
        self._G = np.zeros((len(pieces), arm.assembly.modes, arm.assembly.modes))
        for k, piece in enumerate(pieces):
            m = piece.shapes.w2.size
            self._G[k, :m, :m] = piece.shapes.G
        lengths = arm.link_lengths
        self._paths = [
            (np.array(path), np.array(beyond) / lengths[path]) for path, beyond in _paths(arm)
        ]
        self._lengths = lengths
        rows = np.zeros((arm.assembly.bodies, arm.assembly.modes))
        rows[self._body] = np.abs(self._G).sum(axis=2) / 2.0
        self._rows = rows
        self._clearly_small = _CLEARLY * LARGEST_ERROR * float(lengths.min())

    def of_links(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return errors of the links' tips (samples, links) and of the arm's tip (samples,), m.

        Of the tips of several branches, that with the largest error counts.
        """
        eta = states[:, 0, self._body, 1:]
        delta = np.einsum("tpi,pij,tpj->tp", eta, self._G, eta) / 2.0
        relative = np.maximum(delta, 0.0) / self._length
        # Runs that fail contain states of any size, whose products may not be finite.
        relative = np.where(relative < _LARGEST, relative, _LARGEST)
        third = _THIRD_ORDER * relative**1.5
        third *= relative / np.maximum(third + relative, np.finfo(float).tiny)
        error = relative / (1.0 + relative / 3.0) if self._linear else third
        shift, turn = np.zeros((2, len(states), self._lengths.size))
        np.add.at(shift.T, self._link, (error * self._length).T)
        np.add.at(turn.T, self._link, (third * self._length).T)
        # The slope of a link's tip has errors of third order, smaller under moments than forces.
        tips = [
            shift[:, path].sum(axis=1) + 0.5 * turn[:, path] @ lever for path, lever in self._paths
        ]
        return shift, np.max(tips, axis=0)

    def too_large(self, states: FloatArray) -> tuple[float, int, int] | None:
        """Return the largest error of the tip (m), the link (from 0) and the state, or None."""
        if np.all(self.surely_small(np.abs(states[:, 0, :, 1:]).max(axis=0, initial=0.0))):
            return None
        largest, worst = 0.0, None
        tip = 0.0
        for k in range(0, len(states), _CHUNK):
            own, of_tip = self.of_links(states[k : k + _CHUNK])
            relative = own / self._lengths
            tip = max(tip, float(of_tip.max(initial=0.0)))
            if relative.size and relative.max() > max(largest, LARGEST_ERROR):
                at, link = np.unravel_index(int(np.argmax(relative)), relative.shape)
                largest, worst = float(relative[at, link]), (int(link), k + int(at))
        return None if worst is None else (tip, *worst)

    def surely_small(self, eta: FloatArray) -> NDArray[np.bool_]:
        """Return whether a bound, much faster than the estimate, excludes large errors.

        ``eta`` (..., n, m) are modal coordinates, or the largest value of each. The sum of the
        errors of all links is at most the shortening of all pieces, and eta^T G eta is at most the
        sum of eta^2 times the row sums of abs(G).
        """
        # Runs that fail contain states of any size: unlike other products, einsum does not warn.
        bound = np.einsum("...ij,...ij,ij->...", eta, eta, self._rows)
        return np.asarray(bound < self._clearly_small)


def _paths(arm: Arm) -> list[tuple[list[int], list[float]]]:
    """Return the links from the base to each tip, and the lengths (m) beyond the tip of each."""
    # A rotated link also displaces everything beyond its tip.
    spec = arm.spec
    paths = []
    for end in sorted(set(range(arm.n_links)) - set(spec.parents)):
        path, beyond, there = [end], [0.0], 0.0
        while (carrier := spec.parents[path[0]]) >= 0:
            there += math.hypot(*spec.joints[path[0]].offset) + spec.links[path[0]].reach
            there -= spec.links[carrier].length - station_of(spec, path[0])
            path, beyond = [carrier, *path], [max(there, 0.0), *beyond]
        paths.append((path, beyond))
    return paths


_errors_of = once_per_arm(BendingErrors)


def theory_error(arm: Arm, states: FloatArray) -> str:
    """Describe the largest error of the theory in states (samples, 2, n, 1 + m); "" if small."""
    words = _description(arm, _errors_of(arm), states)
    if not words:
        return ""
    fact, link, error = words
    theory = "linear" if arm.spec.theory == "linear" else "second-order"
    segments = arm.spec.links[link].segments
    use = "theory='second_order' " if theory == "linear" else ""
    if segments > 1:
        advice = f"Use {use}{'or ' if use else ''}more segments on that link"
    else:
        advice = f"Use {use}{'and ' if use else ''}{_pieces(arm.spec.links[link])} on that link"
    return f"{fact}: the {theory} theory misplaces the tip by about {error}. {advice}; {_PAGE}"


def _pieces(link: Link) -> str:
    """Return the advice that divides a link into two to four segments."""
    counts = [str(k) for k in (2, 3, 4) if link.elements % k == 0]
    more = f"elements={4 * math.ceil(link.elements / 4)} and segments=2 or 4"
    advice = f"segments={' or '.join(counts)}" if counts else more
    beam = link.beam()
    if isinstance(link.damping, ModalDamping) and beam.flexural_rigidity:
        # The lowest frequency of a clamped link with the properties of the root.
        omega = 1.875104**2 * math.sqrt(beam.flexural_rigidity[0] / beam.mass_per_length[0])
        coefficient = 2.0 * np.ravel(link.damping.ratio)[0] * link.length**2 / omega
        advice += f", with rayleigh damping (stiffness_coefficient {coefficient:.2g} s),"
    return advice


def too_far_deviated(arm: Arm, states: FloatArray) -> str:
    """Describe the error of linear deviations, always that of the linear theory; "" if small."""
    words = _description(arm, BendingErrors(arm, "linear"), states)
    if not words:
        return ""
    return (
        f"{words[0]}: linear deviations misplace the tip by about {words[2]}. fa.simulate follows "
        f"the whole motion, with theory='second_order' where links bend that far; {_PAGE}"
    )


def _description(
    arm: Arm, errors: BendingErrors, states: FloatArray
) -> tuple[str, int, str] | None:
    worst = errors.too_large(states)
    if worst is None:
        return None
    tip, link, at = worst
    shapes, eta = arm.assembly.constants.P, states[at, 0, :, 1:]

    def deflection_of(piece: Piece) -> float:
        return abs(float(shapes[piece.body] @ eta[piece.body]))

    pieces = arm.assembly.pieces_of(link)
    piece = max(pieces, key=lambda piece: deflection_of(piece) / piece.shapes.length)
    name = f"link {link + 1}"
    if arm.spec.links[link].segments > 1:
        name = f"a segment of {name}"
    length, deflection = piece.shapes.length, deflection_of(piece)
    fact = (
        f"{name} deflects by up to {deflection:.3g} m, {deflection / length:.0%} of its length of "
        f"{length:.4g} m"
    )
    size = f"{1e3 * tip:.0f}" if tip >= 0.01 else f"{1e3 * tip:.2g}"
    return fact, link, f"{size} mm ({tip / arm.reach:.1%} of the reach)"


def bending_warning(arm: Arm, q: FloatArray) -> str:
    """Describe the largest error at q (dof,) or (samples, dof); return an empty text if small."""
    states = arm.padded(np.stack([q, np.zeros_like(q)], axis=-2))
    return theory_error(arm, states.reshape(-1, *states.shape[-3:]))


def warn_of_bending(arm: Arm, q: FloatArray) -> None:
    """Warn once of bent q (dof,) or (samples, dof)."""
    warn_of_first([bending_warning(arm, q)])


def warn_of_first(texts: list[str]) -> None:
    """Report the first text that is not empty as a warning, as `warn_of_bending` does."""
    if text := next(filter(None, texts), ""):
        warn_caller(_OfStates(text), LargeDeflectionWarning)


class _OfStates(str):
    """Text of a warning of which `one_warning` reports the first one only."""


@contextmanager
def one_warning(report: bool = True) -> Iterator[None]:
    """Report the first warning of bent states by the calls within, or none of them."""
    with kept_warnings(LargeDeflectionWarning) as kept:
        yield
    for text, kind in kept:
        if report or not isinstance(text, _OfStates):
            warn_caller(text, kind)
        report = report and not isinstance(text, _OfStates)
