"""Inputs of exported controllers as symbols: readings, reference, nominal motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from flexarm.bridges.symbolic.scalars import objects
from flexarm.bridges.symbolic.symbol_array import SymbolArray, symbol_array
from flexarm.control.design.nominal import Nominal


@dataclass(eq=False)
class Inputs:
    """Symbols of the inputs, by name."""

    symbols: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str, *shape: int) -> SymbolArray:
        """Return the array of an input, with the same symbols in each call."""
        new = casadi.SX.sym(name, int(np.prod(shape)))
        symbol = self.symbols.setdefault(name, new)
        entries = casadi.vertsplit(symbol) if symbol.numel() else []
        return symbol_array(objects(entries, casadi).reshape(shape))


class ReferenceInputs:
    """Reference whose values are symbols, at every time."""

    def __init__(self, inputs: Inputs, joints: int, prefix: str = "reference") -> None:
        self._angle = inputs.array(f"{prefix}_angle", joints)
        self._rate = inputs.array(f"{prefix}_rate", joints)
        self._acceleration = inputs.array(f"{prefix}_acceleration", joints)

    def joint_angle(self, t: float) -> Any:
        return self._angle

    def joint_rate(self, t: float) -> Any:
        return self._rate

    def joint_acceleration(self, t: float) -> Any:
        return self._acceleration


class NominalInputs:
    """Nominal motion of `LQG` whose values are symbols."""

    def __init__(self, inputs: Inputs, controller: Any) -> None:
        joints, nodes = controller.arm.joints, preview_nodes(controller)
        self._angle = inputs.array("nominal_angle", joints)
        self._torque = inputs.array("nominal_torque", joints)
        self._shown = inputs.array("nominal_reading", controller._outputs)
        force = inputs.array("nominal_force", len(nodes), controller._model.elastic.size)
        self.missing = symbol_array(np.zeros((controller._steps, force.shape[1])))
        self.missing[nodes] = force

    def reset(self) -> None:
        """Do nothing."""

    def at(self, *_: Any) -> Nominal:
        still: Any = None  # the coordinates: only for the nominal tip, which is an input
        return Nominal(self._angle, still, still, self._torque, self.missing[0], self._shown)


class StaticBending:
    """Nominal motion of `StrainDamping`, computed at every sample instead of in advance.

    Args:
        planned: the nominal motion in advance, or one of this class.
        correction: symbols of ``StrainDamping.strain_correction``.
    """

    def __init__(self, planned: Any, correction: SymbolArray) -> None:
        self._planned: Any = planned._planned if isinstance(planned, StaticBending) else planned
        self._correction = correction

    def at(self, t: float, angle_now: Any, reference: Any) -> Nominal:
        parts = reference.joint_angle, reference.joint_rate, reference.joint_acceleration
        found = self._planned.along(*(part(t)[None] for part in parts))
        static = Nominal(*(rows[0] for rows in found))
        return static._replace(shown=static.shown + self._correction)


def preview_nodes(controller: Any) -> Any:
    """Return the samples of the preview of `LQG` at which it uses the elastic forces."""
    return np.arange(0, controller._steps, controller._stride)
