"""Motions a scenario can ask for: the tip along a line, or the joints from here to there."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from flexarm.model.checks import Record
from flexarm.model.quantities import Listed, NonNegative, Number, Pair, Positive

Profile = Literal["quintic", "trapezoidal"]


class _Timing(Record):
    """When a motion happens; the arm rests before and after."""

    duration: Positive = Field(description="Time from start to end (s).")
    profile: Profile = Field(default="quintic", description="How the way is spread over time.")
    start_time: NonNegative = Field(default=0.0, description="When the motion starts (s).")


class LineMotionSpec(_Timing):
    """The rigid arm's tip goes along a straight line."""

    kind: Literal["line"] = "line"
    start: Pair = Field(description="Tip at the start [x, y], world frame (m).")
    end: Pair = Field(description="Tip at the end [x, y], world frame (m).")
    elbow: Literal["up", "down"] = Field(
        default="up",
        description="Which of the two postures: elbow to the left (up) or to the right (down) of "
        "the line from the base to the tip.",
    )


class JointMotionSpec(_Timing):
    """Every joint goes from one angle to another, all at the same time."""

    kind: Literal["joint"] = "joint"
    start: Listed[Number] = Field(description="Relative joint angles at the start (rad).")
    end: Listed[Number] = Field(description="Relative joint angles at the end (rad).")


MotionSpec = Annotated[LineMotionSpec | JointMotionSpec, Field(discriminator="kind")]
