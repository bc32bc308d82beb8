"""Controllers as functions of symbols: the source of ``update``, evaluated over CasADi scalars.

There is no second law. The exported function has the numbers of the controller object, and calls
the kernels of its rigid model over symbols.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem
from flexarm.bridges.c_code.kept_attributes import check_kept, check_sizes
from flexarm.bridges.c_code.laws.gain_table import around, gain_table
from flexarm.bridges.c_code.laws.long_memory import LongMemory, long_memory
from flexarm.bridges.c_code.laws.traced_inputs import (
    Inputs,
    NominalInputs,
    ReferenceInputs,
    StaticBending,
    preview_nodes,
)
from flexarm.bridges.c_code.laws.traced_task import (
    FRICTION,
    PressedInputs,
    SymbolicTask,
    follow_symbols,
)
from flexarm.bridges.c_code.named_function import NamedFunction, named
from flexarm.bridges.symbolic.branches import branched
from flexarm.bridges.symbolic.scalars import SymbolError, plain
from flexarm.bridges.symbolic.symbol_array import make_symbolic
from flexarm.control.analysis.linear_controller import Memory, MemoryNameError, memory_of
from flexarm.control.contract.base import requirements_of
from flexarm.control.design.nominal import Nominal
from flexarm.control.hardware.measurement import Measurement
from flexarm.control.laws import (
    LQG,
    MPC,
    Adaptive,
    Controller,
    EstimatorController,
    JointPID,
    RBFAdaptive,
    RepetitiveControl,
)
from flexarm.control.laws.force.task_controller import TaskController
from flexarm.control.laws.joint.follower import JointFollower
from flexarm.control.laws.vibration.strain_damping import StrainDamping

#: Packages whose objects belong to a controller.
_PACKAGES = ("flexarm.control.laws", "flexarm.control.design")
#: Reasons why the law of a controller cannot be exported.
_REFUSED: dict[type[Any], str] = {
    EstimatorController: "Its parts are exported one by one: `inner` and `estimator`.",
    MPC: "It solves an optimisation problem at every sample.",
}
#: Kinds of NumPy's number types that symbols and numbers in a memory have.
_KINDS = "biufO"
#: Most numbers in a memory; functions have up to seven copies of them on the stack.
_MOST_MEMORY = 10_000


@dataclass(frozen=True, eq=False)
class TracedController:
    """Functions of a controller.

    Attributes:
        controller: the controller, which is not modified.
        functions: ``controller_start`` and ``controller_update``; only the latter without memory.
        memory: size of the memory between samples.
        defaults: values of inputs whose pointer is NULL, by name.
    """

    controller: Controller
    functions: tuple[NamedFunction, ...]
    memory: int
    defaults: Mapping[str, FloatArray]

    @property
    def sample_time(self) -> float:
        """Sample time, s."""
        return float(self.controller.sample_time)


def traced_controller(arm: Arm, controller: Controller) -> TracedController:
    """Return the functions of a controller of an arm.

    Raises:
        InputError: if the controller does not belong to the arm, or its law cannot be exported.
    """
    names = _readings(arm, controller)
    new: Any = deepcopy(controller)
    # A reset computes with numbers, so it comes first.
    new.reset()
    try:
        if isinstance(controller, TaskController):
            new._task = SymbolicTask(controller.arm)
        make_symbolic(new, _PACKAGES)
        started, first = _law("controller_start", new, controller, arm, names)
        _, later = _law("controller_update", started, controller, arm, names)
    except MemoryNameError:
        raise
    except Exception as error:  # a user's code over symbols may raise any
        cause = "" if isinstance(error, SymbolError) else "does with numbers what symbols cannot: "
        raise _refusal(controller, f"Its update {cause}{error}".rstrip(".") + ".") from None
    size, long = _memory(started).read().size, _beside(controller, arm.joints)
    functions = _functions(controller, [first, later] if size or long else [later])
    if long:
        size, functions = size + long.size, tuple(map(long.around, functions))
    used = {name for function in functions for name in function.inputs}
    at_rest = nominal_values(*rest_motion(controller)) if isinstance(controller, LQG) else {}
    static = {"strain_correction": np.zeros(len(arm.gauges))}
    every = at_rest | FRICTION | static
    defaults = {name: value for name, value in every.items() if name in used}
    return TracedController(controller, functions, size, defaults)


def _law(
    name: str, before: Any, controller: Controller, arm: Arm, names: list[str]
) -> tuple[Any, tuple[str, Any, Any]]:
    """Update copies of a symbolic controller, along all paths through its conditions.

    Returns:
        The controller after the update, along one of the paths; name, symbols and results of the
        update.
    """
    first, inputs, after = name == "controller_start", Inputs(), []
    long = _beside(controller, arm.joints)

    def update() -> dict[str, Any]:
        mine = deepcopy(before)
        if not first:
            kept = _memory(mine)
            kept.write(inputs.array("memory", kept.read().size))
        torque = _updated(mine, controller, arm, names, inputs)
        after.append(mine)
        memory = _memory(mine).read()
        outputs = {"memory_out": memory, "torque": torque} if memory.size else {"torque": torque}
        if long:
            outputs["stored"] = long.stored(mine)
        return {
            key: casadi.vertcat(*(casadi.SX(plain(one)) for one in np.ravel(values)))
            for key, values in outputs.items()
        }

    outputs = branched(update)
    if casadi.depends_on(casadi.vertcat(*outputs.values()), inputs.symbols.pop("time")):
        raise SymbolError("depends on the time t; count samples in its memory instead")
    declared = {*(_declared(controller) or ()), *getattr(controller, "start_memory", ())}
    check_kept(None if first else before, after, declared, _PACKAGES)
    check_sizes([_memory(one) for one in (after if first else [before, *after])])
    return after[0], (name, inputs.symbols, outputs)


def _updated(mine: Any, controller: Controller, arm: Arm, names: list[str], inputs: Inputs) -> Any:
    """Update a symbolic copy of a controller; return the torque."""
    sizes = reading_sizes(arm)
    measurement = Measurement(**{name: inputs.array(name, *sizes[name]) for name in names})
    reference: Any = ReferenceInputs(inputs, arm.joints)
    if isinstance(controller, TaskController):
        reference = PressedInputs(inputs, arm.joints)
        follow_symbols(mine, inputs)
    if isinstance(controller, LQG):
        mine._motion = NominalInputs(inputs, controller)
        mine._desired_tip = lambda _: inputs.array("nominal_tip", 2)
    long = _beside(controller, arm.joints)
    if long:
        long.trace(mine, inputs.array)
    _prescribe(mine, inputs, arm)
    torque = mine.update(inputs.array("time")[()], measurement, reference)
    if np.shape(torque) != (arm.joints,):
        found = np.shape(torque)
        raise SymbolError(f"returns torques of shape {found} instead of ({arm.joints},)")
    return torque


def _readings(arm: Arm, controller: Any) -> list[str]:
    """Return the names of the readings; raise if the controller cannot be exported."""
    kind = next((kind for kind in _REFUSED if isinstance(controller, kind)), None)
    if kind is not None:
        raise _refusal(controller, _REFUSED[kind])
    if _declared(controller) is None:
        raise _refusal(controller, "It does not declare its memory.")
    long = long_memory(controller, arm.joints)
    if long and long.size > _MOST_MEMORY:
        reason = f"It has a memory of {long.size} numbers, more than {_MOST_MEMORY}."
        raise _refusal(controller, reason)
    inner = getattr(controller, "inner", None)
    if long and gain_table(inner):
        reason = "A controller inside it interpolates gains over the posture. Use one posture."
        raise _refusal(controller, reason)
    if isinstance(inner, TaskController):
        reason = f"{type(inner).__name__} inside it controls the tip. Export that one alone."
        raise _refusal(controller, reason)
    if isinstance(inner, LQG):
        name = type(inner).__name__
        reason = f"{name} inside it follows a nominal motion. Export that one alone."
        raise _refusal(controller, reason)
    presses = isinstance(controller, TaskController)
    pressed: Any = PressedInputs(Inputs(), arm.joints) if presses else None
    needed = requirements_of(controller, arm, pressed)
    if needed.joints not in (None, arm.joints):
        rule = f"be for an arm with {arm.joints} joints"
        raise InputError(Problem("controller", rule, f"one for {needed.joints}"))
    sizes = reading_sizes(arm)
    unknown = [name for name in needed.measured if name not in sizes]
    if unknown:
        raise _refusal(controller, f"It reads {unknown[0]!r}; possible: {', '.join(sizes)}.")
    more = _readings(arm, inner) if inner is not None else []
    return list(dict.fromkeys([*(needed.measured or ("joint_angle", "joint_rate")), *more]))


def _beside(controller: Any, joints: int) -> LongMemory | None:
    """Return the numbers of a controller that the traced update does not contain, or None."""
    return long_memory(controller, joints) or gain_table(controller)


def _declared(controller: Any) -> tuple[str, ...] | None:
    """Return the memory of a controller without its long one; None if it is not declared."""
    if type(controller) is RBFAdaptive:
        return Adaptive.memory[1:]
    if type(controller) is RepetitiveControl:
        inside = _declared(controller.inner)
        return None if inside is None else tuple(f"inner.{name}" for name in inside)
    own = memory_of(controller)
    # JointPID does not declare the sag, because its derivatives by itself can be rounding errors.
    sagging = (isinstance(one, JointPID) and one.sag for one in around(controller))
    sag = ("inner." * depth + "_weight._bend" for depth, one in enumerate(sagging) if one)
    return None if own is None else (*own, *sag)


def _memory(controller: Any) -> Memory:
    """Return the memory of a symbolic controller without its long one."""
    own = memory_of(controller) or ()
    more = [name for name in _declared(controller) or () if name not in own]
    return Memory(controller, _KINDS, more)


def reading_sizes(arm: Arm) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the readings that exported controllers may use."""
    gauges = {"strain": (len(arm.gauges),)} if arm.gauges else {}
    joints = {"joint_angle": (arm.joints,), "joint_rate": (arm.joints,)}
    return {**joints, "tip": (2,), "contact_force": (1, 2), **gauges}


def _prescribe(owner: Any, inputs: Inputs, arm: Arm) -> None:
    """Replace feedforward torques by an input, and static bending by its value at each sample."""
    if isinstance(owner, JointFollower) and owner.feedforward is not None:
        torque = inputs.array("feedforward", arm.joints)
        ahead: Any = lambda _: torque  # noqa: E731
        owner._ahead = ahead
    if isinstance(owner, StrainDamping):
        correction = inputs.array("strain_correction", len(arm.gauges))
        owner._nominal = StaticBending(owner._nominal, correction)  # type: ignore[assignment]
    if hasattr(owner, "inner"):
        _prescribe(owner.inner, inputs, arm)


def rest_motion(controller: LQG) -> tuple[LQG, Nominal]:
    """Return a controller at rest in the posture of its design, and its nominal motion."""
    still: Any = deepcopy(controller.at_rest())
    still.reset()
    return still, still._motion.at(0.0, still.posture, None)


def nominal_values(controller: LQG, nominal: Nominal) -> dict[str, FloatArray]:
    """Return the inputs of the exported `LQG` for a nominal motion, after its evaluation."""
    force = controller._motion.missing[preview_nodes(controller)]
    return {
        "nominal_angle": np.array(nominal.angle),
        "nominal_torque": np.array(nominal.torque),
        "nominal_reading": np.array(nominal.shown),
        "nominal_tip": controller._desired_tip(nominal),
        "nominal_force": np.array(force).ravel(),
    }


def _functions(
    controller: Controller, laws: list[tuple[str, Any, Any]]
) -> tuple[NamedFunction, ...]:
    """Create the functions; inputs on which no function depends are left out."""
    used = set()
    for _, symbols, outputs in laws:
        found = casadi.vertcat(*outputs.values())
        used |= {n for n, s in symbols.items() if s.numel() and casadi.depends_on(found, s)}
        # Symbols of the first sample that remain in the second: by identity, as names repeat.
        known = {one.element_hash() for one in casadi.symvar(casadi.vertcat(*symbols.values()))}
        if not {one.element_hash() for one in casadi.symvar(found)} <= known:
            raise _refusal(controller, "It keeps numbers that its memory does not declare.")
    summaries = {
        "controller_start": "Torque of {} at the first sample, where its memory starts.",
        "controller_update": "Torque of {} from a sample to the next one.",
    }
    functions = []
    for name, symbols, outputs in laws:
        own = {key: symbol for key, symbol in symbols.items() if key in used}
        functions.append(
            named(name, summaries[name].format(type(controller).__name__), own, outputs)
        )
    return tuple(functions)


def _refusal(controller: object, reason: str) -> InputError:
    rule, value = "have a law in closed form", type(controller).__name__
    return InputError(Problem("controller", rule, value, reason))
