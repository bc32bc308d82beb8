"""Exported controllers of the tip: the recorded run, contact runs of ``simulate``, and inputs."""

import casadi
import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.c_code_tools import Library, make
from bridges.test_c_controllers import LAWS, heavy
from flexarm.bridges.c_code.export import exported
from flexarm.bridges.c_code.recording import record
from flexarm.bridges.symbolic import symbol_array
from flexarm.bridges.symbolic.models import casadi_model
from flexarm.cli.main import app

TASKS = ["adaptive_force", "admittance", "hybrid_force", "impedance", "neural_force"]


@pytest.mark.sampled("admittance")
@pytest.mark.parametrize("name", TASKS)
def test_recorded_run_takes_both_sides_of_all_conditions(name, monkeypatch):
    """Along the run each condition of the update is true at one sample and false at another.

    The exception is that a time without contact is positive after it has increased.
    """
    merged, paths = symbol_array._merged, []
    monkeypatch.setattr(symbol_array, "_merged", lambda found: paths.append(found) or merged(found))
    export = exported(casadi_model(heavy()), "arm", LAWS[name]())
    recording = record(export)
    first, later = (one.function for one in export.controller.functions)
    conditions = [one for path, _ in paths[-1] for one in path.conditions]
    symbols = list(paths_symbols(conditions, later))
    values = casadi.Function("conditions", symbols, [casadi.vertcat(*conditions)])
    taken = np.concatenate([path.taken for path, _ in paths[-1]])
    first_of_path = np.repeat(
        np.cumsum([0, *(len(path.taken) for path, _ in paths[-1])])[:-1],
        [len(path.taken) for path, _ in paths[-1]],
    )
    sides, memory = {str(one): set() for one in conditions}, None
    for k in range(len(recording.expected["controller"])):
        given = {one: values[k] for one, values in recording.inputs.items()}
        if k:
            arguments = [memory if one == "memory" else given[one] for one in later.name_in()]
            now = np.array(values(*arguments)).ravel() != 0.0
            for j, start in enumerate(first_of_path):
                # A path reaches its condition if it takes the decisions before it.
                if (now[start:j] == taken[start:j]).all():
                    sides[str(conditions[j])].add(bool(now[j]))
        function = later if k else first
        memory, torque = function(
            *(memory if one == "memory" else given[one] for one in function.name_in())
        )
        wanted = recording.expected["controller"][k]
        np.testing.assert_allclose(np.array(torque).ravel(), wanted, rtol=1e-11, atol=1e-12)
    one_side = {one: found for one, found in sides.items() if found != {True, False}}
    assert all(one.startswith("(0<fmin((memory_") for one in one_side), one_side
    # Rounding of the readings changes no condition, and the comparison in C remains strict.
    largest = np.abs(recording.expected["controller"]).max()
    assert recording.tolerance["controller"].max() <= 1e-11 * largest


class PressingInC(fa.Controller):
    """An exported controller of the tip, with the inputs that the page describes."""

    def __init__(self, folder, names, sample_time):
        self.library, self.names, self.sample_time = Library(folder), names, sample_time

    def requirements(self, arm, reference):
        return fa.ControllerRequirements(measured=("contact_force",))

    def reset(self):
        self.memory, self.started = np.zeros(int(self.library.macros["memory"])), False

    def update(self, t, measurement, reference):
        h, rougher = self.sample_time, reference.rougher
        rate = (reference.tip(t + h) - reference.tip(t - h)) / (2.0 * h)
        normal = reference.normal(t)
        force_rate = reference.contact_force(t + h) - reference.contact_force(t - h)
        values = {
            "joint_angle": measurement.joint_angle,
            "joint_rate": measurement.joint_rate,
            "contact_force": measurement.contact_force[0],
            "reference_force": reference.contact_force(t),
            "reference_normal": normal,
            "reference_friction": reference.friction,
            "rougher_friction": rougher.friction,
            "path_position": reference.tip(t),
            "path_speed": normal[0] * rate[1] - normal[1] * rate[0],
            "reference_force_rate": force_rate / (2.0 * h),
        }
        for prefix, motion in {"reference": reference, "rougher": rougher}.items():
            values[f"{prefix}_angle"] = motion.joint_angle(t)
            values[f"{prefix}_rate"] = motion.joint_rate(t)
            values[f"{prefix}_acceleration"] = motion.joint_acceleration(t)
            values[f"{prefix}_pressing"] = motion.pressing_torque(t)
        given = [np.atleast_1d(np.array(values[name], dtype=float)) for name in self.names]
        torque = np.zeros(2)
        name = "controller_update" if self.started else "controller_start"
        self.started = True
        self.library(name, *given, self.memory, torque)
        return torque


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [fa.HybridForce, fa.AdaptiveForce, fa.Admittance, fa.NeuralForce])
def test_contact_run(kind, tmp_path):
    """The same run against a wall, whether the loop is closed by Python or by C."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "modes": 1}
    arm = fa.Arm(
        links=[fa.Link(length=1.4, **rod), fa.Link(length=1.0, **rod)],
        joints=[fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.04)],
        payload=fa.Payload(mass=0.1),
    )
    path = fa.line_motion(arm, (1.5, 0.5), (1.5, 0.6), duration=0.2)
    reference = fa.pressed_motion(arm, path, 5.0, normal=(-1.0, 0.0), friction=0.1)
    wall = fa.Contact(
        fa.Wall(point=(1.5, 0.0), normal=(-1.0, 0.0)), stiffness=1000.0, damping=5.0, friction=0.2
    )
    controller = kind(arm)
    fa.export_c(arm, tmp_path, controller=controller)
    export = exported(casadi_model(arm), "arm", controller)
    names = [name for name in export.controller.functions[-1].inputs if name != "memory"]
    runs = [
        fa.simulate(
            arm,
            0.3,
            controller=one,
            reference=reference,
            contacts=[wall],
            initial=reference.initial,
        )
        for one in (controller, PressingInC(tmp_path, names, controller.sample_time))
    ]
    for channel in ("torque", "contact_force", "tip"):
        found, wanted = (run[channel].values for run in runs)
        # Contacts amplify rounding errors of 1e-15 over 300 samples.
        limit = 1e-9 * np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=limit, err_msg=channel)


@pytest.mark.thorough
def test_scenario_with_a_pressed_motion(tmp_path):
    file = tmp_path / "wipe.yaml"
    file.write_text(
        """
flexarm: 1
arm:
  links:
    - {length: 1.4, flexural_rigidity: 105.0, mass_per_length: 0.6, modes: 1}
    - {length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.6, modes: 1}
  joints: [{hub_inertia: 0.1}, {hub_inertia: 0.04}]
motion:
  kind: pressed
  path: {kind: line, start: [1.5, 0.5], end: [1.5, 0.6], duration: 0.5}
  force: 5.0
drive: {kind: adaptive_force}
contacts:
  - {surface: {kind: wall, point: [1.5, 0.0], normal: [-1, 0]}, stiffness: 1.0e+4}
run: {duration: 0.5}
"""
    )
    out = tmp_path / "c"
    found = CliRunner().invoke(app, ["export", "c", str(file), "--out", str(out)])
    assert found.exit_code == 0, found.output
    assert "with the controller AdaptiveForce" in found.output
    # Packets of the plant contain no contact force.
    assert not (out / "arm_udp.c").exists()
    assert "udp:" not in (out / "Makefile").read_text()
    done = make(out, "test")
    assert done.returncode == 0, done.stdout + done.stderr


def paths_symbols(conditions, function):
    """Return the symbols of the inputs of a function, from expressions that depend on them."""
    found = {str(one): one for one in casadi.symvar(casadi.vertcat(*conditions))}
    for name in function.name_in():
        size = function.numel_in(name)
        names = [name] if size == 1 else [f"{name}_{k}" for k in range(size)]
        yield casadi.vertcat(*(found.get(one, casadi.SX.sym(one)) for one in names))
