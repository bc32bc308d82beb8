"""Starting values of another drive: gains well below the vibration of the arm."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmError
from flexarm.cases.scenario.motions import motion_of
from flexarm.linear import modes
from flexarm.model import Scenario
from flexarm.model.drives import DRIVES, TorqueDrive
from flexarm.motion import Motion, rigid_torque
from flexarm.view.studio.values.starts import ends_of, short

#: Bandwidth of a joint loop, as a fraction of the lowest frequency with locked joints, and rad/s
#: for a rigid arm.
_BANDWIDTH, _RIGID_BANDWIDTH = 0.4, 5.0
_DAMPING = 0.7
_SAMPLE_TIME = 0.001
#: Limit on the change of a joint rate in one sample by its own rate gain.
_RATE_STEP = 0.3
#: Intervals of a sampled torque.
_INTERVALS = 20


@dataclass(frozen=True, eq=False)
class _Design:
    """What starting gains depend on: the arm, and the ends of its motion."""

    scenario: Scenario
    arm: Arm

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Joint angles (joints,) rad at the start and at the end."""
        return ends_of(self.arm, self.scenario)

    @cached_property
    def motion(self) -> Motion | None:
        """The motion, if there is one that does not press and is within reach."""
        try:
            motion = motion_of(self.arm, self.scenario)
        except FlexarmError:
            return None
        return motion if isinstance(motion, Motion) else None

    @property
    def presses(self) -> bool:
        """Whether the motion presses on a surface."""
        return getattr(self.scenario.motion, "kind", "") == "pressed"

    @property
    def instruments(self) -> bool:
        """Whether the hardware has instruments."""
        hardware = self.scenario.hardware
        return hardware is not None and bool(hardware.instruments)

    @cached_property
    def bandwidth(self) -> float:
        """Bandwidth of a joint loop, rad/s."""
        found = modes(self.arm, self.ends[0]).frequency_hz
        found = found[found > 0.0]
        return float(_BANDWIDTH * 2.0 * np.pi * found[0]) if found.size else _RIGID_BANDWIDTH

    @cached_property
    def inertia(self) -> FloatArray:
        """Rotary inertia (joints,) kg m^2 at each joint of the rigid arm."""
        rigid = self.arm.rigid()
        return np.diag(rigid.mass_matrix(rigid.rest(self.ends[0])))

    @cached_property
    def derivative(self) -> FloatArray:
        """Torque per rate error (joints,) N m s/rad."""
        arm = self.arm
        # A light flexible link beside a joint accelerates faster than the inertia suggests.
        mass = arm.mass_matrix(arm.rest(self.ends[0]))
        quickest = np.diag(np.linalg.inv(mass))[arm.joint_index]
        usual = 2.0 * _DAMPING * self.inertia * self.bandwidth
        return np.minimum(usual, _RATE_STEP / (quickest * _SAMPLE_TIME))

    @cached_property
    def slowest(self) -> float:
        """Natural frequency (rad/s) of the joint loop with the smallest rate gain."""
        return float(np.min(self.derivative / self.inertia)) / (2.0 * _DAMPING)

    def each(self, values: Any) -> list[float]:
        """Return values (joints,) with three digits."""
        return [short(value) for value in np.broadcast_to(values, self.inertia.shape)]


#: Starting value of a parameter for its default, which is None if the parameter is required; None
#: keeps the default.
_Start = Callable[[_Design, Any], Any]


def _if_required(start: Callable[[_Design], Any]) -> _Start:
    return lambda of, default: start(of) if default is None else None


def _at_most(start: Callable[[_Design], float]) -> _Start:
    return lambda of, default: short(min(start(of), math.inf if default is None else default))


#: Starting values by the name of a parameter. A controller with other names starts with its
#: defaults.
_STARTS: dict[str, _Start] = {
    "proportional": lambda of, _: of.each(of.derivative * of.bandwidth / (2.0 * _DAMPING)),
    "derivative": lambda of, _: of.each(of.derivative),
    "damping": _if_required(lambda of: of.each(of.derivative)),
    "frequency_hz": lambda of, _: short(of.slowest / (2.0 * np.pi)),
    "frequency": _at_most(lambda of: of.slowest),
    "posture_frequency": _at_most(lambda of: of.slowest),
    "bandwidth": _at_most(lambda of: 0.5 * of.slowest),
    "cutoff": _at_most(lambda of: of.slowest / (2.0 * np.pi)),
    "damping_ratio": _at_most(lambda of: _DAMPING),
    "boundary_layer": lambda of, _: 0.5,
    "bound": lambda of, _: 0.2,
    "rate_bound": lambda of, _: 2.0,
    "adaptation": lambda of, _: 0.001,
    "strain": lambda of, _: 0.0,
    "torque_limit": _if_required(lambda of: of.each(20.0 * of.inertia)),
    "lower": lambda of, _: of.each(np.minimum(*of.ends) - 0.2),
    "upper": lambda of, _: of.each(np.maximum(*of.ends) + 0.2),
    "posture": lambda of, _: of.each(0.5 * (of.ends[0] + of.ends[1])),
    "period": _if_required(lambda of: max(1.0, short(20.0 * np.pi / of.slowest))),
    # Without a payload an uncertainty of it is a warning; with little damping one of the rigidity
    # leaves the loop of the arm itself unstable.
    "payload_uncertainty": lambda of, _: None if of.arm.spec.payload.mass else 0.0,
    "rigidity_uncertainty": lambda of, _: 0.0,
    "inner": lambda of, _: drive_of_kind(of.scenario, "joint_pd"),
    "estimator": lambda of, _: None if of.instruments else {"instruments": _instruments(of.arm)},
}


def drive_of_kind(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return a drive of a kind, with gains well below the vibration of the arm.

    An unknown kind is returned alone, so that the records report what is wrong.
    """
    records = {form.model_fields["kind"].default: form for form in chain(*DRIVES.values())}
    found: dict[str, Any] = {"kind": kind}
    if kind not in records:
        return found
    of = _Design(scenario, Arm(scenario.arm))
    if records[kind] is TorqueDrive:
        return found | _sampled(of)
    for name, field in records[kind].model_fields.items():
        default = None if field.is_required() else field.default
        value = _STARTS[name](of, default) if name in _STARTS else None
        if value is not None:
            found[name] = value
    return found


def _instruments(arm: Arm) -> list[dict[str, Any]]:
    found = [{"signal": "joint_angle", "noise": 1e-4}]
    gauges = any(link.gauges for link in arm.spec.links)
    return [*found, {"signal": "strain", "noise": 1e-6}] if gauges else found


def _sampled(of: _Design) -> dict[str, Any]:
    """Return samples of the torque of the rigid arm along the motion."""
    motion, joints = of.motion, of.arm.joints
    if motion is None:
        return {"rate": 10.0, "values": [[0.0] * joints] * 2}
    torque = rigid_torque(of.arm, motion)
    rate = short(_INTERVALS / motion.end_time)
    times = np.arange(_INTERVALS + 2) / rate
    return {"rate": rate, "values": [[short(each) for each in torque(t)] for t in times]}
