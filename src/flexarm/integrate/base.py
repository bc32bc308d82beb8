"""Contract of integrators, and their common data.

An integrator is a small value object that contains only the parameters of its method. It follows
these rules (``tests/conformance/test_every_integrator.py`` checks each for every entry of the
registry):

1. ``advance`` carries ``progress`` from its time to ``until`` and fills the samples that it passes.
   It may return earlier (``Status.PAUSED``) so that the caller can show progress.
2. Samples are values at exactly the requested times, by dense output of at least third order.
3. A step ends exactly at every time in ``drive.stops``, because the torque is not smooth there.
4. At a stop, the step that ends there uses the torque from the left, and the step that starts there
   uses the torque from the right.
5. After a failure, the last good state is kept and a status gives the reason, never NaN.
6. The observed order is the stated order.
7. It never calls Python, and it allocates nothing per step.
8. An adaptive method ends a step where a joint meets or leaves a stop or a contact opens or closes
   (``integrate.switching``); a fixed-step method ends a run that diverges with a status
   (``steps.followed``).
9. A method that follows sticking locks joints that stick (``integrate.sticking``), and an adaptive
   one ends a step where a joint sticks or slips (``integrate.stick_events``).
10. A method that follows contacts never skips a contact between steps (``integrate.nearness``), and
    a fixed step that is too long for a contact ends with a status.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.memory import STEP, TIME, WHOLE, Memory, new_memory
from flexarm.integrate.status import Status as Status
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.layout import ArmConstants, Loads, Sizes, Workspace

FloatArray = NDArray[np.float64]

#: Statuses by their codes.
_STATUSES = {status.value: status for status in Status}
#: First step of an integrator without a given one, times the highest frequency.
_FIRST = 0.5


class Drive(NamedTuple):
    """Torques and loads over time, in the form that the kernels read.

    The torque is a piecewise cubic: on piece k, ``sum_p coefficients[k, p] (t - breaks[k])^p``.
    The first piece extends before the first break, the last piece beyond the last break.
    """

    breaks: FloatArray  # (pieces + 1,) s, ascending
    coefficients: FloatArray  # (pieces, 4, n) N m / s^p
    stops: FloatArray  # (stops,) s, ascending: times where the torque is not smooth
    loads: Loads  # ``value`` and ``base_acceleration`` are overwritten at each time
    amplitude: FloatArray  # (k, 3) of the loads at factor one
    factor_breaks: FloatArray  # (pieces + 1,) s
    factor_coefficients: FloatArray  # (pieces, 4, k + 2) factors, base acceleration x, y


class System(NamedTuple):
    """Arm, drive and workspace of an integrator."""

    sizes: Sizes
    constants: ArmConstants
    drive: Drive
    work: Workspace


class Tolerance(NamedTuple):
    """Allowed error of one step, in lengths of ``scale``; see ``flexarm.simulation.run.tolerance``.

    The allowed error of a joint angle is ``absolute * unit + relative * |angle|``; that of a mode
    is ``unit * (absolute + relative * d)`` with ``d`` the largest ``|mode| / unit`` of its body. A
    stiff mode, whose value has little effect on the tip, therefore neither determines the step nor
    is neglected beside the joint angles.
    """

    absolute: float  # displacement of the tip over the scale
    relative: float
    unit: FloatArray  # (2, n, 1 + m): coordinate or rate per tip displacement of one scale
    fastest: float  # rad/s, bound on the highest frequency
    scale: float = 1.0  # m: reach of the arm by default, one metre for a given absolute tolerance


@dataclass
class Progress:
    """Progress of a run; ``advance`` updates it in place."""

    time: float
    state: FloatArray  # (2, n, 1 + m)
    step: float  # next step to try, s; 0: the integrator chooses it
    sample: int = 0  # samples filled so far
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    impacts: int = 0  # steps of an adaptive method that ended where a joint met or left a stop
    touches: int = 0  # the same for contacts that opened or closed
    memory: Memory | None = None  # None: no data of earlier steps
    method: tuple[Any, ...] | None = None  # record of the integrator for the same steps
    entry: Entry | None = None  # cached entry point of the stepper

    def enter(
        self,
        stepper: Callable[..., int],
        system: System,
        tolerance: Tolerance,
        memory: Memory,
        until: float,
        max_steps: int,
        *more: Any,
    ) -> Status:
        """Call the stepper of the run's integrator, and read its results from the memory.

        A loop of ``sampled_law`` has ``more`` arguments.

        ``Entry`` requires that the arguments of a run keep their types, which they do.
        """
        if self.entry is None or self.entry.kernel is not stepper:
            self.entry = Entry(stepper)
        memory.clock[TIME] = self.time
        counts = [
            self.sample, self.steps, self.rejected, self.evaluations, self.impacts, self.touches,
        ]  # fmt: skip
        # Sampled loops call this at every sample time, where lists are faster than small arrays.
        if memory.counts.tolist() != counts:
            memory.counts[:] = counts
        status = self.entry(system, tolerance, self.method, memory, float(until), max_steps, *more)
        clock, counts = memory.clock.tolist(), memory.counts.tolist()
        self.time = clock[TIME]
        # A step that is shortened to end at a change of sticking says nothing about the run.
        self.step = max(clock[STEP], clock[WHOLE])
        self.sample, self.steps, self.rejected, self.evaluations, self.impacts, self.touches = (
            counts
        )
        return _STATUSES[status]


@dataclass(frozen=True)
class Integrator(ABC):
    """Base class of all integrators; subclasses add fields for their parameters.

    A subclass defines its compiled ``stepper``, which is called as ``stepper(system, tolerance,
    record, memory, until, max_steps)`` and returns a code of ``status``, and creates its
    ``record``.

    Class attributes: ``name`` in the registry; ``order``; ``adaptive``; ``follows_contacts``, False
    for a multistep method, which requires smooth motion between stops; ``follows_bristles``,
    whether it has step control and supports friction with bristles; ``follows_sticking``, whether
    it changes the equations where a joint starts to stick or to slip; ``follows_closures``, whether
    it keeps the loops of a mechanism closed; and ``reference``, the BibTeX
    keys of the method (``flexarm.citation``).

    Args:
        step: fixed step (s), shortened to end at every stop; None: ``simulate`` chooses it
            (``flexarm.simulation.run.default_step``). For a method with step control, the first
            step to try; None: half a radian of the fastest mode.
    """

    step: float | None = None

    name: ClassVar[str] = ""
    order: ClassVar[int] = 0
    adaptive: ClassVar[bool] = False
    follows_contacts: ClassVar[bool] = True
    follows_bristles: ClassVar[bool] = False
    follows_sticking: ClassVar[bool] = False
    follows_closures: ClassVar[bool] = False
    reference: ClassVar[tuple[str, ...]] = ()
    stepper: ClassVar[Callable[..., int]]

    @abstractmethod
    def record(self, constants: ArmConstants, state: FloatArray) -> tuple[Any, ...]:
        """Return the coefficients of the method, and its own arrays for a run from ``state``."""

    def first_step(self, fastest: float) -> float:
        """Return the first step (s) of a run; ``fastest``: bound on the frequencies, rad/s."""
        return self.step or _FIRST / fastest

    def advance(
        self,
        system: System,
        tolerance: Tolerance,
        progress: Progress,
        until: float,
        sample_times: FloatArray,
        samples: FloatArray,
        max_steps: int,
    ) -> Status:
        """Carry ``progress`` to ``until`` (s), with at most ``max_steps`` steps in this call.

        ``sample_times`` (samples,) ascending; the states at these times are written to ``samples``
        (samples, 2, n, 1 + m), from ``progress.sample`` on.
        """
        memory, state = progress.memory, progress.state
        if memory is None:
            step = float(self.step or progress.step or self.first_step(tolerance.fastest))
            memory = new_memory(state, step)
            progress.method = self.record(system.constants, state)
        arrays = memory.state, memory.sample_times, memory.samples
        if arrays[0] is not state or arrays[1] is not sample_times or arrays[2] is not samples:
            memory = memory._replace(state=state, sample_times=sample_times, samples=samples)
        progress.memory = memory
        return progress.enter(self.stepper, system, tolerance, memory, until, max_steps)
