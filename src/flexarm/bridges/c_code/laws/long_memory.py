"""Memory of many numbers, on which exported code operates in loops.

Symbols for all of them would become one statement each. The traced update has symbols for the few
numbers alone that its torque depends on, the ``view``. Its results for the memory are ``stored``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from flexarm.bridges.c_code.named_function import NamedFunction, named
from flexarm.bridges.symbolic.kernel_calls import symbolic
from flexarm.bridges.symbolic.scalars import objects, plain
from flexarm.control.laws import RBFAdaptive, RepetitiveControl
from flexarm.control.laws.uncertain.repetitive import PeriodHistory
from flexarm.kernels.controller_terms.adaptation import network_torque

_Call = Callable[..., dict[str, Any]]


class LongMemory(ABC):
    """Numbers of a controller that the traced update does not contain: a memory, or a table.

    Attributes:
        size: number of numbers in the memory.
    """

    size: int

    @abstractmethod
    def trace(self, mine: Any, array: Callable[..., Any]) -> None:
        """Let a symbolic controller use a view, ``array("view", ...)``, in its next update."""

    @abstractmethod
    def stored(self, mine: Any) -> list[Any]:
        """Return the results of the last update on which the memory or the view depends."""

    @abstractmethod
    def _advance(self, call: _Call, memory: Any) -> tuple[dict[str, Any], Any]:
        """Return the results of the update and the next memory.

        Args:
            call: function of the view, and of the names of results; by default all of them.
            memory: column of numbers.
        """

    def around(self, core: NamedFunction) -> NamedFunction:
        """Return a function with this memory, after the numbers in the memory of ``core``."""
        inner = core.function
        sizes = {name: inner.numel_in(name) for name in inner.name_in() if name != "view"}
        own = sizes.pop("memory", 0)
        symbols = {name: casadi.MX.sym(name, size) for name, size in sizes.items()}
        given = dict(symbols)
        if core.name == "controller_start":
            memory = casadi.MX.zeros(self.size)
        else:
            symbols["memory"] = casadi.MX.sym("memory", own + self.size)
            memory = symbols["memory"][own:]
            given |= {"memory": symbols["memory"][:own]} if own else {}

        def call(view: Any, *results: str) -> dict[str, Any]:
            function = inner.factory("part", inner.name_in(), results) if results else inner
            # Functions of C return columns as rows.
            return {name: row.T for name, row in function(**given, view=view).items()}

        found, memory = self._advance(call, memory)
        kept = [found["memory_out"]] if "memory_out" in inner.name_out() else []
        outputs = {"memory_out": casadi.vertcat(*kept, memory), "torque": found["torque"]}
        return named(core.name, core.summary, symbols, outputs)


class DelayLine(LongMemory):
    """Sums of learned torque and error of `RepetitiveControl`, the oldest first.

    The view contains the oldest sums, those in the window of the filter.
    """

    def __init__(self, controller: RepetitiveControl, joints: int) -> None:
        count, lead = controller._samples()
        self._weights = controller._filter()
        self._joints, self._lead = joints, lead
        self.size = (count + len(self._weights) // 2) * joints

    def trace(self, mine: Any, array: Callable[..., Any]) -> None:
        """See `LongMemory.trace`."""
        mine._history = _TracedHistory(
            self._weights, array("view", len(self._weights), self._joints)
        )
        mine._held = np.zeros(self._joints)  # without effect, because there is a reference

    def stored(self, mine: Any) -> list[Any]:
        """Return the learned torque and the error, (joints,) each."""
        found: list[Any] = mine._history.stored
        return found

    def _advance(self, call: _Call, memory: Any) -> tuple[dict[str, Any], Any]:
        n = self._joints
        found = call(memory[: len(self._weights) * n])
        learned, error = casadi.vertsplit(found["stored"], n)
        line = casadi.vertcat(memory[n:], learned)
        place = self.size - (1 + self._lead) * n
        parts = line[:place], line[place : place + n] + error, line[place + n :]
        return found, casadi.vertcat(*parts)


class _TracedHistory(PeriodHistory):
    """History whose window is a view."""

    def __init__(self, weights: Any, view: Any) -> None:
        self._weights, self._view = weights, view

    def _window(self) -> Any:
        return self._view

    def _store(self, learned: Any, error: Any) -> None:
        self.stored = [*learned, *error]


class Network(LongMemory):
    """Weights (Gaussians, joints, signals) of `RBFAdaptive`. The view is the network's torque."""

    def __init__(self, controller: Any) -> None:
        self._own, self._kernel = controller, symbolic(network_torque)
        self.size = controller._weights.size

    def trace(self, mine: Any, array: Callable[..., Any]) -> None:
        """See `LongMemory.trace`."""
        view = array("view", self._own.arm.joints)
        mine._law = lambda *arguments: self._rest(mine, view, *arguments)

    def _rest(self, mine: Any, view: Any, angle: Any, signals: Any, error: Any, *more: Any) -> None:
        """Replace the kernel: evaluate it without Gaussians, and add the view."""
        centres, *numbers, weights, torque = more
        self._kernel(angle, signals, error, centres[:0], *numbers, weights[:, :0], torque)
        torque += view
        mine._stored = [*angle, *signals, *error]

    def stored(self, mine: Any) -> list[Any]:
        """Return the inputs of the network: angles, signals and errors."""
        found: list[Any] = mine._stored
        return found

    def _advance(self, call: _Call, memory: Any) -> tuple[dict[str, Any], Any]:
        own = self._own
        joints, count, signals = own._weights.shape
        given = casadi.vertsplit(
            call(casadi.MX.zeros(joints), "stored")["stored"],
            [0, joints, joints + signals, 2 * joints + signals],
        )
        every = self._gaussian().map("gaussians", "serial", count, [0, 1, 2], [0])
        weights = casadi.reshape(memory, joints * signals, count)
        torque, after = every(*given, casadi.DM(own._centres.T), weights)
        return call(torque), casadi.vec(after)

    def _gaussian(self) -> Any:
        """Return the function of one Gaussian: its torque without damping, and its weights."""
        own = self._own
        joints, _, signals = own._weights.shape
        sizes = {"angle": joints, "signals": signals, "error": joints, "centre": joints}
        sizes["weights"] = joints * signals
        symbols = [casadi.SX.sym(name, size) for name, size in sizes.items()]
        angle, values, error, centre, weights = (
            objects(casadi.vertsplit(one), casadi) for one in symbols
        )
        weights, torque = weights.reshape(joints, 1, signals), np.zeros(joints, dtype=object)
        numbers = own.adaptation, own.leakage, own.e_modification, own.sample_time
        self._kernel(
            angle,
            values,
            error,
            centre[None],
            own._sharpness,
            np.zeros(joints),
            *numbers,
            weights,
            torque,
        )
        columns = [casadi.vertcat(*map(plain, one.ravel())) for one in (torque, weights)]
        return casadi.Function("gaussian", symbols, columns)


def long_memory(controller: Any, joints: int) -> LongMemory | None:
    """Return the long memory of a controller, or None."""
    if isinstance(controller, RepetitiveControl):
        return DelayLine(controller, joints)
    return Network(controller) if isinstance(controller, RBFAdaptive) else None
