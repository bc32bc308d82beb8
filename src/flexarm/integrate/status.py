"""Status codes of a call of a stepper."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Status of a call of ``advance``."""

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
    CLOSURES_DEPEND = 10

    @property
    def sentence(self) -> str:
        """Description of the status for the error message."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.DONE: "The run is complete.",
    Status.PAUSED: "The run is under way.",
    Status.STEP_UNDERFLOW: "the step size fell below what double precision resolves.",
    Status.NOT_FINITE: "the state is no longer finite: the step is too long for the stiffest "
    "mode, or the arm is unstable.",
    Status.INERTIA_LOST: "the inertia about a joint is zero or negative.",
    Status.NOT_CONVERGED: "the equations of an implicit step could not be solved: the step is too "
    "long for the motion.",
    Status.CONTACT_UNSEEN: "the fixed step is too long to resolve a contact at this speed.",
    Status.PRESSED_THROUGH: "a contact point passed through its surface: the contact is too "
    "soft for this impact.",
    Status.NOT_FOLLOWED: "the prediction error exceeded 0.5 % of the joint accelerations: the step "
    "is too long for this motion.",
    Status.DIVERGED: "a joint turns by more than half a turn in one fixed step, or a link bends by "
    "100 times the reach of the arm: the step is too long, or the arm is unstable.",
    Status.CLOSURES_DEPEND: "the posture is singular: its closures depend on each other, so that "
    "their forces and the further motion are not determined.",
}

# Kernels return the codes as plain integers, because an enumeration costs time at each call.
DONE = Status.DONE.value
PAUSED = Status.PAUSED.value
STEP_UNDERFLOW = Status.STEP_UNDERFLOW.value
NOT_FINITE = Status.NOT_FINITE.value
INERTIA_LOST = Status.INERTIA_LOST.value
NOT_CONVERGED = Status.NOT_CONVERGED.value
CONTACT_UNSEEN = Status.CONTACT_UNSEEN.value
PRESSED_THROUGH = Status.PRESSED_THROUGH.value
NOT_FOLLOWED = Status.NOT_FOLLOWED.value
DIVERGED = Status.DIVERGED.value
CLOSURES_DEPEND = Status.CLOSURES_DEPEND.value
