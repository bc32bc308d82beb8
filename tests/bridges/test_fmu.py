"""FMUs, validated and simulated by FMPy, against ``simulate``."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.c_code_tools import STRICT, compiler
from bridges.symbolic_cases import PARAMETERS, arguments, assert_same, changed, parametric
from bridges.test_c_controllers import LAWS, heavy
from conformance.controller_examples import EXAMPLES
from flexarm.cli.main import app

fmpy = pytest.importorskip(
    "fmpy", reason="FMPy is not installed: the FMUs were neither validated nor simulated"
)
from fmpy.validation import validate_fmu  # noqa: E402

VERSIONS = ("2.0", "3.0")
KINDS = ("CoSimulation", "ModelExchange")
#: Force and moment on the tip, N and N m.
PUSH = {"tip_force[x]": 0.3, "tip_force[y]": -0.2, "tip_moment": 0.05}


@pytest.fixture(scope="module", autouse=True)
def on_linux():
    if sys.platform != "linux":
        pytest.skip("FMUs contain binaries for Linux only: they were not simulated")
    compiler("gcc")


def damped():
    """Two links whose vibrations decay, with gravity, gauges and an elastic joint."""
    damping = fa.ModalDamping(ratio=0.05)
    gauge = fa.Gauge(station=0.1, distance=0.004)
    first = fa.Link(
        length=0.8, flexural_rigidity=200.0, mass_per_length=0.5, modes=2, damping=damping
    )
    second = fa.Link(
        length=0.6,
        flexural_rigidity=120.0,
        mass_per_length=0.4,
        modes=2,
        damping=damping,
        gauges=[gauge],
    )
    joints = [
        fa.Joint(hub_inertia=0.05, damping=0.5),
        fa.Joint(stiffness=40.0, rotor_inertia=1e-4, gear_ratio=30.0, damping=0.2),
    ]
    return fa.Arm(
        links=[first, second], joints=joints, payload=fa.Payload(mass=0.2), gravity=(0, -9.81)
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """FMU of the damped arm by version."""
    folder = tmp_path_factory.mktemp("fmu")
    named = {"parameters": ["payload.mass", "gravity[1]"], "name": "swing"}
    return {v: fa.export_fmu(damped(), folder / f"{v[0]}.fmu", fmi=v, **named) for v in VERSIONS}


def values(result, name):
    """Return a channel of a dataset as in the FMU, by the name of a variable."""
    channel, _, part = name.rstrip("]").partition("[")
    array = result[channel].values
    return array[:, {"x": 0, "y": 1}[part] if part in "xy" else int(part) - 1] if part else array


def outputs(path):
    """Return the names of the outputs of an FMU."""
    described = fmpy.read_model_description(str(path))
    return [one.name for one in described.modelVariables if one.causality == "output"]


@pytest.mark.thorough
@pytest.mark.parametrize("version", VERSIONS)
def test_validator(exported, version):
    """Schema, names, units, structure, and combinations of causality and variability."""
    assert validate_fmu(str(exported[version])) == []
    described = fmpy.read_model_description(str(exported[version]))
    assert described.fmiVersion == version
    assert described.modelExchange.modelIdentifier == "swing"
    units = {one.name: one.unit for one in described.modelVariables}
    assert units["torque[1]"] == "N m"
    assert units["tip_velocity[y]"] == "m/s"
    assert units["mode_rate[2,1]"] == "m kg^0.5/s"
    starts = {one.name: one.start for one in described.modelVariables}
    assert starts["payload.mass"] == "0.2"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", VERSIONS)
def test_run_is_that_of_simulate(exported, version, kind):
    """All outputs, with other parameters and another initial state than those of the export."""
    arm = fa.varied(damped(), payload_mass=0.5)
    q = arm.rest([0.3, -0.4])
    run = fa.simulate(
        arm, 0.5, torque=lambda t: [6.0, 2.0], rate=100.0, initial=q, tip_force=list(PUSH.values()),
        integrator="dormand_prince_8", rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    given = {"payload.mass": 0.5, "joint_angle[1]": 0.3, "joint_angle[2]": -0.4}
    given |= {"torque[1]": 6.0, "torque[2]": 2.0, **PUSH}
    names = outputs(exported[version])
    found = fmpy.simulate_fmu(
        str(exported[version]), fmi_type=kind, stop_time=0.5, step_size=0.01, output_interval=0.01,
        start_values=given, relative_tolerance=1e-9, output=names,
    )  # fmt: skip
    assert {"joint_angle[2]", "joint_rate[1]", "tip[y]", "tip_angle_rate", "strain[1]"} <= set(
        names
    )
    assert {"kinetic_energy", "strain_energy", "gravity_energy"} <= set(names)
    # Errors add up over the steps; CVODE of FMPy allows more of them than co-simulation does.
    limit = 1e-7 if kind == "CoSimulation" else 1e-4
    for name in names:
        wanted = values(run, name)
        error = np.abs(found[name] - wanted).max() / np.abs(wanted).max()
        assert error < limit, (name, error)


@pytest.mark.thorough
@pytest.mark.parametrize("version", VERSIONS)
def test_derivatives_of_an_arm_with_every_option(version, tmp_path):
    """Without an integrator: equal to rounding to the arm that has the changed parameters."""
    arm = parametric("second_order")
    path = fa.export_fmu(arm, tmp_path / "arm.fmu", fmi=version, parameters=list(PARAMETERS))
    assert validate_fmu(str(path)) == []
    numbers, other = changed(arm)
    acting = arguments(arm, 3)
    q, qd, torque, push = (acting[name] for name in ("q", "qd", "torque", "tip_force"))
    described = fmpy.read_model_description(str(path))
    states = [one.variable.derivative.name for one in described.derivatives]
    given = dict(zip(states, [*q, *qd], strict=True))
    given |= {f"torque[{n}]": value for n, value in zip(arm.joint_numbers, torque, strict=True)}
    given |= dict(zip(PUSH, push, strict=True)) | dict(zip(PARAMETERS, numbers, strict=True))
    names = [one.variable.name for one in described.derivatives]
    instance = started(path, given, "ModelExchange")
    found = read(instance, described, names)
    instance.terminate()
    instance.freeInstance()
    np.testing.assert_array_equal(found[: arm.dof], qd)
    wanted = other.forward_dynamics(q, qd, torque, push)
    assert_same("forward_dynamics", found[arm.dof :], wanted, other, q)


def started(path, given, kind):
    """Return an initialized instance of an FMU."""
    described = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path), unzipdir=str(Path(path).with_suffix("")))
    instance = fmpy.instantiate_fmu(folder, described, fmi_type=kind)
    write(instance, described, given)
    if described.fmiVersion == "2.0":
        instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    return instance


def references(described, names):
    by_name = {one.name: one.valueReference for one in described.modelVariables}
    return [by_name[name] for name in names]


def read(instance, described, names):
    get = instance.getReal if described.fmiVersion == "2.0" else instance.getFloat64
    return np.array(get(references(described, names)))


def write(instance, described, given):
    put = instance.setReal if described.fmiVersion == "2.0" else instance.setFloat64
    put(references(described, given), list(given.values()))


@pytest.mark.parametrize("version", VERSIONS)
def test_saved_states_and_rules(exported, version):
    """A repeated step gives the same numbers; parameters are fixed after the initialization."""
    path = exported[version]
    described = fmpy.read_model_description(str(path))
    instance = started(path, {"torque[1]": 5.0}, "CoSimulation")
    saved = (instance.getFMUstate if version == "2.0" else instance.getFMUState)()
    names = [*outputs(path), "time"]
    before = read(instance, described, names)
    instance.doStep(0.0, 0.01)
    after = read(instance, described, names)
    assert after[-1] == 0.01
    serialize = "serializeFMUstate" if version == "2.0" else "serializeFMUState"
    restore = "deSerializeFMUstate" if version == "2.0" else "deserializeFMUState"
    copy = getattr(instance, restore)(getattr(instance, serialize)(saved))
    (instance.setFMUstate if version == "2.0" else instance.setFMUState)(copy)
    np.testing.assert_array_equal(read(instance, described, names), before)
    instance.doStep(0.0, 0.01)
    np.testing.assert_array_equal(read(instance, described, names), after)
    for name in ("payload.mass", "joint_angle[1]", "tip[x]"):
        with pytest.raises(Exception, match=r"fmi[23]Set.* failed"):
            write(instance, described, {name: 1.0})
    write(instance, described, {"torque[1]": 0.0})
    instance.reset()
    np.testing.assert_array_equal(read(instance, described, ["time", "torque[1]"]), [0.0, 0.0])
    instance.terminate()
    instance.freeInstance()


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_functions_are_those_of_the_standard(exported, version, cc, tmp_path):
    """With the headers of the standard, a wrong declaration is an error; so are all warnings."""
    folder = fmpy.extract(str(exported[version]), unzipdir=str(tmp_path))
    headers = Path(fmpy.__file__).parent / "c-code"
    number = version[0]
    flags = f"-std=c99 -Wall -Wextra -Wpedantic -Wno-unused-parameter {STRICT} -fsyntax-only"
    for more in ([], ["-isystem", str(headers), "-include", f"fmi{number}Functions.h"]):
        command = [compiler(cc), *flags.split(), *more, f"{folder}/sources/fmi{number}.c"]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    library = next(Path(folder).glob("binaries/*/swing.so"))
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True
    ).stdout
    found = {line.split()[-1] for line in listed.splitlines()}
    declared = (headers / f"fmi{number}Functions.h").read_text()
    assert found == set(re.findall(rf"fmi{number}FullName\((fmi{number}\w+)\)", declared))


def closed_loop(name, version, kind, tmp_path):
    """Return a run of ``simulate`` and that of an FMU with a controller, at its samples."""
    arm, controller = heavy(), LAWS[name]()
    motion = fa.joint_motion(arm, [0.1, 0.0], [0.4, -0.2], 0.3)
    q, h, duration = arm.rest([0.1, 0.0]), controller.sample_time, 0.4
    path = fa.export_fmu(arm, tmp_path / "loop.fmu", fmi=version, controller=controller, initial=q)
    assert validate_fmu(str(path)) == []
    run = fa.simulate(
        arm, duration, controller=controller, reference=motion, rate=1.0 / h, rtol=1e-10
    )
    times = run.time.values
    described = fmpy.read_model_description(str(path))
    inputs = [one.name for one in described.modelVariables if one.causality == "input"]
    columns = [times]
    for one in inputs:
        what, _, number = one.partition("[")
        signal = {"reference_angle": motion.joint_angle, "reference_rate": motion.joint_rate}
        signal["reference_acceleration"] = motion.joint_acceleration
        if what in signal:
            columns.append(np.array([signal[what](t)[int(number[:-1]) - 1] for t in times]))
        elif what == "feedforward":
            ahead = np.array([controller.feedforward(t + 0.5 * h) for t in times])
            columns.append(ahead[:, int(number[:-1]) - 1])
        else:
            columns.append(np.zeros(times.size))
    table = np.array(
        list(zip(*columns, strict=True)), dtype=[(n, float) for n in ["time", *inputs]]
    )
    found = fmpy.simulate_fmu(
        str(path), fmi_type=kind, stop_time=times[-1], step_size=h, output_interval=h,
        relative_tolerance=1e-9, input=table,
        output=["joint_angle[1]", "joint_angle[2]", "tip[x]", "tip[y]", "torque[1]"],
    )  # fmt: skip
    # Model exchange records the instants of events twice.
    last = np.append(np.flatnonzero(np.diff(found["time"]) > 1e-6), len(found) - 1)
    return run, found[last]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", VERSIONS)
def test_closed_loop(version, kind, tmp_path):
    """The controller acts at its samples, in co-simulation and as time events."""
    old = tuple(map(int, fmpy.__version__.split(".")[:3])) < (0, 3, 26)
    if kind == "ModelExchange" and old:
        pytest.skip("this FMPy is older than 0.3.26, and its time events are not accurate")
    run, found = closed_loop("computed_torque", version, kind, tmp_path)
    assert len(found) == run.time.size
    limit = 1e-8 if kind == "CoSimulation" else 1e-5
    for name in ("joint_angle[1]", "joint_angle[2]", "tip[x]", "tip[y]"):
        wanted = values(run, name)
        error = np.abs(found[name] - wanted).max() / np.abs(wanted).max()
        assert error < limit, (name, error)
    # Neither has the last sample; co-simulation ends before the sample at the end of its step.
    wanted = values(run, "torque[1]")[:-1]
    torque = found["torque[1]"][1:] if kind == "CoSimulation" else found["torque[1]"][:-1]
    assert np.abs(torque - wanted).max() < 1e-4 * np.abs(wanted).max()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        "joint_pd_feedforward",
        "strain_feedback",
        "joint_pid",
        "loop_shaping_scheduled",
        "hybrid_force",
        "positive_position_feedback",
    ],
)
def test_other_controllers(name, tmp_path):
    run, found = closed_loop(name, "2.0", "CoSimulation", tmp_path)
    for channel in ("joint_angle[1]", "tip[y]"):
        wanted = values(run, channel)
        assert np.abs(found[channel] - wanted).max() < 1e-8 * np.abs(wanted).max()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["lqg", "lqg_scheduled", "lqg_tip_integral"])
def test_lqg_holds_its_posture_without_inputs(name, tmp_path):
    """Inputs for the nominal motion are at rest by default, in the posture of the design."""
    arm, controller = heavy(), LAWS[name]()
    q = arm.rest(controller.posture + 0.01)
    path = fa.export_fmu(arm, tmp_path / "lqg.fmu", controller=controller, initial=q)
    assert validate_fmu(str(path)) == []
    h, steps = controller.sample_time, 100
    found = fmpy.simulate_fmu(str(path), fmi_type="CoSimulation", stop_time=steps * h, step_size=h)
    still = fa.joint_motion(arm, controller.posture, controller.posture, steps * h)
    read = [fa.Instrument(one) for one in ("joint_angle", "strain", "tip")]
    run = fa.simulate(
        arm, steps * h, controller=controller, reference=still, initial=q, rate=1.0 / h, rtol=1e-10,
        hardware=fa.Hardware(instruments=read),
    )  # fmt: skip
    for name in ("joint_angle[1]", "joint_angle[2]", "strain[1]"):
        wanted = values(run, name)
        # A tolerance of 1e-7 per step, amplified by the gains of the filter.
        assert np.abs(found[name] - wanted).max() < 1e-5 * np.abs(wanted).max()


@pytest.mark.thorough
@pytest.mark.parametrize("version", VERSIONS)
def test_without_a_compiler_the_source_is_complete(version, tmp_path, monkeypatch):
    """The warning gives the reason, and FMPy's own build makes the binary."""
    monkeypatch.setattr("flexarm.bridges.fmu.export.shutil.which", lambda name: None)
    path = tmp_path / "source.fmu"
    with pytest.warns(fa.FlexarmWarning, match="no C compiler was found.*fmpy compile"):
        fa.export_fmu(damped(), path, fmi=version)
    monkeypatch.undo()
    assert not [name for name in zipfile.ZipFile(path).namelist() if name.startswith("binaries")]
    folder = fmpy.extract(str(path), unzipdir=str(tmp_path / "whole"))
    build = pytest.importorskip(
        "fmpy.build", reason="this FMPy is too old to build: the source FMU was not compiled"
    )
    (tmp_path / "build").mkdir()
    build.build_platform_binary(folder, tmp_path / "build")
    found = fmpy.simulate_fmu(folder, stop_time=0.01, fmi_type="CoSimulation")
    assert found["time"][-1] == 0.01


@pytest.mark.thorough
def test_equal_exports_are_equal_files(tmp_path):
    paths = [fa.export_fmu(damped().rigid(), tmp_path / f"{k}.fmu") for k in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_wrong_arguments_write_nothing(tmp_path):
    arm, path = damped(), tmp_path / "arm.fmu"
    for message, given in {
        "fmi must be": {"fmi": "1.0"},
        "name must be at most": {"name": "My arm"},
        "name must not start with fmi": {"name": "fmi2"},
        "links": {"parameters": ["links[0].length", "links[0].gauges"]},
        "initial must have shape": {"initial": [0.0]},
        "closed form": {"controller": EXAMPLES["mpc"]()},
    }.items():
        with pytest.raises(fa.InputError, match=message):
            fa.export_fmu(arm, path, **given)
    with pytest.raises(fa.InputError, match=r"end in \.fmu"):
        fa.export_fmu(arm, tmp_path / "arm.zip")
    assert not list(tmp_path.iterdir())


@pytest.mark.thorough
def test_command(tmp_path):
    """A scenario: its controller, and its initial state at the start of the motion."""
    folder = tmp_path / "my-arm"
    assert CliRunner().invoke(app, ["init", str(folder)]).exit_code == 0
    words = ["export", "fmu", str(folder / "scenario.yaml"), "--parameter", "payload.mass"]
    found = CliRunner().invoke(app, [*words, "--fmi", "3.0"])
    assert found.exit_code == 0, found.output
    assert "with the controller JointPD" in found.output
    path = folder / "scenario.fmu"
    assert validate_fmu(str(path)) == []
    described = fmpy.read_model_description(str(path))
    starts = {one.name: one.start for one in described.modelVariables}
    run = fa.read_result(folder / "result.nc") if (folder / "result.nc").exists() else None
    assert run is None or float(starts["joint_angle[1]"]) == run.joint_angle.values[0, 0]
    assert starts["reference_angle[1]"] == starts["joint_angle[1]"]
    wrong = CliRunner().invoke(app, ["export", "fmu", str(folder / "arm.yaml"), "--fmi", "1"])
    assert wrong.exit_code == 2
