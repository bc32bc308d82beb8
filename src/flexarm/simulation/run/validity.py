"""Limits of the linear beam theory during a run: checks for large deflection."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.bending import LARGEST_ERROR, BendingErrors, theory_error
from flexarm.integrate.base import FloatArray
from flexarm.linear.statics.axial import Acting, axial_warnings
from flexarm.simulation.histories.loads import LoadHistory

#: Ratio of deflection to length that no real link reaches.
_ABSURD = 10.0


class RunawayWatch:
    """Detection of a link that bends by many times its length, a sign of an unstable loop.

    The linear theory itself has no limit on the deflection. The check is fast enough for every
    sample time, and has to be made that often because a link swings back between samples.

    Attributes:
        surely_small: modal coordinates below it are not reported.
    """

    def __init__(self, arm: Arm) -> None:
        pieces = arm.assembly.pieces
        self._bodies = np.array([piece.body for piece in pieces])
        self._links = [piece.link for piece in pieces]
        self._lengths = np.array([piece.shapes.length for piece in pieces])
        self._at_end = arm.assembly.constants.P[self._bodies]
        # No link bends by more than this times the largest of all modal coordinates.
        most = np.abs(self._at_end).sum(axis=1) / self._lengths
        self.surely_small = _ABSURD / max(float(most.max(initial=0.0)), 1e-300)
        self._surely_small_square = self.surely_small * self.surely_small

    def __call__(self, state: FloatArray) -> str:
        """Describe the runaway link of a state (2, n, 1 + m); return empty text without one."""
        coordinates = state[0].ravel()
        # The root of the sum of squares is at least the largest number, and is fast to compute.
        if coordinates.dot(coordinates) < self._surely_small_square:
            return ""
        if np.abs(state[0, :, 1:]).max(initial=0.0) < self.surely_small:
            return ""
        bent = np.abs((self._at_end * state[0, self._bodies, 1:]).sum(axis=1)) / self._lengths
        worst = bent.argmax()
        if not bent[worst] > _ABSURD:
            return ""
        return f"link {self._links[worst] + 1} has bent by {bent[worst]:.3g} times its length"


def axial_loads(arm: Arm, times: FloatArray, states: FloatArray, loads: LoadHistory) -> list[str]:
    """Describe the largest axial load that the theory neglects in each run; empty if small.

    states: (runs, samples, 2, n, 1 + m).
    """
    if arm.spec.theory != "linear":
        return [""] * len(states)
    acting = Acting.constant(loads.placed)
    if loads.factors.coefficients.shape[2]:
        values = loads.factors.at(times)
        acting = Acting(loads.placed, values[:, :-2], values[:, -2:])
    return axial_warnings(arm, times, states, acting)


class BendingWatch:
    """Repeated evaluation of ``theory_error``, fast enough for every sample time."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._errors = arm, BendingErrors(arm)
        self._allowed = LARGEST_ERROR * arm.link_lengths

    def __call__(self, state: FloatArray) -> str:
        """Describe the error of the theory at a state (2, n, 1 + m); empty text if it is small."""
        small = self._errors.surely_small(state[0, :, 1:])
        return "" if small else self.of_many(state[None]).get(0, "")

    def of_many(self, states: FloatArray) -> dict[int, str]:
        """Describe the errors at states (k, 2, n, 1 + m), by number, where they are not small."""
        possible = np.flatnonzero(~self._errors.surely_small(states[:, 0, :, 1:]))
        if not possible.size:
            return {}
        large = (self._errors.of_links(states[possible])[0] > self._allowed).any(axis=1)
        return {int(k): theory_error(self._arm, states[k, None]) for k in possible[large]}
