"""Estimate before the first readings: links at rest under gravity, and its covariance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.design.rigid_model import RigidModel
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model import Instrument
from flexarm.model.drives.around import FilterParameters
from flexarm.model.paths import number_at, with_number

#: Ratio of the standard deviation of joint angles before the first reading to that of the reading.
_BEFORE_READING = 100.0
#: Difference of a number for the derivative of the sag, in its standard deviations. A difference
#: is accurate enough, because sag is nearly linear in each number.
SAG_DIFFERENCE = 0.1
#: Least stiffness of a coordinate relative to the largest, which limits its variance.
LEAST_STIFFNESS = 1e-12


def first_variance(
    arm: Arm, given: FilterParameters, angle: Instrument, stiffness: FloatArray
) -> FloatArray:
    """Return the variances (2 dof,) of [q, qd] for known numbers of the arm.

    Args:
        arm: the arm. given: the deviations of the filter. angle: the encoder.
        stiffness: (dof,) of the coordinates at rest; those of joints have no effect.
    """
    assert given.energy_deviation is not None
    assert given.rate_deviation is not None
    joints, energy = arm.joint_index, 2.0 * given.energy_deviation
    variance = np.full(2 * arm.dof, energy)
    bending = np.delete(stiffness, joints)
    least = LEAST_STIFFNESS * np.max(bending, initial=0.0)
    variance[np.setdiff1d(np.arange(arm.dof), joints)] = energy / np.maximum(bending, least)
    # The prior is wide, because the update that follows uses the reading itself.
    bias = (given.bias_deviation or {}).get(angle.label, 0.0)
    variance[joints] = angle.noise**2 + angle.resolution**2 / 12.0 + bias**2
    variance[joints] *= _BEFORE_READING**2
    variance[arm.dof + joints] = given.rate_deviation**2
    return variance


def sag(
    arm: Arm, angles: FloatArray, deviations: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates (dof,) at rest, and derivatives (p, dof) by numbers of the arm.

    Args:
        deviations: standard deviations of the numbers, by path; zero for a known one.
    """
    slopes = np.zeros((len(deviations), arm.dof))
    if not any(arm.spec.gravity):
        return arm.rest(angles), slopes
    q = equilibrium(arm, angles).q
    for slope, (path, deviation) in zip(slopes, deviations.items(), strict=True):
        if deviation:
            more = SAG_DIFFERENCE * deviation
            other = Arm(with_number(arm.spec, path, number_at("path", arm.spec, path) + more))
            slope[:] = (equilibrium(other, angles).q - q) / more
    return q, slopes


def tip_mass(arm: Arm) -> float:
    """Return the effective mass (kg) of the tip, without the payload.

    It is the inertia of the last link about its joint over its length squared. Accelerations of
    the tip are inversely proportional to this mass plus the payload mass. Therefore they are nearly
    exponential in the logarithm of the sum, even for a payload of zero.
    """
    inertia = RigidModel(arm).mass_matrix(np.zeros(arm.joints))[-1, -1]
    own = float(inertia) / float(arm.lengths[-1]) ** 2 - arm.spec.payload.mass
    return max(own, 1e-3 * float(inertia) / float(arm.lengths[-1]) ** 2)
