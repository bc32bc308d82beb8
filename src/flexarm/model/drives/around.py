"""Controllers that contain another one, which is described by a drive inside the drive."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from flexarm.model.checks import Record
from flexarm.model.drives.base import ControllerDrive
from flexarm.model.drives.registry import Alone
from flexarm.model.hardware import Instrument
from flexarm.model.quantities import Fraction, Listed, NonNegative, OneOrMany, Positive


class DisturbanceObserverDrive(ControllerDrive):
    """Disturbance observer: subtracts torques that the rigid model does not explain.

    The corrected torques are those of an inner controller.
    """

    kind: Literal["disturbance_observer"] = "disturbance_observer"
    inner: Alone = Field(
        discriminator="kind",
        description="The controller whose torque is corrected; its sample time is this one's.",
    )
    cutoff: OneOrMany[Positive] = Field(
        default=5.0,
        description="Of the filter that the estimate follows as, one for all joints or one each "
        "(Hz).",
    )
    compensation: Fraction = Field(
        default=1.0, description="Part of the estimate that is taken off; 0 only watches."
    )

    per_joint: ClassVar[tuple[str, ...]] = ("cutoff",)

    def balances(self) -> bool:
        """See `ControllerDrive.balances`."""
        return self.inner.balances()


class FilterSpec(Record):
    """An extended Kalman filter for the bending of the arm and its payload."""

    instruments: Listed[Instrument] | None = Field(
        default=None,
        description="What is read; all of the hardware's instruments where left out.",
    )
    torque_noise: OneOrMany[NonNegative] = Field(
        default=0.1,
        description="Standard deviation of an error of the torque, drawn anew at each sample: all "
        "that the model leaves out (N m).",
    )
    payload_deviation: NonNegative = Field(
        default=0.0,
        description="Standard deviation of the payload's mass (kg); 0 where it is known.",
    )
    payload_drift: NonNegative = Field(
        default=0.0, description="By which that mass wanders (kg/s^0.5)."
    )
    rate_deviation: NonNegative = Field(
        default=0.1, description="Standard deviation of the joint rates at the start (rad/s)."
    )
    energy_deviation: NonNegative = Field(
        default=0.01, description="Energy of vibration expected in each mode at the start (J)."
    )


class EstimatorDrive(ControllerDrive):
    """An inner controller whose measurement is the estimate of a Kalman filter."""

    kind: Literal["estimator"] = "estimator"
    estimator: FilterSpec = Field(default=FilterSpec(), description="The filter.")
    inner: Alone | DisturbanceObserverDrive = Field(
        discriminator="kind", description="The controller; its sample time is this one's."
    )

    def balances(self) -> bool:
        """See `ControllerDrive.balances`."""
        return self.inner.balances()
