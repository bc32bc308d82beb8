"""Laws as functions of symbols: the source of ``step``, evaluated over CasADi scalars.

There is no second law. The exported function has the numbers of the controller object, and calls
the kernels of its rigid model over symbols. Planned inputs are symbols, too, where the exported
code computes them from the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem
from flexarm.bridges.c_code.model_functions import NamedFunction, named
from flexarm.bridges.symbolic.kernel_calls import SymbolError, objects, plain
from flexarm.bridges.symbolic.symbol_array import SymbolArray, branched, make_symbolic, symbol_array
from flexarm.control.contract.base import Arrays, Rest, around, is_law, requirements_of
from flexarm.control.design.nominal import Interpolated
from flexarm.control.design.rigid_model import SurfaceMotion
from flexarm.control.hardware.measurement import Measurement
from flexarm.control.laws import LQG, MPC, Controller, EstimatorController, RepetitiveControl

#: Coefficients of friction of the two references, where they are not given.
FRICTION = {"reference_friction": np.zeros(1), "rougher_friction": np.ones(1)}
_Array = Callable[..., Any]


def plan_over(law: Any, arm: Arm, array: _Array, t: float = 0.0) -> Arrays | None:
    """Return the planned inputs of a law at a time t (s); None if they are inputs of the code.

    ``array`` returns the array of an input of the code, by name and shape: symbols or numbers.
    """
    if not any(map(exports_plan, around(law))):
        return None
    # Plans that this package wrote may read the reference at other times.
    plans = (type(part).planned.__module__ for part in around(law) if exports_plan(part))
    outside = not all(module.startswith("flexarm.") for module in plans)
    now = float("nan") if outside else t
    reference: Any = ReferenceInputs(array, arm.n_joints, now=now if outside else None)
    sizes = {"path_speed": 1, "reference_force_rate": 1, "path_position": 2}
    speed, force_rate, position = (array(*size) for size in sizes.items())
    planned = dict(law.planned(now, reference))
    if outside and _has_nan(planned):
        raise SymbolError("plans by the time itself, which exported code does not know")
    # These depend on the reference at other times, or on its own bending.
    if "nominal_strain" in planned:
        correction = array("strain_correction", len(arm.gauges))
        planned["nominal_strain"] = planned["nominal_strain"] + correction
    if "feedforward" in planned:
        planned["feedforward"] = array("feedforward", arm.n_joints)
    if "surface" in planned:
        planned["surface"] = SurfaceMotion(*position, *speed, *force_rate)
    return planned


def exports_plan(controller: Any) -> bool:
    """Return whether exported code computes the planned inputs of a controller."""
    return bool(getattr(controller, "exports_plan", False))


def _has_nan(planned: Arrays) -> bool:
    """Return whether NaN, the time of a sample, is a constant of planned inputs."""
    values = [plain(value) for array in planned.values() for value in np.ravel(array)]
    column = casadi.vertcat(*map(casadi.SX, values))
    function = casadi.Function("planned", casadi.symvar(column), [column])
    places = range(function.n_instructions())
    constants = (k for k in places if function.instruction_id(k) == casadi.OP_CONST)
    return any(np.isnan(function.instruction_constant(k)) for k in constants)


class ReferenceInputs:
    """Reference that presses, such as `PressedMotion`, whose values are symbols at every time.

    ``rougher`` has the same force, and other joint motions for more friction. ``now`` is the only
    object that is accepted as time; None accepts all times.
    """

    def __init__(
        self, array: _Array, joints: int, prefix: str = "reference", now: float | None = None
    ) -> None:
        self._array, self._joints, self._now = array, joints, now
        self.joint_angle = self._constant(array(f"{prefix}_angle", joints))
        self.joint_rate = self._constant(array(f"{prefix}_rate", joints))
        self.joint_acceleration = self._constant(array(f"{prefix}_acceleration", joints))
        self.contact_force = self._constant(array("reference_force", 1).reshape(()))
        self.normal = self._constant(array("reference_normal", 2))
        self.pressing_torque = self._constant(array(f"{prefix}_pressing", joints))
        self.friction = array(f"{prefix}_friction", 1)[0]

    @property
    def rougher(self) -> ReferenceInputs:
        return ReferenceInputs(self._array, self._joints, "rougher", self._now)

    def _constant(self, values: Any) -> Callable[[float], Any]:
        def at(t: float) -> Any:
            if self._now is not None and t is not self._now:
                raise SymbolError("plans by the reference at another time than that of the sample")
            return values

        return at


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
    planned = law.planned(0.0, Rest({"joint_angle": np.zeros(arm.n_joints)}))
    law.reset()
    table = gain_table(law)
    make_symbolic(law, _PACKAGES)
    shapes: dict[str, tuple[int, ...]] = {}
    stored = table.trace(law, symbols.array) if table else None

    def results(memory_of: Callable[[Measurement, Arrays], Arrays]) -> dict[str, Any]:
        readings = Measurement(**{name: symbols.array(name, *sizes[name]) for name in names})
        inputs = plan_over(law, arm, symbols.array) or {
            name: symbols.array(name, *np.shape(value)) for name, value in planned.items()
        }
        memory = memory_of(readings, inputs)
        after, torque = law.step(memory, readings, inputs)
        if np.shape(torque) != (arm.n_joints,):
            found = np.shape(torque)
            raise SymbolError(f"returns torques of shape {found} instead of ({arm.n_joints},)")
        if {name: np.shape(value) for name, value in after.items()} != shapes:
            raise SymbolError("changes the names or the sizes of its memory")
        numbers = [np.ravel(after[name]) for name in shapes]
        outputs: dict[str, Any] = {"memory_out": np.concatenate(numbers)} if shapes else {}
        outputs["torque"] = torque
        if stored is not None:
            outputs["stored"] = stored
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
    reference: Any = ReferenceInputs(_Inputs().array, arm.n_joints)
    follows = any(map(exports_plan, around(controller)))
    needed = requirements_of(controller, arm, reference if follows else None)
    if needed.joints not in (None, arm.n_joints):
        rule = f"be for an arm with {arm.n_joints} joints"
        raise InputError(Problem("controller", rule, f"one for {needed.joints}"))
    sizes = reading_sizes(arm)
    unknown = [name for name in needed.measured if name not in sizes]
    if unknown:
        raise refusal(controller, f"It reads {unknown[0]!r}; possible: {', '.join(sizes)}.")
    return list(needed.measured or ("joint_angle", "joint_rate"))


def reading_sizes(arm: Arm) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the readings that exported controllers may use."""
    gauges = {"strain": (len(arm.gauges),)} if arm.gauges else {}
    joints = {"joint_angle": (arm.n_joints,), "joint_rate": (arm.n_joints,)}
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


class GainTable:
    """Gains at the nodes of a grid of postures, which exported code interpolates in a loop.

    The traced step has symbols for the gains at its posture, the ``view``, and returns this posture
    as ``stored``. ``depth`` controllers are around the one with the table, its attribute ``name``;
    ``ends`` (2, joints) rad are the first and the last posture of the grid.
    """

    def __init__(self, depth: int, name: str, table: Interpolated) -> None:
        self._depth, self._name, axes = depth, name, table.grid.axes
        self._shapes, self.ends = table.shapes, table.grid.postures[[0, -1]]
        self._grids = [np.array(values) for _, values, _ in axes]
        self._joints = [joint for joint, _, _ in axes]
        # The last joint of the grid changes fastest, in CasADi the first one. The grid of places,
        # 0, 1, 2 and so on, is searched by a division instead of a loop.
        places = [list(range(len(values))) for values in reversed(self._grids)]
        search = {"lookup_mode": ["exact"] * len(places)}
        self._lookup = casadi.interpolant("gains", "linear", places, table.values.ravel(), search)

    def trace(self, law: Any, array: Callable[..., Any]) -> list[Any]:
        """Let a symbolic law use the view; return the angles in the grid of its last evaluation."""
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        parts = np.split(array("view", sum(sizes)), np.cumsum(sizes)[:-1])
        arrays = [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        stored: list[Any] = []

        def at(angle: Any) -> list[Any]:
            stored[:] = [angle[joint] for joint in self._joints]
            return arrays

        traced: Any = getattr(list(around(law))[self._depth], self._name)
        traced.at = at
        return stored

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
    for depth, law in enumerate(around(controller)):
        for name, table in getattr(law, "__dict__", {}).items():
            if isinstance(table, Interpolated) and table.grid.axes:
                return GainTable(depth, name, table)
    return None
