"""Advance of many runs in lanes, by the stepper of their method."""

from __future__ import annotations

from collections.abc import Iterable
from threading import local
from typing import Any, NamedTuple

import numpy as np

from flexarm.integrate.base import Integrator, System, Tolerance
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive
from flexarm.integrate.lanes.additive import AdditiveLanes, advance_additive_lanes
from flexarm.integrate.lanes.data import (
    LaneContacts,
    LaneDrive,
    LaneMemory,
    LaneRuns,
    StepControl,
)
from flexarm.integrate.lanes.explicit import ExplicitLanes, advance_explicit_lanes
from flexarm.integrate.steps import LONGEST
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.packs import LANES, Packs
from flexarm.kernels.layout import (
    ArmConstants,
    Contacts,
    Loads,
    Workspace,
    new_workspace,
    run_time_sizes,
)

#: Integrators that have a stepper for lanes.
LaneIntegrator = ExplicitRungeKutta | Additive
#: Arrays of loads that differ in time, and those that differ from arm to arm.
LOAD_VALUES = ("value", "base_acceleration")
LOAD_PLACES = ("weight", "lever", "rows", "slopes", "shortening")
#: Arrays of contacts that differ from arm to arm.
CONTACT_PLACES = ("rows", "shortening", "law")


def lane_method(method: Integrator) -> LaneIntegrator | None:
    """Return the method if lanes have it, with step control or a given step; otherwise None."""
    if isinstance(method, LaneIntegrator) and (method.adaptive or method.step is not None):
        return method
    return None


class _Call(NamedTuple):
    """Stepper of a method, with its arguments that remain the same; of one thread."""

    entry: Entry
    given: tuple[Any, ...]
    memory: LaneMemory


class LaneStepper:
    """Steppers and scratch of one arm; several threads may use them at the same time.

    Args:
        constants: of the arm.
        loads: of the arm, with its contacts.
        tolerance: allowed errors; each run has its own highest frequency.
        several: whether runs have arms of their own, with arrays of the same sizes.
    """

    def __init__(
        self,
        constants: ArmConstants,
        loads: Loads,
        tolerance: Tolerance,
        several: bool = False,
    ) -> None:
        self._constants, self._loads = constants, loads
        self._tolerance, self._several = tolerance, several
        self._sizes = run_time_sizes(constants)
        self._thread = local()

    def advance(
        self, method: LaneIntegrator, drive: LaneDrive, runs: LaneRuns, max_steps: int
    ) -> None:
        """Advance all runs to their ends, or until they fail or have made ``max_steps`` steps."""
        call = self._call(method, drive)
        call.entry(*call.given, drive, runs, call.memory, max_steps)

    def _call(self, method: LaneIntegrator, drive: LaneDrive) -> _Call:
        """Return the stepper of a method with the scratch of the present thread."""
        calls: dict[str, _Call] = self._thread.__dict__.setdefault("calls", {})
        if method.name not in calls:
            sizes = self._sizes
            own = self._constants, self._loads, self._tolerance
            memory = _new_memory(*own, method, self._several)
            constants, tolerance = memory.constants, self._tolerance._replace(unit=memory.unit)
            if isinstance(method, Additive):
                system = System(sizes, constants, drive, memory.work)  # type: ignore[arg-type]
                additive = system, tolerance, _additive(method)
                calls[method.name] = _Call(Entry(advance_additive_lanes), additive, memory)
            else:
                explicit = sizes, constants, tolerance, _explicit(method)
                calls[method.name] = _Call(Entry(advance_explicit_lanes), explicit, memory)
        return calls[method.name]


def _control(method: LaneIntegrator, longest: float) -> StepControl:
    tableau = method.tableau
    return StepControl(tableau.error, tableau.order, method.adaptive, longest)


def _explicit(method: ExplicitRungeKutta) -> ExplicitLanes:
    control = _control(method, LONGEST if method.adaptive else np.inf)
    tableau = method.tableau
    return ExplicitLanes(control, tableau.A, tableau.c, tableau.dense)


def _additive(method: Additive) -> AdditiveLanes:
    tableau = method.tableau
    return AdditiveLanes(_control(method, np.inf), tableau.explicit, tableau.implicit, tableau.c)


def _new_memory(
    constants: ArmConstants, loads: Loads, tolerance: Tolerance, method: LaneIntegrator,
    several: bool,
) -> LaneMemory:  # fmt: skip
    """Allocate the scratch of a thread for a method."""
    n, m = constants.S.shape
    rows = len(method.tableau.c)
    work: Any = {
        name: Packs.zeros(*array.shape)
        for name, array in new_workspace(constants)._asdict().items()
    }
    # Arms of their own need all constants in packs, an implicit step only those that it changes.
    everything, changed = constants._fields, ("body", "mode")
    return LaneMemory(
        constants=_in_packs(constants, everything) if several else constants,
        softened=_in_packs(constants, everything if several else changed),
        unit=Packs.of(tolerance.unit) if several else tolerance.unit,
        known=Packs.zeros(2, n, 1 + m),
        state=Packs.zeros(2, n, 1 + m),
        new=Packs.zeros(2, n, 1 + m),
        point=Packs.zeros(2, n, 1 + m),
        torque=Packs.zeros(n),
        stages=Packs.zeros(rows, 2, n, 1 + m),
        step=Packs.zeros(1),
        norm=Packs.zeros(4),
        accepted=Packs.zeros(1),
        work=Workspace(**work),
        loads=_loads_of_lanes(loads, several),
        contacts=_no_contacts(loads.contacts, method.adaptive),
        weights=np.zeros((1, rows)),
        run=np.full(LANES, -1),
        fresh=np.zeros(LANES, dtype=np.int64),
        lands=np.zeros(LANES, dtype=np.int64),
        piece=np.zeros(LANES, dtype=np.int64),
        end=np.zeros(LANES),
    )


def _loads_of_lanes(loads: Loads, several: bool) -> Loads:
    own: Loads = _in_packs(loads, LOAD_VALUES + LOAD_PLACES * several)
    return own._replace(contacts=_in_packs(loads.contacts, CONTACT_PLACES * several))


def _no_contacts(contacts: Contacts, adaptive: bool) -> LaneContacts:
    """Allocate the contacts of the lanes."""
    seen = np.zeros((LANES, *contacts.seen.shape))
    return LaneContacts(np.zeros((LANES, *contacts.law.shape)), seen, Packs.zeros(6), adaptive)


def _in_packs(record: Any, names: Iterable[str]) -> Any:
    """Return a record with packs in place of some of its arrays."""
    return record._replace(**{name: Packs.of(getattr(record, name)) for name in names})
