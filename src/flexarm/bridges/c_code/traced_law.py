"""Laws as functions of symbols: the source of ``step``, evaluated over CasADi scalars.

There is no second law. The exported function has the numbers of the controller object, and calls
the kernels of its rigid model over symbols. Planned inputs are symbols, too, where the exported
code computes them from the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem
from flexarm.bridges.c_code.model_functions import NamedFunction, named
from flexarm.bridges.symbolic.casadi_model import casadi_model
from flexarm.bridges.symbolic.kernel_calls import symbolic
from flexarm.bridges.symbolic.scalars import SymbolError, objects, plain
from flexarm.bridges.symbolic.symbol_array import SymbolArray, branched, make_symbolic, symbol_array
from flexarm.control.contract.base import Arrays, Rest, is_law, requirements_of
from flexarm.control.design.nominal import Interpolated, Nominal
from flexarm.control.design.task_space import (
    SurfaceMotion,
    SurfacePlan,
    TaskPlan,
    TaskSpace,
    TaskState,
)
from flexarm.control.hardware.measurement import Measurement
from flexarm.control.laws import (
    LQG,
    MPC,
    Controller,
    EstimatorController,
    RepetitiveControl,
)
from flexarm.control.laws.strain_damping import StrainDamping
from flexarm.control.laws.task_controller import TaskController
from flexarm.kernels.controller_terms.task_dynamics import tip_torque

#: Coefficients of friction of the two references, where they are not given.
FRICTION = {"reference_friction": np.zeros(1), "rougher_friction": np.ones(1)}
_Array = Callable[..., Any]


def plan_over_symbols(law: Any, arm: Arm, array: _Array) -> Arrays | None:
    """Return planned inputs of a symbolic law, its plans replaced; None if they are symbols."""
    parts = list(around(law))
    presses = any(isinstance(part, TaskController) for part in parts)
    if not presses and not any(isinstance(part, StrainDamping) for part in parts):
        return None
    reference: Any = (PressedInputs if presses else ReferenceInputs)(array, arm.joints)
    for part in parts:
        if isinstance(part, TaskController) and not isinstance(part._task, SymbolicTask):
            part._task = SymbolicTask(part.arm)
            _plan_task(part, array)
        if isinstance(part, StrainDamping) and not isinstance(part._nominal, StaticBending):
            correction = array("strain_correction", len(arm.gauges))
            part._nominal = StaticBending(part._nominal, correction)  # type: ignore[assignment]
    planned = dict(law.planned(0.0, reference))
    if "feedforward" in planned:
        planned["feedforward"] = array("feedforward", arm.joints)
    return planned


def around(controller: Any) -> Iterator[Any]:
    """Iterate over a controller, the controller inside it, and so on."""
    while controller is not None:
        yield controller
        controller = getattr(controller, "inner", None)


class ReferenceInputs:
    """Reference whose values are symbols, at every time."""

    def __init__(self, array: _Array, joints: int, prefix: str = "reference") -> None:
        self._angle = array(f"{prefix}_angle", joints)
        self._rate = array(f"{prefix}_rate", joints)
        self._acceleration = array(f"{prefix}_acceleration", joints)

    def joint_angle(self, t: float) -> Any:
        return self._angle

    def joint_rate(self, t: float) -> Any:
        return self._rate

    def joint_acceleration(self, t: float) -> Any:
        return self._acceleration


class PressedInputs(ReferenceInputs):
    """Reference that presses, such as `PressedMotion`, whose values are symbols at every time.

    ``rougher`` has the same force, and other joint motions for more friction.
    """

    def __init__(self, array: _Array, joints: int, prefix: str = "reference") -> None:
        super().__init__(array, joints, prefix)
        self._array, self._joints = array, joints
        self._force = array("reference_force", 1)[0]
        self._normal = array("reference_normal", 2)
        self._pressing = array(f"{prefix}_pressing", joints)
        self.friction = array(f"{prefix}_friction", 1)[0]

    @property
    def rougher(self) -> PressedInputs:
        return PressedInputs(self._array, self._joints, "rougher")

    def contact_force(self, t: float) -> Any:
        return self._force

    def normal(self, t: float) -> Any:
        return self._normal

    def pressing_torque(self, t: float) -> Any:
        return self._pressing


class StaticBending:
    """Nominal motion of `StrainDamping`, computed at every sample instead of in advance."""

    def __init__(self, planned: Any, correction: Any) -> None:
        self._planned, self._correction = planned, correction

    def at(self, t: float, reference: Any) -> Nominal:
        parts = reference.joint_angle, reference.joint_rate, reference.joint_acceleration
        rows_of_plan = self._planned.along(*(part(t)[None] for part in parts))
        static = Nominal(*(rows[0] for rows in rows_of_plan))
        return static._replace(shown=static.shown + self._correction)


class SymbolicTask(TaskSpace):
    """Kinematics and dynamics of the rigid model at its tip, over symbols.

    The kernels of `TaskSpace` differentiate by complex numbers; here CasADi differentiates.
    """

    def __init__(self, arm: Arm) -> None:
        model, self.joints = casadi_model(arm.rigid()), arm.joints
        q, qd = casadi.SX.sym("q", self.joints), casadi.SX.sym("qd", self.joints)
        none = casadi.SX(0, 1)
        velocity = model.tip_velocity(q, qd, none)[:2]
        parts = {
            "motion": casadi.horzcat(
                model.tip(q, none)[:2], velocity, casadi.jtimes(velocity, q, qd)
            ).T,
            "jacobian": casadi.jacobian(velocity, qd),
            "mass": model.mass_matrix(q, none),
            "bias": model.bias_force(q, qd, none),
        }
        self._function = casadi.Function("task", [q, qd], list(parts.values()))

    def at(self, angle: Any, rate: Any) -> TaskState:
        """See ``TaskSpace.at``."""
        given = (casadi.vertcat(*map(plain, one)) for one in (angle, rate))
        motion, jacobian, mass, bias = map(_entries, self._function(*given))
        return TaskState(motion, jacobian, mass, bias[:, 0])

    def torque(
        self, state: TaskState, acceleration: Any, push: Any, posture: Any, added: Any
    ) -> Any:
        """See ``TaskSpace.torque``."""
        torque = symbol_array(np.zeros(self.joints))
        symbolic(tip_torque)(*state, posture, *acceleration, *push, added, torque)
        return torque


def _entries(matrix: Any) -> Any:
    """Return a matrix of CasADi as an array of symbols."""
    entries = objects(casadi.vertsplit(casadi.vec(casadi.densify(matrix.T))), casadi)
    return symbol_array(entries.reshape(matrix.shape))


class _Plan(TaskPlan):
    """Requested motion of the tip, from the rigid model at the reference."""

    def __init__(self, controller: Any) -> None:
        super().__init__(controller.arm, controller.sample_time)
        self._task = controller._task

    def row(self, t: float, reference: Any) -> Any:
        angle, rate = reference.joint_angle(t), reference.joint_rate(t)
        acceleration = reference.joint_acceleration(t)
        position, velocity, drift = (state := self._task.at(angle, rate)).motion
        numbers = (position, velocity, drift + state.jacobian @ acceleration)
        force = symbol_array([reference.contact_force(t)])
        motion = (angle, rate, acceleration, reference.pressing_torque(t))
        return symbol_array(np.concatenate([*numbers, force, reference.normal(t), *motion]))


class _SurfacePlan(SurfacePlan):
    """Requested motion along a surface, from symbols."""

    def __init__(self, array: _Array) -> None:
        speed, force_rate = array("path_speed", 1), array("reference_force_rate", 1)
        self._motion_of = SurfaceMotion(*array("path_position", 2), *speed, *force_rate)

    def along(self, t: float, reference: Any) -> SurfaceMotion:
        return self._motion_of


def _plan_task(controller: Any, array: _Array) -> None:
    """Replace the requested motion of a controller by symbols."""
    controller._plan = _Plan(controller)
    if hasattr(controller, "_surface"):
        controller._rougher, controller._surface = controller._plan, _SurfacePlan(array)


#: Packages whose objects belong to a controller.
_PACKAGES = ("flexarm.control.laws", "flexarm.control.design")
#: Reasons why the law of a controller cannot be exported.
_REFUSED: dict[type[Any], str] = {
    EstimatorController: "Its parts are exported one by one: `inner` and `estimator`.",
    MPC: "It solves an optimisation problem at every sample.",
    RepetitiveControl: "Its memory is a whole period.",
}
#: Most numbers in a memory: each of them is a statement in C, and gcc takes 19 s for 500 weights.
_MOST_MEMORY = 500


@dataclass(frozen=True, eq=False)
class TracedController:
    """Functions of a controller."""

    controller: Controller  # not modified
    #: ``controller_start`` and ``controller_update``; only the latter without memory.
    functions: tuple[NamedFunction, ...]
    memory: int  # its size between samples
    defaults: Mapping[str, FloatArray]  # values of inputs whose pointer is NULL, by name

    @property
    def sample_time(self) -> float:
        """Sample time, s."""
        return float(self.controller.sample_time)


@dataclass(eq=False)
class _Inputs:
    """Symbols of the inputs, by name."""

    symbols: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str, *shape: int) -> SymbolArray:
        """Return the array of an input, with the same symbols in each call."""
        new = casadi.SX.sym(name, int(np.prod(shape)))
        symbol = self.symbols.setdefault(name, new)
        entries = casadi.vertsplit(symbol) if symbol.numel() else []
        return symbol_array(objects(entries, casadi).reshape(shape))


def traced_controller(arm: Arm, controller: Controller) -> TracedController:
    """Return the functions of a controller of an arm; InputError if it cannot be exported."""
    readings = _readings(arm, controller)
    law: Any = deepcopy(controller)
    # A reset and plans compute with numbers, so they come first.
    law.reset()
    try:
        inputs, first, later, size = _traced(law, arm, readings)
    except InputError:
        raise
    except Exception as error:  # a user's code over symbols may raise any
        cause = "" if isinstance(error, SymbolError) else "does with numbers what symbols cannot: "
        raise refusal(controller, f"Its step {cause}{error}".rstrip(".") + ".") from None
    functions = _functions(controller, inputs, [first, later] if size else [later])
    table = gain_table(controller)
    if table:
        functions = tuple(map(table.around, functions))
    used = {name for function in functions for name in function.inputs}
    static = {"strain_correction": np.zeros(len(arm.gauges))}
    every = _at_rest(controller) | FRICTION | static
    defaults = {name: np.ravel(value) for name, value in every.items() if name in used}
    return TracedController(controller, functions, size, defaults)


def _traced(law: Any, arm: Arm, names: list[str]) -> tuple[_Inputs, Any, Any, int]:
    """Return symbols, results of the first sample and of later ones, and the size of the memory."""
    symbols, sizes = _Inputs(), reading_sizes(arm)
    planned = law.planned(0.0, Rest({"joint_angle": np.zeros(arm.joints)}))
    law.reset()
    table = gain_table(law)
    make_symbolic(law, _PACKAGES)
    shapes: dict[str, tuple[int, ...]] = {}
    gains = table.trace(law, symbols.array) if table else None

    def results(
        memory_of: Callable[[Measurement, Arrays], Arrays],
    ) -> dict[str, Any]:
        readings = Measurement(**{name: symbols.array(name, *sizes[name]) for name in names})
        inputs = plan_over_symbols(law, arm, symbols.array) or {
            name: symbols.array(name, *np.shape(value)) for name, value in planned.items()
        }
        memory = memory_of(readings, inputs)
        after, torque = law.step(memory, readings, inputs)
        if np.shape(torque) != (arm.joints,):
            found = np.shape(torque)
            raise SymbolError(f"returns torques of shape {found} instead of ({arm.joints},)")
        if {name: np.shape(value) for name, value in after.items()} != shapes:
            raise SymbolError("changes the names or the sizes of its memory")
        numbers = [np.ravel(after[name]) for name in shapes]
        outputs = {"memory_out": np.concatenate(numbers)} if shapes else {}
        outputs["torque"] = torque
        if gains is not None:
            outputs["stored"] = gains.stored
        return {
            key: casadi.vertcat(*(casadi.SX(plain(one)) for one in np.ravel(values)))
            for key, values in outputs.items()
        }

    def initial(readings: Measurement, inputs: Arrays) -> Arrays:
        memory: Arrays = law.initial_memory(readings, inputs)
        shapes.update({name: np.shape(value) for name, value in memory.items()})
        if (count := sum(map(np.size, memory.values()))) > _MOST_MEMORY:
            reason = f"It has a memory of {count} numbers, more than {_MOST_MEMORY}."
            raise refusal(law, reason)
        return memory

    def kept(readings: Measurement, inputs: Arrays) -> Arrays:
        counts = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
        parts = np.split(symbols.array("memory", int(counts[-1])), counts[:-1]) if shapes else []
        named_parts = zip(shapes.items(), parts, strict=True)
        return {name: part.reshape(shape)[()] for (name, shape), part in named_parts}

    first = branched(lambda: results(initial))
    symbols.symbols = {"memory": casadi.SX.sym("memory", _count(shapes)), **symbols.symbols}
    return symbols, first, branched(lambda: results(kept)), _count(shapes)


def _count(shapes: Mapping[str, tuple[int, ...]]) -> int:
    return sum(int(np.prod(shape)) for shape in shapes.values())


def _at_rest(controller: Controller) -> dict[str, Any]:
    """Return the planned inputs of `LQG` at rest in the posture of its design."""
    if not isinstance(controller, LQG):
        return {}
    still: Any = deepcopy(controller.at_rest())
    still.reset()
    return dict(still.planned(0.0, Rest({"joint_angle": still.posture})))


def _readings(arm: Arm, controller: Any) -> list[str]:
    """Return the names of the readings; raise if the controller cannot be exported."""
    for part in around(controller):
        reason = next((why for kind, why in _REFUSED.items() if isinstance(part, kind)), None)
        if reason is None and not is_law(part):
            reason = "It has an update instead of a step."
        if reason is not None:
            raise refusal(part, reason)
    presses = any(isinstance(part, TaskController) for part in around(controller))
    pressed: Any = PressedInputs(_Inputs().array, arm.joints) if presses else None
    needed = requirements_of(controller, arm, pressed)
    if needed.joints not in (None, arm.joints):
        rule = f"be for an arm with {arm.joints} joints"
        raise InputError(Problem("controller", rule, f"one for {needed.joints}"))
    sizes = reading_sizes(arm)
    unknown = [name for name in needed.measured if name not in sizes]
    if unknown:
        raise refusal(controller, f"It reads {unknown[0]!r}; possible: {', '.join(sizes)}.")
    return list(needed.measured or ("joint_angle", "joint_rate"))


def reading_sizes(arm: Arm) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the readings that exported controllers may use."""
    gauges = {"strain": (len(arm.gauges),)} if arm.gauges else {}
    joints = {"joint_angle": (arm.joints,), "joint_rate": (arm.joints,)}
    return {**joints, "tip": (2,), "contact_force": (1, 2), **gauges}


def _functions(
    controller: Controller, inputs: _Inputs, results: list[dict[str, Any]]
) -> tuple[NamedFunction, ...]:
    """Create the functions, without unused inputs; InputError if they depend on other symbols."""
    used = set()
    given = casadi.vertcat(*inputs.symbols.values())
    known = {one.element_hash() for one in casadi.symvar(given)}  # by identity, as names repeat
    for outputs in results:
        column = casadi.vertcat(*outputs.values())
        used |= {n for n, s in inputs.symbols.items() if s.numel() and casadi.depends_on(column, s)}
        if not {one.element_hash() for one in casadi.symvar(column)} <= known:
            raise refusal(controller, "Its step changes attributes of the controller.")
    kind = type(controller).__name__
    summaries = {
        "controller_start": f"Torque of {kind} at the first sample, where its memory starts.",
        "controller_update": f"Torque of {kind} from a sample to the next one.",
    }
    functions = []
    for (name, summary), outputs in zip(
        [*summaries.items()][-len(results) :], results, strict=True
    ):
        first = name == "controller_start"
        own = {
            key: symbol
            for key, symbol in inputs.symbols.items()
            if key in used and not (first and key == "memory")
        }
        functions.append(named(name, summary, own, outputs))
    return tuple(functions)


def refusal(controller: object, reason: str) -> InputError:
    rule, value = "have a law in closed form", type(controller).__name__
    return InputError(Problem("controller", rule, value, reason))


@dataclass(eq=False)
class _Gains:
    """Gains at a posture as symbols, instead of `Interpolated`."""

    arrays: list[Any]
    joints: list[int]
    stored: Any = ()

    def at(self, angle: Any) -> list[Any]:
        """Return the gains, and store the angles of the joints in the grid."""
        self.stored = [angle[joint] for joint in self.joints]
        return self.arrays


class GainTable:
    """Gains at the nodes of a grid of postures, which exported code interpolates in a loop.

    The traced step has symbols for the gains at its posture, the ``view``, and returns this posture
    as ``stored``. ``depth`` controllers are around the one with the table; ``ends`` (2, joints) rad
    are the first and the last posture of the grid.
    """

    def __init__(self, depth: int, table: Interpolated) -> None:
        self._depth = depth
        self._shapes, self.ends = table._shapes, table._grid.postures[[0, -1]]
        self._grids = [np.array(values) for _, values, _ in table._grid._axes]
        self._joints = [joint for joint, _, _ in table._grid._axes]
        # The last joint of the grid changes fastest, in CasADi the first one. The grid of places,
        # 0, 1, 2 and so on, is searched by a division instead of a loop.
        places = [list(range(len(values))) for values in reversed(self._grids)]
        search = {"lookup_mode": ["exact"] * len(places)}
        self._lookup = casadi.interpolant("gains", "linear", places, table._values.ravel(), search)

    def trace(self, law: Any, array: Callable[..., Any]) -> _Gains:
        """Let a symbolic law use the view."""
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        parts = np.split(array("view", sum(sizes)), np.cumsum(sizes)[:-1])
        arrays = [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        gains = _Gains(arrays, self._joints)
        list(around(law))[self._depth]._arrays = gains
        return gains

    def around(self, core: NamedFunction) -> NamedFunction:
        """Return a function without the view, which is interpolated at the posture of ``core``."""
        inner = core.function
        names = [name for name in inner.name_in() if name != "view"]
        symbols = {name: casadi.MX.sym(name, inner.numel_in(name)) for name in names}
        posture = inner.factory("posture", inner.name_in(), ["stored"])
        none = casadi.MX.zeros(self._lookup.numel_out())
        angles = casadi.vertsplit(posture(**symbols, view=none)["stored"].T)
        places = [_place(*pair) for pair in zip(angles, self._grids, strict=True)]
        outputs = inner(**symbols, view=self._lookup(casadi.vertcat(*reversed(places))))
        kept = [name for name in inner.name_out() if name != "stored"]
        # Functions of C return columns as rows.
        return named(core.name, core.summary, symbols, {name: outputs[name].T for name in kept})


def _place(angle: Any, values: Any) -> Any:
    """Return the place of an angle in a grid, such as 1.5 between the second and the third."""
    parts = (angle - values[:-1]) / np.diff(values)
    return casadi.sum1(casadi.fmax(0.0, casadi.fmin(1.0, parts)))


def gain_table(controller: Any) -> GainTable | None:
    """Return the table of gains of a controller, or of a controller inside it; None without."""
    for depth, one in enumerate(around(controller)):
        table = getattr(one, "_arrays", None)
        if isinstance(table, Interpolated) and table._grid._axes:
            return GainTable(depth, table)
    return None
