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
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import ArmConstants, Loads, Sizes, Workspace

FloatArray = NDArray[np.float64]


class Status(IntEnum):
    """How a call of ``advance`` ended."""

    DONE = 0
    PAUSED = 1
    STEP_UNDERFLOW = 2
    NOT_FINITE = 3
    INERTIA_LOST = 4
    NOT_CONVERGED = 5
    CONTACT_UNSEEN = 6
    PRESSED_THROUGH = 7
    NOT_FOLLOWED = 8
    DIVERGED = 9

    @property
    def sentence(self) -> str:
        """What happened, for the error message."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.DONE: "The run is complete.",
    Status.PAUSED: "The run is under way.",
    Status.STEP_UNDERFLOW: "the step size fell below what double precision resolves.",
    Status.NOT_FINITE: "the state is no longer finite: the step is too long for the stiffest "
    "mode, or the arm is unstable.",
    Status.INERTIA_LOST: "a joint no longer feels any inertia.",
    Status.NOT_CONVERGED: "the equations of an implicit step could not be solved: the step is too "
    "long for the motion.",
    Status.CONTACT_UNSEEN: "the fixed step is too long to follow a touch at this speed.",
    Status.PRESSED_THROUGH: "a point has gone through what it touches: the contact is too soft for "
    "the momentum behind it.",
    Status.NOT_FOLLOWED: "posture and rates were predicted over each step so badly that the "
    "accelerations of the joints missed half a percent: the step is too long for this motion.",
    Status.DIVERGED: "a joint turns by more than half a turn in one fixed step, or a link bends by "
    "100 times the reach of the arm: the step is too long, or the arm is unstable.",
}


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
    memory: dict[str, FloatArray] = field(default_factory=dict)  # an integrator's own arrays
    entry: Entry | None = None  # into the stepper

    def enter(self, stepper: Callable[..., int], system: System, *arguments: Any) -> Status:
        """Call the stepper of the integrator that this run has.

        What ``Entry`` is promised holds: the arguments of a run keep their types.
        """
        if self.entry is None or self.entry.kernel is not stepper:
            self.entry = Entry(stepper)
        return Status(self.entry(system, *arguments))

    def take(self, counts: NDArray[Any]) -> None:
        """Take over samples, steps, rejected steps and evaluations (4,) from a stepper."""
        self.sample, self.steps, self.rejected, self.evaluations = (int(n) for n in counts)


@dataclass(frozen=True)
class Integrator(ABC):
    """Base of all integrators; subclasses add fields for their parameters.

    Class attributes: ``name`` in the registry, ``order``, ``adaptive``, ``follows_contacts``, false
    for a method that looks back over several steps and so needs smooth motion between stops, and
    ``reference``, the BibTeX keys of the method (``flexarm.citation``).
    """

    name: ClassVar[str] = ""
    order: ClassVar[int] = 0
    adaptive: ClassVar[bool] = False
    follows_contacts: ClassVar[bool] = True
    reference: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
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
