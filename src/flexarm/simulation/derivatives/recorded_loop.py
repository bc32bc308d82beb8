"""A closed loop that stores the derivatives of the updates of its controller."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.analysis.linear_controller import LinearController
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.model import Hardware, Instrument
from flexarm.simulation.derivatives.update_derivatives import UpdateDerivatives
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.closed_loop import ClosedLoop
from flexarm.simulation.loop.sensors import measured_names
from flexarm.simulation.run.stepping import Run


class RecordedLoop(ClosedLoop):
    """Closed loop that stores the derivatives of the updates of its controller.

    Args:
        signals: channels that may be measured.

    Attributes:
        updates: derivatives of each update, with columns for the readings in ``labels``.
        instruments: one for each measured channel; their numbers of readings are known after a run.

    Raises:
        InputError: if controller, hardware and arm do not fit each other, or the hardware or the
            integrator is not supported with derivatives.
    """

    def __init__(
        self,
        run: Run,
        controller: Controller,
        reference: Reference | None,
        hardware: Hardware | None,
        signals: Sequence[str],
    ) -> None:
        super().__init__(run, controller, reference, hardware)
        if run.default_step is not None:
            rule = f"is required for {run.integrator.name} with derivatives of closed loops"
            raise InputError(Problem("step", rule))
        self.instruments = _instruments(run, hardware)
        self._limited = [item for item in self.instruments if np.isfinite(item.limit)]
        self._signals = signals
        self._refuse_instruments()
        self.updates: list[LinearController] = []
        self.sizes: dict[str, int] = {}
        self._used: set[str] = set()  # readings that the last update depends on
        self._ever_used: set[str] = set()
        self._reached: set[str] = set()  # rates that include a reading at the limit
        self._derivatives = UpdateDerivatives(controller, self._reference)

    @property
    def history(self) -> PiecewiseCubic:
        """Torque of a hold interval, zero here: the loop in dual numbers writes its own."""
        pieces = self._schedule.acting.pieces
        held = np.zeros((pieces, 4, self._run.arm.joints))
        return PiecewiseCubic(np.arange(pieces + 1.0), held, np.zeros(0))

    @property
    def stored(self) -> list[str]:
        """Names of the first readings that the controller stores without declaring it."""
        return self._derivatives.stored

    @property
    def needed(self) -> list[Instrument]:
        """Instruments whose readings an update depends on, or the controller stores."""
        names = self._ever_used.union(self.stored)
        return [item for item in self.instruments if not names.isdisjoint(item.labels)]

    def _refuse_instruments(self) -> None:
        """Raise if a reading of an instrument of the hardware has no derivative.

        Raises:
            InputError: if it is rounded, or its signal is not a channel of the states.
        """
        problems = []
        given = self.hardware.instruments if self.hardware is not None else None
        for k, item in enumerate(given or ()):
            name = f"hardware.instruments[{k}]"
            if item.resolution > 0.0:
                rule = "is not supported with derivatives of runs"
                hint = "Rounded readings have no derivative. Leave it out, or add noise instead."
                problems.append(Problem(f"{name}.resolution", rule, hint=hint))
            if item.output not in self._signals:
                rule = "be a channel that follows from q and qd, for derivatives of runs"
                problems.append(Problem(f"{name}.signal", rule, shown(item.signal)))
        if problems:
            raise InputError(*problems)

    def _update(self, t: float, measurement: Measurement) -> FloatArray:
        if not self.updates:
            self.sizes = {name: value.size for name, value in measurement.items()}
        self._derivatives.remember()
        torque = super()._update(t, measurement)
        update = self._derivatives.after(t, measurement, torque)
        if not self.updates or update is not self.updates[-1]:
            self._used = self._readings_of(update, measurement)
            self._ever_used |= self._used
        for item in self._limited:
            now = np.any(np.abs(measurement[item.label]) >= item.limit)
            self._reached |= set(item.labels[1:] if now else ())
            used = self._used.intersection(item.labels)
            if used & self._reached or (used and now):
                rule = f"is reached by {item.label}, which has no derivative there"
                raise InputError(Problem("hardware.instruments.limit", rule))
        self.updates.append(update)
        return torque

    def _readings_of(self, update: LinearController, measurement: Measurement) -> set[str]:
        """Return the names of the readings that an update uses.

        Raises:
            InputError: if it uses a reading without a derivative.
        """
        start, found = 0, set()
        for name, value in measurement.items():
            part = slice(start, start + value.size)
            start += value.size
            if not (np.any(update.B[:, part]) or np.any(update.D[:, part])):
                continue
            if not any(name in item.labels for item in self.instruments):
                rule = f"reads {name}, which is not supported with derivatives of runs"
                raise InputError(Problem("controller", rule))
            found.add(name)
        return found


def _instruments(run: Run, hardware: Hardware | None) -> list[Instrument]:
    """Return the instruments of the hardware; without it, ideal ones of the supported readings."""
    if hardware is not None and hardware.instruments is not None:
        return list(hardware.instruments)
    names = measured_names(run.arm, None, 0)
    return [Instrument(name) for name in names]
