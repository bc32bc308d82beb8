"""Which integrator a run gets, and why."""

from __future__ import annotations

from typing import NamedTuple

from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.integrate import INTEGRATORS, DormandPrince8, Integrator, RungeKutta4


class Choice(NamedTuple):
    """An integrator and the sentence that explains it."""

    integrator: Integrator
    reason: str


def choose_integrator(
    asked: str | Integrator, step: float | None, where: str = "simulate"
) -> Choice:
    """Resolve what the user asked for.

    Raises:
        InputError: no integrator has that name, or the step is not a positive time.
    """
    if step is not None and check_array(where, "step", step, ()) <= 0.0:
        raise InputError(Problem(where, "step", "be greater than 0", shown(step)))
    if isinstance(asked, Integrator):
        return Choice(asked, "given by the user")
    if asked == "auto":
        if step is not None:
            return Choice(RungeKutta4(step=step), "fixed step asked for")
        return Choice(
            DormandPrince8(),
            "order 8 with step control: fewest evaluations at the tolerances in use",
        )
    if not isinstance(asked, str) or asked not in INTEGRATORS:
        names = ", ".join(repr(name) for name in ("auto", *INTEGRATORS))
        raise InputError(Problem(where, "integrator", f"be one of {names}", shown(asked)))
    return Choice(INTEGRATORS[asked](step=step), "named by the user")  # type: ignore[call-arg]
