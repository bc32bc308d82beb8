"""Estimate before the first readings: links at rest under gravity, and its covariance."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.control_design.rigid_model import RigidModel
from flexarm.hardware.measurement import FloatArray
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model import Instrument
from flexarm.model.arm.variation import varied_spec
from flexarm.model.drives.around import FilterParameters

#: Ratio of the standard deviation of joint angles before the first reading to that of the reading.
_BEFORE_READING = 100.0
#: Difference of the payload mass for the derivative of the sag, in its standard deviations. A
#: difference is accurate enough, because sag is nearly linear in the mass.
SAG_DIFFERENCE = 0.1
#: Least stiffness of a coordinate, which limits its variance.
LEAST_STIFFNESS = 1e-12


def first_variance(
    arm: Arm, given: FilterParameters, angle: Instrument, stiffness: FloatArray
) -> FloatArray:
    """Return the variances (2 dof + 1,) of [q, qd, payload] apart from that of the payload.

    Args:
        arm: the arm. given: the deviations of the filter. angle: the encoder.
        stiffness: (dof,) of the coordinates at rest; those of joints have no effect.
    """
    energy = 2.0 * given.energy_deviation
    variance = np.full(2 * arm.dof + 1, energy)
    variance[: arm.dof] = energy / np.maximum(stiffness, LEAST_STIFFNESS)
    joints = arm.joint_index
    # The prior is wide, because the update that follows uses the reading itself.
    variance[joints] = angle.noise**2 + angle.resolution**2 / 12.0
    variance[joints] *= _BEFORE_READING**2
    variance[arm.dof + joints] = given.rate_deviation**2
    variance[-1] = 0.0
    return variance


def sag(arm: Arm, angles: FloatArray, payload_deviation: float) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates (dof,) at rest and their derivative by the payload mass, 1/kg."""
    if not any(arm.spec.gravity):
        q = arm.rest(angles)
        return q, np.zeros_like(q)
    q = equilibrium(arm, angles).q
    if payload_deviation == 0.0:
        return q, np.zeros_like(q)
    more = SAG_DIFFERENCE * payload_deviation
    heavier = Arm(varied_spec(arm.spec, payload_mass=arm.spec.payload.mass + more))
    return q, (equilibrium(heavier, angles).q - q) / more


def tip_mass(arm: Arm) -> float:
    """Return the effective mass (kg) of the tip, without the payload.

    It is the inertia of the last link about its joint over its length squared. Accelerations of
    the tip are inversely proportional to this mass plus the payload mass. Therefore they are nearly
    exponential in the logarithm of the sum, even for a payload of zero.
    """
    inertia = RigidModel(arm).mass_matrix(np.zeros(arm.joints))[-1, -1]
    own = float(inertia) / float(arm.lengths[-1]) ** 2 - arm.spec.payload.mass
    return max(own, 1e-3 * float(inertia) / float(arm.lengths[-1]) ** 2)
