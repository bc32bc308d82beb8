"""Recorded run of an arm: arguments of the exported functions and the results of Python."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from types import SimpleNamespace
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import without_warnings
from flexarm.bridges.c_code.observer import Observer
from flexarm.bridges.c_code.source import Exported, array, origin
from flexarm.bridges.c_code.stress import recorded_damage
from flexarm.bridges.c_code.traced_law import (
    TracedController,
    exports_plan,
    gain_table,
    plan_over,
    refusal,
)
from flexarm.control.contract.base import Arrays, around
from flexarm.control.filters.kalman_filter import ExtendedKalmanFilter
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import Measurement
from flexarm.linear.step_derivatives.sampled_step import SampledStep, step_jacobian
from flexarm.motion import joint_motion
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.real_time.partners import HEAD, OTHER_TIME, REFERENCE, TOKEN_BITS, Layout

#: Number of recorded samples, and number of steps of the run between two of them.
SAMPLES, _STRIDE = 32, 8
#: Steps are this fraction of the largest one, and at most this long (s).
_FRACTION, _LONGEST = 0.2, 1e-3
#: Relative deviation that rounding explains; on an ill-conditioned arm, also this multiple of
#: the condition number times the relative precision.
_ROUNDING, _CONDITION = 1e-12, 2.0
#: Rounding errors within a controller, in multiples of those of its readings.
_AMPLIFIED = 8.0
#: Number of runs of a filter with rounded inputs; single ones differ by a factor of four.
_ROUNDED_RUNS = 4
#: Initial joint angles and rates of the run of a filter, and torques in rad/s^2 of a straight arm.
_ANGLE, _RATE, _TORQUE = 0.4, 1.0, 3.0
#: Angle (rad) by which the joints of the reference turn.
_TURN = 0.1
#: Mean speed (rad/s) of the reference through a grid of postures.
_SPEED = 1.0
#: Strain of a reference that computes its own bending.
_STRAIN = 1e-3
#: Samples (first, end) without a contact force: at the start, within a contact, after the lift-off.
_NO_CONTACT = ((0, 3), (10, 12), (23, 25))
#: Samples whose reference has no force, and no surface. Afterwards the normal is vertical.
_NO_FORCE, _FREE = (20, 23), (25, 27)
#: Directions of the contact force and of the normal of the surface.
_FORCE, _NORMAL = np.array([0.8, 0.6]), np.array([0.6, 0.8])
#: Rotation of a row by a right angle.
_QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
#: Pressing torque (N m), and coefficients of friction.
_PRESSING, _FRICTION, _ROUGHER = 0.05, 0.1, 0.2
#: Joint angle (rad) by which the motion for more friction differs, relative to the other.
_BENT = 1.05
#: Largest speed relative to the nominal one.
_FAST = 1.5


@dataclass(frozen=True, eq=False)
class Recording:
    """Recorded run."""

    step: float  # s, of the run
    inputs: dict[str, FloatArray]  # (samples, size) by the name of the argument
    #: (samples, size) by the name of the function, all its results in one row.
    expected: dict[str, FloatArray]
    tolerance: dict[str, FloatArray]  # (size,) by the name of the function


def record(export: Exported) -> Recording:
    """Simulate an arm under smooth torques, and evaluate its methods along the run."""
    arm = _smoothed(export.arm)
    step = min(_LONGEST, _FRACTION * export.largest_step)
    count = SAMPLES * _STRIDE
    # Torques (count, joints) that accelerate the joints by some rad/s^2.
    M = arm.mass_matrix(np.zeros(arm.dof))[arm.joint_index, arm.joint_index]
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None] * np.arange(1, arm.n_joints + 1)
    torque = 3.0 * M * np.sin(phase)
    with without_warnings():
        # The run only compares two programs: it may leave the validity of the theory.
        run = simulate(
            arm,
            count * step,
            torque=torque,
            rate=1.0 / step,
            torque_interpolation="hold",
            integrator="rk4",
            step=step,
        )
    at = np.arange(SAMPLES) * _STRIDE
    q, qd = run.q.values, run.qd.values
    push = 0.1 * np.sin(np.arange(SAMPLES)[:, None] + np.arange(3.0))
    recording = Recording(
        step, {"q": q[at], "qd": qd[at], "torque": torque[at], "tip_force": push}, {}, {}
    )
    _record_arm(recording, export)
    if export.controller:
        readings = {
            "joint_angle": run.joint_angle.values[at],
            "joint_rate": run.joint_rate.values[at],
            "strain": run.strain.values[at] if arm.gauges else np.zeros((SAMPLES, 0)),
            "tip": np.array([arm.tip(one)[:2] for one in q[at]]),
            "contact_force": contact_readings(export.controller.controller, SAMPLES),
        }
        _record_controller(recording, export, readings)
    if export.observer:
        # The filter has a run of its own, at its sample time.
        inputs, expected = record_observer(export.observer, SAMPLES)
        recording.inputs.update(inputs)
        recording.expected["observer"] = expected
        rounded = [_rounded(inputs, seed) for seed in range(_ROUNDED_RUNS)]
        changes = [np.abs(estimates(export.observer.filter, one) - expected) for one in rounded]
        change, largest = np.max(changes, axis=(0, 1)), np.abs(expected).max(axis=0)
        recording.tolerance["observer"] = np.maximum(_ROUNDING * largest, _AMPLIFIED * change)
    return recording


def _smoothed(arm: Arm) -> Arm:
    """Return an arm whose friction is a function of the rate, as in the exported functions."""
    joints = []
    for joint in arm.spec.joints:
        if joint.friction is not None:
            rate = joint.friction.model_rate
            plain = {"bristle_stiffness": None, "bristle_damping": 0.0, "smoothing_rate": rate}
            joint = joint.replace(friction=joint.friction.replace(**plain))
        joints.append(joint)
    return Arm(arm.spec.replace(joints=joints))


def _record_arm(data: Recording, export: Exported) -> None:
    arm, given = export.arm, data.inputs
    q, qd, torque, push = (given[name] for name in ("q", "qd", "torque", "tip_force"))
    qdd = np.array([arm.forward_dynamics(*one) for one in zip(q, qd, torque, push, strict=True)])
    # Half of the accelerations, because all of them would cancel the other forces.
    given["qdd"] = 0.5 * qdd
    steps = [step_jacobian(arm, q[k], qd[k], torque[k], data.step) for k in range(SAMPLES)]
    results: dict[str, Callable[[int], Any]] = {
        "forward_dynamics": lambda k: qdd[k],
        "inverse_dynamics": lambda k: arm.inverse_dynamics(q[k], qd[k], given["qdd"][k], push[k]),
        "bias_force": lambda k: arm.bias_force(q[k], qd[k]),
        "mass_matrix": lambda k: arm.mass_matrix(q[k]),
        "energy": lambda k: arm.energy(q[k], qd[k])[:3],
        "tip": lambda k: arm.tip(q[k]),
        "tip_velocity": lambda k: arm.tip_velocity(q[k], qd[k]),
        "strain": lambda k: arm.strain(q[k]),
        "tip_jacobian": lambda k: np.transpose(
            [arm.tip_velocity(q[k], e) for e in np.eye(arm.dof)]
        ),
        "step": lambda k: np.concatenate([steps[k].q, steps[k].qd]),
        "stress": lambda k: _stress(export, q[k], qd[k], torque[k]),
    }
    for function in export.functions:
        if function.name in results:
            rows = [np.ravel(results[function.name](k)) for k in range(SAMPLES)]
            data.expected[function.name] = np.array(rows)
            values = np.abs(np.array(rows))
            data.tolerance[function.name] = _ROUNDING * np.full(
                values.shape[1], values.max(initial=0.0)
            )
    rows = [np.concatenate([step.state.ravel(), step.torque.ravel()]) for step in steps]
    data.expected["step_jacobian"] = np.array(rows)
    _scale_by_energy(data, arm)
    if export.points and export.points.detail_category is not None:
        data.inputs["cycles"], damage = recorded_damage(export.points, SAMPLES)
        data.expected["damage"] = damage
        data.tolerance["damage"] = _ROUNDING * damage.max(axis=0)


def _stress(export: Exported, q: FloatArray, qd: FloatArray, torque: FloatArray) -> FloatArray:
    """Return the stress at the points of an export, Pa."""
    assert export.points is not None
    qdd = export.arm.forward_dynamics(q, qd, torque)
    return export.points.of_forces(export.arm.section_forces(q, qd, qdd, export.points.stations))


def _scale_by_energy(data: Recording, arm: Arm) -> None:
    """Set the tolerances of coordinates as if they were energies."""
    # Metres and radians then count alike, and so do errors of an ill-conditioned mass matrix.
    M = arm.mass_matrix(data.inputs["q"][0])
    scale = np.sqrt(np.diag(M))
    condition = np.linalg.cond(M / np.outer(scale, scale))
    limit = max(_ROUNDING, _CONDITION * np.finfo(float).eps * condition)
    n, m = arm.dof, arm.n_joints
    both = np.concatenate([scale, scale])
    data.tolerance["forward_dynamics"] = (
        limit * np.abs(scale * data.expected["forward_dynamics"]).max() / scale
    )
    after = np.abs(both * data.expected["step"])
    parts = [np.full(n, after[:, :n].max()), np.full(n, after[:, n:].max())]
    data.tolerance["step"] = limit * np.concatenate(parts) / both
    slopes = np.abs(data.expected["step_jacobian"])
    weight = np.concatenate([np.outer(both, 1.0 / both).ravel(), np.repeat(both, m)])
    block = np.concatenate(
        [
            (2 * np.repeat([0, 1], n)[:, None] + np.repeat([0, 1], n)).ravel(),
            np.repeat([4, 5], n * m),
        ]
    )
    largest = [np.max((weight * slopes)[:, block == k], initial=0.0) for k in range(6)]
    data.tolerance["step_jacobian"] = limit * np.array(largest)[block] / weight


def _record_controller(data: Recording, export: Exported, readings: dict[str, FloatArray]) -> None:
    """Record the torques of the controller for the readings of the run."""
    assert export.controller is not None
    inputs, torque = replay(export.arm, export.controller, readings)
    data.inputs.update(inputs)
    data.expected["controller"] = torque
    # Large gains of a filter amplify the rounding of its readings. Measure how much.
    change = np.abs(replay(export.arm, export.controller, _rounded(readings, 0))[1] - torque)
    limit = max(_ROUNDING * np.abs(torque).max(), _AMPLIFIED * change.max())
    data.tolerance["controller"] = np.full(torque.shape[1], limit)


def _rounded(values: dict[str, FloatArray], seed: int) -> dict[str, FloatArray]:
    """Return numbers with a random rounding error each."""
    signs = np.random.default_rng(seed)
    return {
        name: one * (1.0 + np.finfo(float).eps * signs.choice([-1.0, 1.0], one.shape))
        for name, one in values.items()
    }


def record_observer(observer: Observer, samples: int) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return the inputs (samples, size) of the filter by name, and its estimates, in rows."""
    with without_warnings():
        # The run only compares two programs: it may leave the validity of the theory.
        inputs = _readings(observer.filter, samples)
        return inputs, estimates(observer.filter, inputs)


def estimates(of: ExtendedKalmanFilter, inputs: dict[str, FloatArray]) -> FloatArray:
    """Return q, qd, payload and innovation (samples, 2 dof + 2) of a filter from its start."""
    counts = PredictedReadings(of.arm, of.instruments).counts
    columns = np.split(inputs["readings"], np.cumsum(counts)[:-1], axis=1)
    readings = {one.label: values for one, values in zip(of.instruments, columns, strict=True)}
    # The torque after the last sample has no effect.
    found = deepcopy(of).run(np.roll(inputs["last_torque"], -1, axis=0), readings)
    return np.column_stack([found.q, found.qd, found.payload_mass, found.innovation])


def _readings(of: ExtendedKalmanFilter, samples: int) -> dict[str, FloatArray]:
    """Move the arm of the filter under smooth torques; return readings with noise, and torques."""
    arm, random = of.arm, np.random.default_rng(0)
    shown, step = PredictedReadings(arm, of.instruments), SampledStep(arm, of.sample_time)
    M = arm.mass_matrix(np.zeros(arm.dof))[arm.joint_index, arm.joint_index]
    x = np.zeros(2 * arm.dof)
    x[arm.joint_index], x[arm.dof + arm.joint_index] = _ANGLE, _RATE
    torque, rows, torques = np.zeros(arm.n_joints), [], []
    for k in range(samples):
        noise = np.sqrt(shown.variance) * random.standard_normal(shown.size)
        rows.append(shown.values(x, torque, step.free.at()) + noise)
        torques.append(torque)
        phase = 2.0 * np.pi * k / samples * np.arange(1, arm.n_joints + 1)
        torque = _TORQUE * M * np.sin(phase)
        x = step.advance(x, torque)
    return {"readings": np.array(rows), "last_torque": np.array(torques)}


def replay(
    arm: Arm, traced: TracedController, readings: dict[str, FloatArray]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Return inputs (samples, size) by name and torques (samples, joints) of recorded readings.

    The motion passes the grid of postures of a controller with a schedule, and the recorded angles
    are moved with it. InputError if the step depends on attributes that it changes.
    """
    law: Any = deepcopy(traced.controller)
    law.reset()
    h, count = traced.sample_time, len(readings["joint_angle"])
    times = h * np.arange(count, dtype=np.float64)
    start = readings["joint_angle"][0]
    table = gain_table(law)
    reference: Any = joint_motion(arm, start, start + _TURN, count * h)
    columns = dict(readings)
    if table:
        reference = _slow_run(arm, table.ends, count * h)
        columns["joint_angle"] = readings["joint_angle"] - start + reference.joint_angle(times)
    motion = [getattr(reference, name)(times) for name in REFERENCE.values()]
    columns |= dict(zip(REFERENCE, motion, strict=True))
    planning = next(filter(exports_plan, around(law)), None)
    if planning is not None:
        columns |= _pressed(arm, motion, planning, times)
    rows, torques = [], []
    after: Arrays = {}
    for k, t in enumerate(times.tolist()):
        row = {name: values[k] for name, values in columns.items()}
        given = Measurement(**{name: row[name] for name in readings})
        planned = plan_over(law, arm, lambda name, *size, row=row: row[name].reshape(size), t)
        if planned is None:
            planned = law.planned(t, reference)
            row |= {name: np.array(value, dtype=np.float64) for name, value in planned.items()}
        before = after if k else law.initial_memory(given, planned)
        after, torque = law.step(before, given, planned)
        torques.append(np.array(torque, dtype=np.float64))
        rows.append(row)
    other: Any = deepcopy(traced.controller)  # has made no step
    other.reset()
    if not np.array_equal(other.step(before, given, planned)[1], torques[-1]):
        raise refusal(law, "Its step changes attributes of the controller.")
    inputs = {name: np.array([np.ravel(row[name]) for row in rows]) for name in rows[0]}
    return inputs, np.array(torques)


def _slow_run(arm: Arm, ends: FloatArray, duration: float) -> Any:
    """Return a reference that passes a grid of postures, with the torques of a slow motion.

    ``ends`` (2, joints) rad are the first and the last posture; the ``duration`` (s) includes both.
    """
    first, last = ends[0] - _TURN, ends[1] + _TURN
    motion = joint_motion(arm, first, last, np.max(last - first) / _SPEED)
    ratio, names = motion.duration / duration, REFERENCE.values()
    methods = {name: lambda t, name=name: getattr(motion, name)(ratio * t) for name in names}
    return SimpleNamespace(vectorized=True, end_time=duration, **methods)


def contact_readings(controller: object, count: int) -> FloatArray:
    """Return contact forces (count, 1, 2) N of a tip that touches and leaves a surface."""
    size = getattr(controller, "nominal_force", 1.0) * (1.0 + 0.3 * np.sin(np.arange(count)))
    for interval in _NO_CONTACT:
        size[slice(*interval)] = 0.0
    return np.outer(size, _FORCE)[:, None]


def _pressed(
    arm: Arm, motion: list[FloatArray], controller: Any, times: FloatArray
) -> dict[str, FloatArray]:
    """Return inputs (T, size) of a controller that plans along a motion with and without a force.

    Nominal force and speed of the controller are exceeded. ``motion``: angles, rates and
    accelerations of the joints (T, joints).
    """
    h, count = float(controller.sample_time), len(times)
    turn = 2.0 * np.pi / (count * h)
    ones, wave = np.ones((count, 1)), np.sin(turn * times)[:, None]
    force = getattr(controller, "nominal_force", 1.0) * (1.0 + 0.5 * wave)
    force[slice(*_NO_FORCE)] = 0.0
    normal = np.tile(_NORMAL, (count, 1))
    normal[_FREE[1] :] = 0.0, 1.0
    normal[slice(*_FREE)] = 0.0
    reach, tangent = _FAST * getattr(controller, "nominal_speed", 0.1) / turn, _NORMAL @ _QUARTER
    speed = reach * turn * np.cos(turn * times)[:, None]
    inputs = {
        "reference_force": force,
        "reference_normal": normal,
        "reference_force_rate": np.gradient(force, h, axis=0),
        "path_position": reach * wave * tangent,
        "path_speed": speed * (normal @ _NORMAL)[:, None],
        "strain_correction": _STRAIN * np.sin(turn * times[:, None] + np.arange(len(arm.gauges))),
        "feedforward": _PRESSING * wave * np.ones(arm.n_joints),
    }
    for prefix, bent, friction in (("reference", 1.0, _FRICTION), ("rougher", _BENT, _ROUGHER)):
        names = (f"{prefix}_{name}" for name in ("angle", "rate", "acceleration"))
        inputs |= {name: bent * values for name, values in zip(names, motion, strict=True)}
        inputs[f"{prefix}_pressing"] = _PRESSING * bent * ones * np.ones(arm.n_joints)
        inputs[f"{prefix}_friction"] = friction * ones
    return inputs


def _text(file: str) -> str:
    """Return the part of a program that is the same for all arms."""
    return (files("flexarm.bridges.c_code") / "c" / file).read_text(encoding="utf-8")


def makefile(export: Exported, udp: bool) -> str:
    """Return the makefile, with or without a target for the program over UDP."""
    title = "make test: compare with the recorded run; make times, make size: measure."
    head = f"# Generated by flexarm. {title}\nNAME = {export.name}\n"
    return head + _text("Makefile") + (_text("udp.mk") if udp else "")


def recorded_arrays(export: Exported, recording: Recording) -> str:
    """Return the header with the recorded run."""
    guard = export.macro("RECORDING_H")
    title = f"recorded run of {SAMPLES} samples, computed in Python"
    parts = [origin(f"{export.name}_recording.h", title) + " */"]
    parts += [f"#ifndef {guard}", f"#define {guard}", ""]
    used = {name for function in export.all_functions for name in function.inputs} | {"cycles"}
    for name, values in recording.inputs.items():
        if name in used and values.size:
            parts.append(array(f"static const double recorded_{name}", values))
    for name, values in recording.expected.items():
        parts.append(array(f"static const double {name}_expected", values))
        parts.append(array(f"static const double {name}_tolerance", recording.tolerance[name]))
    return "\n".join([*parts, "#endif", ""])


def program(export: Exported, recording: Recording) -> str:
    """Return the test program."""
    calls, rows = [], []
    for name in recording.expected:
        calls.append(_call(export, name, recording.step))
        size = recording.expected[name].shape[1]
        rows.append(f'    {{"{name}", call_{name}, {name}_expected[0], {name}_tolerance, {size}}}')
    kept = dict.fromkeys(one.memory for one in export.all_functions if one.memory)
    if "damage" in recording.expected:
        kept["damage_memory"] = None
    memory = [f"static double {name}[{export.macro(name)}];\n" for name in kept]
    filled = Template(_text("test_head.c")).substitute(
        name=export.name,
        samples=SAMPLES,
        most=max(values.shape[1] for values in recording.expected.values()),
        memory="".join(memory),
        calls="\n".join(calls),
        rows=",\n".join(rows),
    )
    return (
        origin(f"{export.name}_test.c", "comparison with a recorded run")
        + " */\n"
        + filled
        + _text("test_program.c")
    )


def _call(export: Exported, test: str, step: float) -> str:
    """Return a function that calls an exported one with the arguments of sample k."""
    if test == "damage":
        return Template(_text("test_damage.c")).substitute(name=export.name)
    parts = {"controller": export.controller, "observer": export.observer}
    program = parts.get(test)
    functions = program.functions if program else [f for f in export.functions if f.name == test]
    expressions = {"parameters": "NULL", "step": repr(step)}
    if test.startswith("step"):  # steps are recorded without a force
        expressions["tip_force"] = "NULL"
    start = 0
    for name in functions[-1].function.name_out():
        if name.endswith("memory_out"):
            expressions[name.removesuffix("_out")] = name.removesuffix("_out")
            continue
        expressions[name] = f"found + {start}" if start else "found"
        start += functions[-1].function.numel_out(name)
    lines = export.sampled_call(
        functions, "k == 0", lambda name: expressions.get(name, f"recorded_{name}[k]")
    )
    body = "\n".join(f"    {line}" for line in lines)
    return f"static void call_{test}(int k)\n{{\n{body}\n}}\n"


def packet_layout(export: Exported) -> Layout | None:
    """Return the layout of the packets of the plant; None if they lack an input of the controller.

    They contain the readings of exact sensors and, if the controller follows a reference, its
    values.
    """
    assert export.controller is not None
    joints, gauges = export.arm.n_joints, len(export.arm.gauges)
    sizes = {"joint_angle": joints, "joint_rate": joints}
    if gauges:
        sizes["strain"] = gauges
    needed = {name for function in export.controller.functions for name in function.inputs}
    if needed & REFERENCE.keys():
        sizes |= dict.fromkeys(REFERENCE, joints)
    if needed - sizes.keys() - export.controller.defaults.keys() - {"memory"}:
        return None
    return Layout({name: (size,) for name, size in sizes.items()})


def udp_program(export: Exported, layout: Layout) -> str:
    """Return the program for a layout of the packets of the plant."""
    assert export.controller is not None
    places, first = {"memory": "memory", "torque": "torque"}, 0
    for name, (size,) in layout.shapes.items():
        places[name] = f"values + {first}" if first else "values"
        first += size
    functions, memory = export.controller.functions, ""
    body = export.sampled_call(functions, "!started", lambda name: places.get(name, "NULL"))
    if len(functions) > 1:
        memory = f"\nstatic double memory[{export.macro('MEMORY')}];\n"
        body = ["static int started = 0;", *body, "started = 1;"]
    title = "controller over UDP, for POSIX systems"
    rules = f" *\n * Packets of the plant are little-endian doubles:\n * {layout}.\n"
    rules += " * Answers are token, sequence number, time, torques. The number -1 ends the run.\n"
    rules += " * A packet with the number -2 requests a run. In its answer, a token that is drawn\n"
    rules += " * here stands for the time; packets with another token are ignored.\n */\n"
    macros = {
        "HEAD": f"{HEAD} /* Token, sequence number, time. */",
        "TOKEN_BYTES": TOKEN_BITS // 8,
        "VALUES": first,
        "JOINTS": export.macro("JOINTS"),
        "SAMPLE_TIME": export.macro("SAMPLE_TIME"),
        "OTHER_TIME": OTHER_TIME,
        "LAYOUT": f'"{layout}"',
    }
    lines = ["#define _POSIX_C_SOURCE 200112L", "#include <stddef.h>"]
    lines += [f'#include "{export.name}.h"\n', *(f"#define {k} {v}" for k, v in macros.items())]
    lines += [memory, "/* Torques for the values of a packet. */"]
    lines += ["static void update(const double *values, double *torque)", "{"]
    lines += [*(f"    {line}" for line in body), "}\n", _text("udp_program.c")]
    return origin(f"{export.name}_udp.c", title) + rules + "\n".join(lines)
