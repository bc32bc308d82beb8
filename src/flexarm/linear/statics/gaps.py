"""Warnings and errors about properties of joints that a model or a function does not contain."""

from __future__ import annotations

from collections.abc import Callable

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import AccuracyWarning, FlexarmWarning, InputError, Problem, warn_caller
from flexarm.model import Friction


def warn_of_backlash(arm: Arm, q: FloatArray) -> None:
    """Warn if q (dof,) is between the contacts of a joint's backlash, where no spring acts."""
    for seat in arm.assembly.seats:
        joint = arm.spec.joints[seat.link]
        if seat.twist is None or not seat.backlash:
            continue
        if abs(q[seat.twist]) < 0.5 * joint.backlash:
            warn_caller(
                f"arm.joints[{seat.link}]: between the contacts of the backlash "
                f"({joint.backlash:g} rad) nothing but damping connects motor and link, and the "
                "linear model has no spring there. Use backlash=0 for modes and designs, and "
                "simulate for the effect of the backlash.",
                FlexarmWarning,
            )


def warn_of_bristles(arm: Arm, model: str) -> None:
    """Warn if friction has bristles, which ``model`` does not contain: q and qd do not, either."""
    if arm.assembly.has_bristles:
        warn_caller(
            f"{_bristled(arm)}: {model} has friction as a function of the rate. Bristles have a "
            "state that q and qd do not contain, and act in simulations only. For small motions "
            "of a sticking joint, replace its friction by stiffness and damping.",
            AccuracyWarning,
        )


def warn_of_creep(arm: Arm, model: str) -> None:
    """Warn if friction holds a joint in runs, but makes it creep in ``model``."""
    if arm.assembly.has_sticking:
        warn_caller(
            f"{_joints(arm, lambda friction: friction.holds)}: {model} has friction as a smooth "
            "function of the rate, with which a joint creeps where it sticks in simulations. With "
            "smoothing_rate=0.01 (rad/s), simulations have such a function, too.",
            AccuracyWarning,
        )


def warn_of_sticking(arm: Arm, qd: FloatArray, model: str) -> None:
    """Warn if friction holds a joint that rests at rates qd (dof,): ``model`` has a damper there.

    Rates are compared with those at which the damper has become a constant torque.
    """
    dampers = []
    for seat in arm.assembly.seats:
        friction = arm.spec.joints[seat.link].friction
        if friction is None or not friction.holds or abs(qd[seat.angle]) > friction.model_rate:
            continue
        level = friction.coulomb if friction.static is None else friction.static
        if level > 0.0:
            slope = level / friction.model_rate
            dampers.append(f"arm.joints[{seat.link}] ({slope:.3g} N m s/rad)")
    if dampers:
        warn_caller(
            f"{', '.join(dampers)}: friction holds this joint at rest. {model} has the damper in "
            "brackets instead, with which the joint hardly moves. For a sliding joint, use an arm "
            "without Coulomb friction, or rates above a tenth of stribeck_rate.",
            FlexarmWarning,
        )


def refuse_bristles(arm: Arm, name: str, value: str = "", hint: str = "") -> None:
    """Raise if friction has bristles, which a computation or a ``value`` does not support."""
    if arm.assembly.has_bristles:
        rule = f"{value} cannot be combined with bristles ({_bristled(arm)})".lstrip()
        raise InputError(Problem(name, rule, hint=hint))


def refuse_sticking(arm: Arm, name: str, value: str = "", hint: str = "") -> None:
    """Raise if friction holds a joint; arguments as in ``refuse_bristles``."""
    if arm.assembly.has_sticking:
        sticking = _joints(arm, lambda friction: friction.holds)
        rule = f"{value} cannot be combined with friction that holds ({sticking})".lstrip()
        raise InputError(Problem(name, rule, hint=hint))


def _bristled(arm: Arm) -> str:
    """Return the paths of the joints whose friction has bristles."""
    return _joints(arm, lambda friction: friction.bristle_stiffness is not None)


def _joints(arm: Arm, has: Callable[[Friction], bool]) -> str:
    """Return the paths of the joints whose friction has a property."""
    return ", ".join(
        f"arm.joints[{i}]"
        for i, joint in enumerate(arm.spec.joints)
        if joint.friction is not None and has(joint.friction)
    )
