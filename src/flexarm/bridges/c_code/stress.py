"""Stress in the sections of the links, and the fatigue that it causes, as functions for C.

The stress is that of the forces inside the links, which follow from the kernels over symbols. The
damage is counted sample by sample by a function that is written in C: the four-point rainflow
method needs a stack, which CasADi cannot express.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from string import Template

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.stations import check_stations, cuts_at
from flexarm.base.errors import InputError, Problem, without_warnings
from flexarm.bridges.c_code.model_functions import NamedFunction, named
from flexarm.bridges.symbolic.kernel_calls import ParametricArm, objects, plain
from flexarm.bridges.symbolic.models import CasadiModel
from flexarm.model.arm.links import Section
from flexarm.simulation.calls.stress import check_category, endurance_curve, from_largest

#: Turning points of the stress that the memory of a point holds.
TURNS = 32


@dataclass(frozen=True, eq=False)
class StressPoints:
    """Points of the links whose stress is computed: both edges of sections."""

    arm: Arm
    stations: int  # of each link
    detail_category: float | None  # Pa, of all points; None without damage

    @property
    def sections(self) -> dict[int, Section]:
        """Cross-section by the number of the link, of links that have one."""
        links = enumerate(self.arm.spec.links, start=1)
        return {k: link.section for k, link in links if link.section is not None}

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes by the names of their macros, without the prefix."""
        count = len(self.sections) * self.stations * 2
        if self.detail_category is None:
            return {"STRESSES": count}
        return {"STRESSES": count, "DAMAGE_MEMORY": count * (2 + TURNS)}

    @property
    def names(self) -> list[str]:
        """Place of each stress."""
        return [
            f"link {number}, {distance:.6g} m from its root, edge on the side of {side}y"
            for number in self.sections
            for distance in np.linspace(0.0, self.arm.spec.links[number - 1].length, self.stations)
            for side in ("-", "+")
        ]

    def of_forces(self, forces: FloatArray) -> FloatArray:
        """Return the stress (points,) of forces (links, stations, 3) inside the links, Pa."""
        stress = []
        for number, section in self.sections.items():
            axial, moment = forces[number - 1, :, 0], forces[number - 1, :, 2]
            bending = moment * (0.5 * section.depth / section.second_moment)
            stress.append(
                np.stack([axial / section.area + bending, axial / section.area - bending])
            )
        return np.ravel(np.moveaxis(np.array(stress), 1, 2))


def stress_points(
    model: CasadiModel, stations: int, detail_category: float | None, filtered: Arm | None
) -> StressPoints | None:
    """Return the points of an export, None without stations; InputError if there is no stress.

    ``filtered`` is the arm of an exported filter, whose estimates are states of the arm.
    """
    if not check_stations(stations):
        if detail_category is not None:
            hint = "Give stations=11, for instance."
            raise InputError(Problem("detail_category", "needs stations of the stress", hint=hint))
        return None
    if filtered and _shapes(filtered) != _shapes(model.arm):
        rule = "need a filter with the coordinates of the arm: its elements, modes and joints"
        hint = "Export the arm of the filter."
        raise InputError(Problem("stations", rule, hint=hint))
    for k, path in enumerate(model.parameters):
        if not path.startswith("payload."):
            rule = "be a number of the payload, if the export has stations"
            raise InputError(Problem(f"parameters[{k}]", rule, path))
    if detail_category is not None:
        check_category(detail_category)
    points = StressPoints(model.arm, stations, detail_category)
    if not points.sections:
        hint = "Describe links by their material and section, such as a fa.Tube."
        raise InputError(Problem("stations", "need a link with a section", hint=hint))
    return points


def _shapes(arm: Arm) -> list[tuple[object, ...]]:
    links = [(link.elements, link.modes, link.segments, link.flexible) for link in arm.spec.links]
    return [*links, *((joint.elastic, joint.fixed) for joint in arm.spec.joints)]


def stress_function(model: CasadiModel, points: StressPoints) -> NamedFunction:
    """Return the stress at a state under joint torques."""
    arm = model.arm
    sizes = {"q": arm.dof, "qd": arm.dof, "torque": arm.n_joints, "parameters": len(model.nominal)}
    symbols = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    q, qd, torque, parameters = (
        objects(casadi.vertsplit(symbol) if symbol.numel() else [], casadi)
        for symbol in symbols.values()
    )
    with without_warnings():  # the functions of the arm have said what friction lacks
        calls = ParametricArm(arm, model.parameters, ()).at(list(parameters))
    qdd = calls.forward_dynamics(q, qd, torque)
    forces = calls.section_forces(q, qd, qdd, cuts_at(arm, points.stations))
    stress = casadi.vertcat(*(casadi.SX(plain(value)) for value in points.of_forces(forces)))
    summary = "Normal stress, tension positive, under joint torques."
    return named("stress", summary, symbols, {"stress": stress})


def damage_texts(points: StressPoints, name: str) -> tuple[str, str]:
    """Return the declarations and the code of the damage, for the prefix ``name``."""
    assert points.detail_category is not None
    curve = endurance_curve(points.detail_category)
    values = {
        "name": name,
        "NAME": name.upper(),
        "category": f"{points.detail_category:.6g}",
        "turns": TURNS,
        "knee": repr(float(curve.Sd)),
        "cut_off": repr(float(curve.Sl)),
    }
    folder = files("flexarm.bridges.c_code") / "c"
    texts = ((folder / file).read_text(encoding="utf-8") for file in ("damage.h", "damage.c"))
    declared, code = (Template(text).substitute(values) for text in texts)
    return declared, code


def recorded_damage(points: StressPoints, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return stresses (samples, points) in Pa, and the damage of those up to each, by fatpack."""
    assert points.detail_category is not None
    count = points.sizes["STRESSES"]
    stress = np.random.default_rng(0).normal(0.0, points.detail_category, (samples, count))
    curve = endurance_curve(points.detail_category)
    damage = np.zeros_like(stress)
    for k in range(1, samples):
        damage[k] = [curve.find_miner_sum(_ranges(history)) for history in stress[: k + 1].T]
    return stress, damage


def _ranges(history: FloatArray) -> FloatArray:
    """Return the ranges of the rainflow cycles of a history that repeats, without rounding."""
    from fatpack import find_rainflow_cycles

    repeated = from_largest(history)
    slopes = np.sign(np.diff(repeated))
    cycles, _ = find_rainflow_cycles(repeated[[True, *(slopes[1:] != slopes[:-1]), True]])
    # From the largest value to the least and back.
    return np.append(np.abs(np.diff(cycles.reshape(-1, 2), axis=1)), np.ptp(history))
