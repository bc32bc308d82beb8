"""Controllers of the tip position and the contact force, for motions that press on a surface."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from flexarm.model.drives.base import ControllerDrive, SampleTime
from flexarm.model.quantities import NonNegative, Positive


class HybridForceDrive(ControllerDrive):
    """Hybrid control: position along a surface, force normal to it."""

    kind: Literal["hybrid_force"] = "hybrid_force"
    frequency: Positive = Field(
        default=8.0, description="Natural frequency of the error along the surface (rad/s)."
    )
    damping_ratio: NonNegative = Field(default=1.0, description="Of that error.")
    path_integral: NonNegative = Field(
        default=2.0, description="Of that error: makes up for friction (1/s)."
    )
    force_integral: NonNegative = Field(
        default=10.0, description="Of the force error: the bandwidth of the force control (1/s)."
    )
    force_proportional: NonNegative = Field(default=0.0, description="Of the force error.")
    normal_damping: NonNegative = Field(
        default=20.0, description="Force per speed of the tip across the surface (N s/m)."
    )
    approach_speed: Positive = Field(
        default=0.1, description="Of a tip that has to press and does not touch (m/s)."
    )
    touch_force: NonNegative = Field(
        default=0.2, description="A measured force below it counts as none (N)."
    )
    sample_time: SampleTime = 0.001


class ImpedanceDrive(ControllerDrive):
    """Impedance control: the tip acts as a spring and a damper towards its path."""

    kind: Literal["impedance"] = "impedance"
    tangent_stiffness: NonNegative = Field(
        default=60.0, description="Force per distance along the surface (N/m)."
    )
    tangent_damping: NonNegative = Field(
        default=8.0, description="Force per speed along the surface (N s/m)."
    )
    normal_stiffness: NonNegative = Field(
        default=20.0, description="Force per distance across the surface (N/m)."
    )
    normal_damping: NonNegative = Field(
        default=10.0, description="Force per speed across the surface (N s/m)."
    )
    force_proportional: NonNegative = Field(
        default=0.0, description="Of the force error, which is measured where this is not 0."
    )
    force_integral: NonNegative = Field(
        default=0.0, description="Of the force error, likewise (1/s)."
    )
    posture_frequency: NonNegative = Field(
        default=5.0,
        description="With which more than two joints keep to the motion's posture, and all follow "
        "a motion that does not press (rad/s).",
    )
    sample_time: SampleTime = 0.001


class AdmittanceDrive(ControllerDrive):
    """Admittance control: the measured force moves the reference of a stiff position loop."""

    kind: Literal["admittance"] = "admittance"
    damping: Positive = Field(
        default=150.0, description="Force error per speed that the reference yields with (N s/m)."
    )
    stiffness: NonNegative = Field(
        default=0.0, description="Force per distance that draws the reference back (N/m)."
    )
    frequency: Positive = Field(
        default=8.0, description="Natural frequency of the position loop (rad/s)."
    )
    damping_ratio: NonNegative = Field(default=0.7, description="Of the position loop.")
    most_speed: Positive = Field(
        default=0.1, description="Limit of the speed that the reference yields with (m/s)."
    )
    sample_time: SampleTime = 0.001
