"""Choice of a law of learning by the arguments of ``iterative_learning``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each, check_nonnegative, check_positive
from flexarm.base.errors import InputError, Problem
from flexarm.control.contract.base import Reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.planning.learning.bench import joint_errors
from flexarm.planning.learning.laws import Law, filtered, norm_optimal, proportional_derivative
from flexarm.planning.learning.lifted import Window


class Choice(NamedTuple):
    """Valid parameters of a law, with the meaning that ``iterative_learning`` gives them."""

    effort: float
    change: float
    proportional: FloatArray | None
    derivative: FloatArray
    lead: float
    cutoff: float | None

    def law(
        self, P: FloatArray, arm: Arm, reference: Reference, window: Window, output: str
    ) -> Law:
        """Return the law for a lifted model ``P`` (N p, N joints)."""
        if self.proportional is None:
            law = norm_optimal(P, self.effort, self.change)
        else:
            inverse = joint_errors(arm, reference, window, output)
            lead = min(round(self.lead / window.interval), window.intervals - 1)
            gains = self.proportional, self.derivative
            law = proportional_derivative(inverse, *gains, lead, window.interval)
        if self.cutoff is None:
            return law
        return filtered(law, arm.joints, self.cutoff, window.interval)


def check_choice_of_law(
    joints: int,
    effort: float,
    change: float,
    proportional: ArrayLike | None,
    derivative: ArrayLike,
    lead: float,
    cutoff: float | None,
) -> Choice:
    """Return the validated parameters of a law.

    Raises:
        InputError: if a number is negative or not finite, has another number of joints, or
            parameters of both laws are given.
    """
    weights = check_nonnegative("effort", effort), check_nonnegative("change", change)
    given = {"derivative": derivative, "proportional": proportional}
    gains = {
        name: _per_joint(name, value, joints) for name, value in given.items() if value is not None
    }
    lead = check_nonnegative("lead", lead)
    highest = None if cutoff is None else check_positive("cutoff", cutoff)
    if proportional is None and (np.any(gains["derivative"]) or lead):
        raise InputError(Problem("proportional", "is required with derivative or lead"))
    if proportional is not None and weights[1]:
        raise InputError(Problem("change", "cannot be combined with proportional"))
    if proportional is None and sum(weights) == 0.0:
        hint = "Without them, the torques would be arbitrarily large."
        raise InputError(Problem("effort", "be positive if change is 0", "0", hint))
    return Choice(*weights, gains.get("proportional"), gains["derivative"], lead, highest)


def _per_joint(name: str, value: ArrayLike, joints: int) -> FloatArray:
    found: FloatArray = np.full(joints, check_each(name, value, joints))
    if np.any(found < 0.0):
        raise InputError(Problem(name, "be at least 0", str(found.min())))
    return found
