"""What an integrator is, and what it says about a run.

An integrator is a small value object that carries only the parameters of its method. The rules it
keeps (``tests/conformance/test_every_integrator.py`` checks each for every entry of the registry):

1. ``advance`` carries ``progress`` from its time to ``until`` and fills the samples that it passes.
   It may return before that (``Status.PAUSED``) so that the caller can show progress.
2. Samples are values at exactly the asked times, by dense output of at least third order.
3. It lands exactly on every time in ``drive.stops``: there the torque is not smooth.
4. At a stop it uses the torque from the left for the step that ends there, from the right for the
   step that starts there.
5. It keeps the last good state when it gives up, and says why with a status, never with NaN.
6. Its observed order is the order it claims.
7. It never calls Python, and it allocates nothing per step.
8. An adaptive method ends a step where a joint meets or leaves a stop (``integrate.joint_stops``);
   a method of fixed steps ends a run that diverges with a status (``steps.followed``).
9. Where it follows contacts, no step passes a surface unseen (``integrate.nearness``), and a fixed
   step that is too long for a touch ends with a status.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.memory import STEP, TIME, Memory, new_memory
from flexarm.integrate.status import Status as Status
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import ArmConstants, Loads, Sizes, Workspace

FloatArray = NDArray[np.float64]

#: First step of an integrator without one, times the highest frequency.
_FIRST = 0.5


class Drive(NamedTuple):
    """Torques and loads over time, as the kernels read them.

    The torque is a piecewise cubic: on piece k, ``sum_p coefficients[k, p] (t - breaks[k])^p``.
    Before the first break the first piece goes on, after the last break the last piece.
    """

    breaks: FloatArray  # (pieces + 1,) s, ascending
    coefficients: FloatArray  # (pieces, 4, n) N m / s^p
    stops: FloatArray  # (stops,) s, ascending: times where the torque is not smooth
    loads: Loads  # ``value`` and ``base_acceleration`` are overwritten as time goes on
    amplitude: FloatArray  # (k, 3) of the loads at factor one
    factor_breaks: FloatArray  # (pieces + 1,) s
    factor_coefficients: FloatArray  # (pieces, 4, k + 2) factors, base acceleration x, y


class System(NamedTuple):
    """The arm, as an integrator sees it."""

    sizes: Sizes
    constants: ArmConstants
    drive: Drive
    work: Workspace


class Tolerance(NamedTuple):
    """What one step may err by, see ``flexarm.engine.tolerance``.

    A joint angle may err by ``absolute * unit + relative * |angle|``; a mode by ``unit * (absolute
    + relative * d)`` with ``d`` the largest ``|mode| / unit`` of its body. So a stiff mode, whose
    value means little at the tip, neither dictates the step nor hides behind the joint angles.
    """

    absolute: float  # m at the tip
    relative: float
    unit: FloatArray  # (2, n, 1 + m): coordinate or rate per metre of tip displacement
    fastest: float  # rad/s, bound on the highest frequency


@dataclass
class Progress:
    """Where a run stands; ``advance`` updates it in place."""

    time: float
    state: FloatArray  # (2, n, 1 + m)
    step: float  # next step to try, s; 0 asks the integrator to choose
    sample: int = 0  # samples filled so far
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    impacts: int = 0  # steps that an adaptive method has shortened to meet or leave a joint stop
    memory: Memory | None = None  # None: nothing is remembered of earlier steps
    method: tuple[Any, ...] | None = None  # record of the integrator, of the same steps
    entry: Entry | None = None  # into the stepper

    def enter(
        self,
        stepper: Callable[..., int],
        system: System,
        tolerance: Tolerance,
        memory: Memory,
        until: float,
        max_steps: int,
    ) -> Status:
        """Call the stepper of the integrator that this run has, and take over what it did.

        ``Entry`` requires that the arguments of a run keep their types, which they do.
        """
        if self.entry is None or self.entry.kernel is not stepper:
            self.entry = Entry(stepper)
        memory.clock[TIME] = self.time
        memory.counts[:] = self.sample, self.steps, self.rejected, self.evaluations, self.impacts
        status = self.entry(system, tolerance, self.method, memory, float(until), max_steps)
        self.time, self.step = float(memory.clock[TIME]), float(memory.clock[STEP])
        counts = memory.counts.tolist()
        self.sample, self.steps, self.rejected, self.evaluations, self.impacts = counts
        return Status(status)


@dataclass(frozen=True)
class Integrator(ABC):
    """Base of all integrators; subclasses add fields for their parameters.

    A subclass names its compiled ``stepper``, which is called as ``stepper(system, tolerance,
    record, memory, until, max_steps)`` and returns a code of ``status``, and makes its ``record``.

    Class attributes: ``name`` in the registry, ``order``, ``adaptive``, ``follows_contacts``, false
    for a method that looks back over several steps and so needs smooth motion between stops, and
    ``reference``, the BibTeX keys of the method (``flexarm.citation``).

    Args:
        step: fixed step (s), shortened to meet every stop; None lets ``simulate`` find one
            (``flexarm.engine.default_step``). Of a method with step control the first step to
            try; None takes half a radian of the fastest mode.
    """

    step: float | None = None

    name: ClassVar[str] = ""
    order: ClassVar[int] = 0
    adaptive: ClassVar[bool] = False
    follows_contacts: ClassVar[bool] = True
    reference: ClassVar[tuple[str, ...]] = ()
    stepper: ClassVar[Callable[..., int]]

    @abstractmethod
    def record(self, constants: ArmConstants, state: FloatArray) -> tuple[Any, ...]:
        """Coefficients of the method, and its own arrays for a run from ``state``."""

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
        """Carry ``progress`` to ``until`` (s), at most ``max_steps`` steps in this call.

        ``sample_times`` (samples,) ascending; ``samples`` (samples, 2, n, 1 + m) receives the
        states at them, from ``progress.sample`` on.
        """
        if progress.memory is None:
            step = float(self.step or progress.step or _FIRST / tolerance.fastest)
            progress.memory = new_memory(progress.state, step)
            progress.method = self.record(system.constants, progress.state)
        memory = progress.memory._replace(
            state=progress.state, sample_times=sample_times, samples=samples
        )
        return progress.enter(self.stepper, system, tolerance, memory, until, max_steps)
