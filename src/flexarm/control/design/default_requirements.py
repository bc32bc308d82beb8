"""Complete the requirements of a linear controller with default values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.design.linear_design import DISTURBANCES, DesignRequirements, check_names
from flexarm.control.design.rigid_model import RigidModel
from flexarm.linear.models.signals import CHANNEL_OUTPUTS
from flexarm.model.drives.linear import LQGParameters

#: Outputs that can be measured, because their nominal values are computed.
MEASURED = ("joint_angle", "joint_rate", "strain", "tip")
#: Outputs that can be integrated, and their default acceptable integrals: rad s, m s.
INTEGRATED = {"joint_angle": 2e-3, "tip": 1e-3}
#: Outputs that can have acceptable deviations: all except contacts, which a design excludes.
_ACCEPTABLE = tuple(name for name in CHANNEL_OUTPUTS if not name.startswith("contact_"))
#: Angular acceleration (rad/s^2) of the rigid model under the default acceptable torque.
_BRISK = 10.0


def design_requirements(
    arm: Arm, given: LQGParameters, acceptable: Mapping[str, ArrayLike] | None
) -> DesignRequirements:
    """Return the requirements of a linear controller, with default values for missing ones.

    Args:
        arm: model of the arm.
        given: the controller, with its parameters as attributes.
        acceptable: acceptable deviations in place of those of ``given``.

    Raises:
        InputError: if a name or number is wrong, several outputs are integrated, or the tip is
            integrated but not measured.
    """
    measured, disturbance, integral = given.measured, given.disturbance, given.integral
    if acceptable is None:
        acceptable = {"joint_angle": 0.01, "tip": 0.01, "joint_rate": 0.2}
    torque = given.acceptable_torque
    if torque is None:
        torque = _BRISK * np.diag(RigidModel(arm).mass_matrix(np.asarray(given.posture)))
    if measured is None:
        measured = {"joint_angle": 1e-4} | ({"strain": 2e-5} if arm.gauges else {})
    if disturbance is None:
        reach = float(np.sum(arm.lengths))
        disturbance = {"torque": 0.1 * torque, "tip_force": 0.2 * np.max(torque) / reach}
    if integral is None or integral is False:
        integral = {}
    elif integral is True:
        integral = {"joint_angle": INTEGRATED["joint_angle"]}
    elif isinstance(integral, str):
        integral = {integral: INTEGRATED.get(integral, np.nan)}
    checked = check_names("integral", integral, tuple(INTEGRATED), arm)
    if len(checked) > 1:
        raise InputError(Problem("integral", "name a single output", shown(integral)))
    seen = check_names("measured", measured, MEASURED, arm)
    if "tip" in checked and "tip" not in seen:
        raise InputError(Problem("measured", "must contain the tip to integrate it"))
    return DesignRequirements(
        check_names("acceptable", acceptable, _ACCEPTABLE, arm),
        torque,
        seen,
        check_names("disturbance", disturbance, DISTURBANCES, arm),
        checked,
        given.recovery,
        given.rigidity_uncertainty,
    )
