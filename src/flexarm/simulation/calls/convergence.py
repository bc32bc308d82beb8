"""Choice of modes, segments and theory by cheap runs: ``flexarm.converged``.

All links become finer together until the tip of two successive runs hardly differs: first more
modes, then segments too, with the second-order theory, so that the limit is the geometrically exact
beam. The finest run is the reference. Coarser models, link by link, are then compared with it
directly, so that a model counts as accurate only by its own tip over the whole run.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Unpack

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.bending import BendingErrors
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    InputError,
    Problem,
    check_array,
    public_call,
    warn_caller,
    without_warnings,
)
from flexarm.base.late import xr
from flexarm.base.user_functions import FunctionError, call
from flexarm.integrate import KennedyCarpenter5
from flexarm.integrate.base import FloatArray
from flexarm.model.arm.links import MOST_ELEMENTS, Link
from flexarm.model.arm.spec import serial_only
from flexarm.simulation.calls.preparation import RunArguments, Situation, situation_of
from flexarm.simulation.calls.run import simulated
from flexarm.simulation.run.integrator_choice import explicit_work
from flexarm.simulation.run.settings import RunSettings, replaced, with_keywords
from flexarm.simulation.run.tolerance import fastest_frequency, reach_of, tolerance_of_request

#: Accuracy over the reach by default: stiffness and deflections are rarely known better.
_DEFAULT = 1e-4
#: Parts of the accuracy: of the integration of the runs that are compared and of the result, and of
#: the error of the reference.
_COMPARED, _INTEGRATION, _REFERENCE = 0.1, 0.2, 0.25
#: Largest difference of the last two of all runs over the accuracy, and the difference before it,
#: without which one small difference may be a coincidence.
_LAST, _BEFORE = 0.5, 2.0
#: Error of the finer of two runs over their difference: at least, and at most, as for errors that
#: fall with the number of modes (of segments, which double), if differences do not fall faster.
_LEAST_TAIL, _TAIL_OF_MODES, _TAIL_OF_SEGMENTS = 0.5, 3.0, 1.0
#: Largest error of the result over that of the finest run, where no run is accurate enough.
_ENOUGH = 1.25
#: Largest estimated error of the theory over the accuracy that no segments have to confirm, and the
#: largest one that is worth a comparison: it is 1 to 16 times the difference of runs with segments.
_UNBENT, _WORTH = 0.01, 16.0
#: Steps from a rigid link to the finest one: modes of each segment, and segments. Two modes of a
#: segment are its static shapes under a force and a moment.
_DIVISIBLE = ((0, 1), (1, 1), (2, 1), (3, 1), (2, 2), (2, 4), (2, 8), (2, 16))
#: The same for a link whose damping does not permit segments.
_ONE_PIECE = ((0, 1), (1, 1), (2, 1), (3, 1), (4, 1), (6, 1), (8, 1), (12, 1))
#: Segments of all links in a run without damping, from which the error of one piece follows.
_UNDAMPED = 4
#: Work of the study over that of the plain model, whose links have two modes: four segments of all
#: links take about 80 times its work if the fastest vibration determines the steps.
_PLAIN, _LIMIT = 2, 200.0
#: Work of an evaluation of the implicit method over that of an explicit one, at equal error.
_IMPLICIT = 2.5
#: Elements of a link in one piece, at least, and of a segment: the modes of more elements cost only
#: time before the run, and theirs differ by less than those that the modes neglect.
_ELEMENTS, _OF_SEGMENT = 8, 2


class Mesh(NamedTuple):
    """Discretisation of an arm."""

    steps: tuple[int, ...]  # of each link, in its tuple of steps
    theory: str = "second_order"
    undamped: int = 0  # segments of links whose damping permits none, without it; 0 with damping


@dataclass(frozen=True, eq=False)
class ConvergedRun:
    """Run of an arm whose discretisation was chosen by `flexarm.converged`.

    Attributes:
        arm: the arm with the chosen elements, modes, segments and theory.
        result: its run, as from `flexarm.simulate`, with the attributes ``accuracy``,
            ``model_error`` and ``integration_error`` (m, at the tip).
        table: Dataset of all runs of the study over ``candidate`` in their order, and ``link``:
            ``elements``, ``modes`` (of each segment, 0 for a rigid link), ``segments``, ``theory``,
            ``highest_frequency`` (Hz), ``model_error`` (m, estimated, NaN if the run failed),
            ``evaluations``, ``seconds``, and ``chosen``.
        model_error: estimated error of the tip by modes, segments and theory, m.
        accuracy: requested error of the tip by model and integration, m.
        converged: whether both errors together are at most ``accuracy``.
    """

    arm: Arm
    result: xr.Dataset
    table: xr.Dataset
    model_error: float
    accuracy: float
    converged: bool

    def __repr__(self) -> str:
        return (
            f"<flexarm.ConvergedRun: {self.arm.dof} coordinates, {self.arm.spec.theory} theory, "
            f"model error {self.model_error:.2g} m of {self.accuracy:.2g} m"
            f"{'' if self.converged else ', not converged'}>"
        )

    def __str__(self) -> str:
        names = ("modes", "segments", "theory", "model_error", "evaluations", "chosen")
        rows = [("modes", "segments", "theory", "error (m)", "evaluations", "")]
        for values in zip(*(self.table[name].values for name in names), strict=True):
            modes, segments = (" + ".join(map(str, value)) for value in values[:2])
            theory, error, evaluations, chosen = values[2:]
            mark = "chosen" if chosen else ""
            rows.append((modes, segments, str(theory), f"{error:.2g}", str(evaluations), mark))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        return "\n".join([repr(self), *lines])


@public_call
@with_keywords(RunArguments, Situation)
def converged(
    arm: Arm,
    duration: float,
    *,
    settings: RunSettings | None = None,
    **arguments: Unpack[RunArguments],
) -> ConvergedRun:
    """Choose elements, modes, segments and theory of an arm for a run, and execute it.

    Runs with more and more modes, then segments, of the second-order theory are compared until two
    refinements show that the tip converges. The cheapest model whose tip is close enough to that of
    the finest one is chosen: links become coarser one by one, from the link with the highest
    frequency, and links that hardly bend become rigid, except for those with gauges. The linear
    theory is chosen if it suffices. All runs of the study together take at most about 200 times the
    work of a run with two modes a link: no run is started that is expected to exceed this limit.

    Args:
        arm: the arm; its elements, modes, segments and theory are not used. With a controller, it
            remains the controller's model, and the simulated arm alone is refined.
        duration: s, positive.
        accuracy: largest error of the tip (m) by model and integration together; by default 1e-4 of
            the reach. Stiffness and deflections are rarely known better than that.
        initial, initial_rate: q and qd (dof,) of ``arm`` with straight links, or a function of an
            arm that returns them, such as ``lambda arm: fa.equilibrium(arm, angles).q``.
        settings: see `flexarm.RunSettings`; without ``rtol``, ``atol`` and ``step``.

    All other arguments are those of `flexarm.simulate`.

    Returns:
        The chosen arm, its run, and the table of the study, see `ConvergedRun`.

    Raises:
        InputError: if `simulate` would raise it, or the initial links are bent and ``initial`` is
            not a function.
        SimulationError: if no model can be simulated.

    Warns:
        AccuracyWarning: if no model of the study reaches the accuracy; the model is then the
            cheapest one with at most 1.25 times the error of the finest one. Also if the
            integration does not reach it.
        FlexarmWarning: all other warnings of the chosen run, as in `simulate`.
    """
    situation = situation_of(converged, arm, duration, settings, arguments)
    # The error is that of one tip, and another mesh has other closed postures.
    serial_only(situation.arm.spec, "converged", ("branches", "closures"))
    if situation.settings.accuracy is None:
        accuracy = _DEFAULT * reach_of(situation.simulated)
        vars(situation)["settings"] = replaced(situation.settings, accuracy=accuracy)
    study = _Study(situation)
    study.refine()
    chosen, accuracy = study.coarsened(), study.accuracy
    error = study.error(chosen)
    result = study.final(chosen).assign_attrs(model_error=error, accuracy=accuracy)
    reached = error + result.attrs.get("integration_error", 0.0) <= accuracy
    if not reached:
        text = (
            f"no model of the study reaches an accuracy of {accuracy:.2g} m: the error of the "
            f"model at the tip is about {error:.1g} m. {study.reason()}"
        )
        result.attrs["warning"] = " ".join(filter(None, [result.attrs["warning"], text]))
        warn_caller(text, AccuracyWarning)
    table = study.table(chosen)
    return ConvergedRun(study.arm_of(chosen), result, table, error, accuracy, bool(reached))


class _Run(NamedTuple):
    """A run of the study."""

    tip: FloatArray | None  # (samples, 2) m; None if it failed
    frequency: float  # the highest, Hz
    coordinates: int = 0
    bending_error: float = 0.0  # estimated error of the tip by the theory, m
    far: bool = False  # whether a link exceeds its theory, which the final run would report
    evaluations: int = 0
    work: float = 0.0  # evaluations times coordinates, weighted by method
    seconds: float = 0.0


class _Study:
    """Runs of a situation with other meshes, each executed once."""

    def __init__(self, situation: Situation) -> None:
        self.situation, self.spec = situation, situation.simulated.spec
        self.accuracy = float(situation.settings.accuracy or 0.0)
        self.links = self.spec.links
        self.divisible = [_divisible(link) for link in self.links]
        self.divided = all(self.divisible)  # whether finer meshes converge to the exact beam
        self.runs: dict[Mesh, _Run] = {}
        self.reference, self.reference_error = Mesh(()), np.inf
        self.limited = False  # whether a finer run would have exceeded the limit of the work
        self.failures: list[FlexarmError] = []
        request = _COMPARED * self.accuracy / reach_of(situation.simulated)
        plain = {"accuracy": None, "specialized": False, "progress": False}
        settings = replaced(situation.settings, rtol=tolerance_of_request(request), **plain)
        self._settings = settings

    def uniform(self, step: int) -> Mesh:
        """Return the mesh with the same step of all flexible links."""
        steps = (max(step, self.least(k)) if x.flexible else 0 for k, x in enumerate(self.links))
        return Mesh(tuple(steps))

    def least(self, link: int) -> int:
        """Return the coarsest step of a link: one with gauges bends."""
        return 1 if self.links[link].flexible and self.links[link].gauges else 0

    def sizes(self, mesh: Mesh) -> list[tuple[int, int]]:
        """Return modes of each segment, and segments, of each link."""
        steps = zip(mesh.steps, self.divisible, strict=True)
        sizes = [(_DIVISIBLE if divisible else _ONE_PIECE)[step] for step, divisible in steps]
        if mesh.undamped > 1:
            sizes = [(2, mesh.undamped) if modes else (0, 1) for modes, _ in sizes]
        return sizes

    def arm_of(self, mesh: Mesh) -> Arm:
        """Return the arm with a mesh."""
        each = zip(self.links, self.divisible, self.sizes(mesh), strict=True)
        links = [
            _meshed(link if divisible or not mesh.undamped else link.replace(damping=None), *size)
            for link, divisible, size in each
        ]
        return Arm(self.spec.replace(links=links, theory=mesh.theory))

    def _situation(self, mesh: Mesh, settings: RunSettings) -> Situation:
        arm = self.arm_of(mesh)
        start: dict[str, Any] = {
            name: self._coordinates(name, arm)
            for name in ("initial", "initial_rate")
            if getattr(self.situation, name) is not None
        }
        controller = copy.deepcopy(self.situation.controller)  # the user's one keeps its state
        return replace(self.situation, plant=arm, settings=settings, controller=controller, **start)

    def _coordinates(self, name: str, arm: Arm) -> FloatArray:
        """Return coordinates or rates (dof,) of an arm from those of the user's arm."""
        value = getattr(self.situation, name)
        if callable(value):
            return np.asarray(call(name, value, arm), dtype=np.float64)
        simulated = self.situation.simulated
        q = check_array(name, value, (simulated.dof,))
        if np.any(np.delete(q, simulated.joint_index)):
            rule = "describe straight links, or be a function of an arm"
            hint = "For example: initial=lambda arm: fa.equilibrium(arm, angles).q."
            raise InputError(Problem(name, rule, "bent links", hint))
        return arm.rest(simulated.joint_angles(q))

    @property
    def candidates(self) -> list[Mesh]:
        """Meshes of the study that may be chosen."""
        return [mesh for mesh in self.runs if not mesh.undamped]

    def run(self, mesh: Mesh) -> _Run:
        """Return the run of a mesh."""
        if mesh not in self.runs:
            self.runs[mesh] = self._executed(mesh)
        return self.runs[mesh]

    def _executed(self, mesh: Mesh) -> _Run:
        frequency = np.nan
        try:
            situation = self._situation(mesh, self._settings)
            frequency = _frequency(situation)
            with without_warnings(Warning):
                result = simulated(situation)
        except FunctionError:
            raise
        except FlexarmError as error:
            self.failures.append(error)
            if self.runs and all(run.tip is None for run in self.runs.values()):
                raise self.failures[0] from None
            return _Run(None, frequency)
        arm = situation.simulated
        states = arm.padded(np.stack([result.q.values, result.qd.values], axis=-2))
        errors = BendingErrors(arm)
        bending = float(errors.of_links(states)[1].max(initial=0.0))
        far = errors.too_large(states) is not None
        evaluations, seconds = (result.attrs[name] for name in ("evaluations", "wall_seconds"))
        implicit = result.attrs["integrator"] == KennedyCarpenter5.name
        work = evaluations * arm.dof * (_IMPLICIT if implicit else 1.0)
        tip = result.tip.values[:, :2]
        return _Run(tip, frequency, arm.dof, bending, far, evaluations, work, seconds)

    def final(self, mesh: Mesh) -> xr.Dataset:
        """Return the run of the chosen mesh, whose integration error is verified."""
        settings = replaced(self.situation.settings, accuracy=_INTEGRATION * self.accuracy)
        return simulated(self._situation(mesh, settings))

    def apart(self, one: Mesh, other: Mesh) -> float:
        """Return the largest distance (m) of the tips of two runs; infinite if one failed."""
        tips = [self.run(mesh).tip for mesh in (one, other)]
        if tips[0] is None or tips[1] is None:
            return np.inf
        count = min(len(tips[0]), len(tips[1]))  # an event may end one of them earlier
        return float(np.linalg.norm(tips[0][:count] - tips[1][:count], axis=1).max(initial=0.0))

    def error(self, mesh: Mesh) -> float:
        """Return the estimated error (m) of a mesh; infinite if its run failed."""
        return self.apart(mesh, self.reference) + self.reference_error

    def is_accurate(self, mesh: Mesh) -> bool:
        """Return whether the error leaves room for the integration, or cannot be much smaller."""
        accepted = max((1.0 - _INTEGRATION) * self.accuracy, _ENOUGH * self.reference_error)
        return self.error(mesh) <= accepted

    def _has_room(self, work: float) -> bool:
        """Return whether the limit of the study's work permits a run; True before a plain run."""
        plain = self.runs.get(self.uniform(_PLAIN))
        if plain is None or plain.tip is None:
            return True
        return self.work + work <= _LIMIT * plain.work

    @property
    def work(self) -> float:
        """Work of all runs."""
        return sum(run.work for run in self.runs.values())

    def _expected(self, mesh: Mesh) -> float:
        """Return the expected work of a finer mesh, from the last two runs and its frequency."""
        done = [run for run in self.runs.values() if run.tip is not None and run.frequency > 0.0]
        if not done:
            return 0.0
        situation = self._situation(mesh, self._settings)
        frequency = _frequency(situation)
        if mesh.undamped:  # vibrations that damping ends may have to be followed
            evaluations = explicit_work(2.0 * np.pi * frequency, situation.duration)
            return evaluations * situation.simulated.dof
        faster = frequency / done[-1].frequency
        power = 1.0
        if len(done) > 1 and done[-1].frequency > done[-2].frequency:
            more = done[-1].evaluations / max(done[-2].evaluations, 1)
            power = np.log(more) / np.log(done[-1].frequency / done[-2].frequency)
        larger = situation.simulated.dof / done[-1].coordinates
        return float(done[-1].work * larger * faster ** np.clip(power, 0.0, 1.0))

    def refine(self) -> None:
        """Refine all links until the tip converges; set the reference and its error (m)."""
        meshes = [*dict.fromkeys(self.uniform(step) for step in range(len(_DIVISIBLE)))]
        self.run(meshes[0])
        self.reference, self.reference_error = meshes[0], 0.0 if len(meshes) == 1 else np.inf
        before = np.inf
        for mesh in meshes[1:]:
            if not self._has_room(self._expected(mesh)):
                self.limited = True
                break
            apart, run = self.apart(self.reference, mesh), self.run(mesh)
            if run.tip is None:
                continue
            segments = self.divided and max(count for _, count in self.sizes(mesh)) > 1
            most = _TAIL_OF_SEGMENTS if segments else _TAIL_OF_MODES
            tail = apart / (before - apart) if apart < before else np.inf
            error = apart * min(max(tail, _LEAST_TAIL), most)
            hopeless = not self.divided and run.bending_error > _WORTH * self.accuracy
            wanted = run.bending_error if hopeless else self.accuracy
            small = apart <= _LAST * wanted and before <= _BEFORE * wanted
            self.reference, self.reference_error, before = mesh, error, apart
            confirmed = segments or not self.divided or run.bending_error <= _UNBENT * self.accuracy
            if small and error <= _REFERENCE * wanted and confirmed:
                break
        if not self.divided:
            self.reference_error += self._bending_error()

    def _bending_error(self) -> float:
        """Return the error (m) of a reference whose damping does not permit segments.

        Without damping, which matters little for it, it is the difference from segments.
        """
        estimate = self.run(self.reference).bending_error
        piece, divided = (self.reference._replace(undamped=count) for count in (1, _UNDAMPED))
        # Modes that converge only at the finest step vibrate for the whole run without damping.
        slow = max(self.reference.steps) == len(_ONE_PIECE) - 1
        worth = not slow and _UNBENT < estimate / self.accuracy <= _WORTH
        if worth and self._has_room(self._expected(piece)):
            self.run(piece)
            if self._has_room(self._expected(divided)):
                apart = self.apart(piece, divided)
                return apart if np.isfinite(apart) else estimate
        return estimate

    def coarsened(self) -> Mesh:
        """Return the cheapest accurate mesh, after making its links coarser one by one."""
        mesh = next(filter(self.is_accurate, self.candidates), self.reference)
        highest = np.zeros(len(self.links))
        for piece in self.arm_of(mesh).assembly.pieces:
            highest[piece.link] = max(highest[piece.link], piece.shapes.w2.max(initial=0.0))
        for link in np.argsort(-highest, kind="stable").tolist():
            if not mesh.steps[link]:  # rigid
                continue
            low, high = self.least(link), mesh.steps[link]
            while low < high and self._has_room(self.run(mesh).work):
                steps = list(mesh.steps)
                steps[link] = (low + high) // 2
                coarser = mesh._replace(steps=tuple(steps))
                if self.is_accurate(coarser):
                    mesh, high = coarser, steps[link]
                else:
                    low = steps[link] + 1
        if any(mesh.steps) and self._has_room(self.run(mesh).work):
            self.run(mesh._replace(theory="linear"))
        runs = {mesh: self.run(mesh) for mesh in filter(self.is_accurate, self.candidates)}
        order = {mesh: (run.far, run.work, mesh.theory) for mesh, run in runs.items()}
        return min(order, key=order.__getitem__, default=mesh)

    def reason(self) -> str:
        """Return why the study ended, and what the user can do."""
        if not np.isfinite(self.reference_error):
            return f"Finer models fail: {self.failures[-1]}"
        bent = self.run(self.reference).bending_error
        if not self.divided and bent > _REFERENCE * self.accuracy:
            return (
                "Links bend far, and their modal damping or mass_coefficient does not permit "
                "segments; Rayleigh damping with stiffness_coefficient alone does."
            )
        why = "Errors may grow in this motion"
        if self.limited:
            why = "Finer models would exceed the work of the study"
        return (
            f"{why}: use a larger accuracy, a shorter duration, damping of the links, or "
            "hub_inertia at joints that have none."
        )

    def table(self, chosen: Mesh) -> xr.Dataset:
        """Return the table of all runs, see `ConvergedRun`."""
        meshes = self.candidates
        runs, sizes = [self.run(mesh) for mesh in meshes], np.array([*map(self.sizes, meshes)])
        elements = [[_elements(*size) for size in self.sizes(mesh)] for mesh in meshes]
        error = np.array([self.error(mesh) for mesh in meshes])
        each, single = ("candidate", "link"), "candidate"
        variables: dict[str, Any] = {
            "elements": (each, elements),
            "modes": (each, sizes[:, :, 0]),
            "segments": (each, sizes[:, :, 1]),
            "theory": (single, [mesh.theory for mesh in meshes]),
            "highest_frequency": (single, [run.frequency for run in runs], {"units": "Hz"}),
            "model_error": (single, np.where(np.isfinite(error), error, np.nan), {"units": "m"}),
            "evaluations": (single, [run.evaluations for run in runs]),
            "seconds": (single, [run.seconds for run in runs], {"units": "s"}),
            "chosen": (single, [mesh == chosen for mesh in meshes]),
        }
        links = {"link": np.arange(1, len(self.links) + 1)}
        return xr.Dataset(variables, links, {"accuracy": self.accuracy, "work": self.work})


def _frequency(situation: Situation) -> float:
    """Return the highest frequency (Hz) at the start of a run."""
    return fastest_frequency(situation.simulated, situation.start) / (2.0 * np.pi)


def _divisible(link: Link) -> bool:
    """Return whether the damping of a link permits segments."""
    damping = link.damping if link.flexible else None
    return damping is None or (damping.kind == "rayleigh" and damping.mass_coefficient == 0.0)


def _elements(modes: int, segments: int) -> int:
    """Return the elements of a link with a number of modes of each segment."""
    least = max(_ELEMENTS // segments, _OF_SEGMENT)
    return min(segments * max(least, modes), MOST_ELEMENTS) if modes else 1


def _meshed(link: Link, modes: int, segments: int) -> Link:
    """Return a link with modes of each segment; 0 makes it rigid."""
    if not modes:
        rigid = {"flexible": False, "elements": 1, "segments": 1, "modes": None, "damping": None}
        return link.replace(**rigid)
    damping = link.damping
    if damping is not None and damping.kind == "modal":
        damping = damping.replace(ratio=damping.ratios(modes))
    sizes = {"elements": _elements(modes, segments), "segments": segments, "modes": modes}
    return link.replace(**sizes, damping=damping)
