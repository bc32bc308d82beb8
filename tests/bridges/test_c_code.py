"""Exported C code, compiled with all warnings as errors, against the methods of the arm."""

import re
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.c_code_tools import Library, compiler, make
from bridges.symbolic_cases import PARAMETERS, arguments, assert_same, changed, parametric
from conformance.controller_examples import two_links
from flexarm.cli.main import app
from random_options import busy

#: Functions of the C library that the code may call.
MATHEMATICS = {"sin", "cos", "tan", "tanh", "exp", "sqrt", "fabs", "fmin", "fmax", "pow"}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Folder of an arm with parameters of every kind."""
    folder = tmp_path_factory.mktemp("exported")
    fa.export_c(parametric("second_order"), folder, parameters=list(PARAMETERS))
    return folder


def assert_recorded_run_is_equal(folder, cc, level="-O0"):
    done = make(folder, "test", cc, level)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "\nok\n" in done.stdout, done.stdout
    return done.stdout


@pytest.mark.thorough_cases("gcc")
@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_recorded_run(exported, tmp_path, cc):
    """Every function, also the step and its derivatives, at 32 samples of a run of ``simulate``."""
    for file in exported.glob("*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    printed = assert_recorded_run_is_equal(tmp_path, cc, "-O1")
    tested = [line.split()[0] for line in printed.splitlines() if "of the tolerance" in line]
    header = (exported / "arm.h").read_text()
    assert {f"arm_{name}" for name in tested} == set(re.findall(r"^void (\w+)\(", header, re.M))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [2000, 2001, 2004])
def test_random_arms_with_every_option(seed, tmp_path):
    fa.export_c(busy(seed, theory=["linear", "second_order"][seed % 2]).arm, tmp_path)
    assert_recorded_run_is_equal(tmp_path, "gcc")


@pytest.mark.thorough
def test_rigid_arm(tmp_path):
    fa.export_c(parametric("linear").rigid(), tmp_path, name="rigid")
    assert_recorded_run_is_equal(tmp_path, "gcc")


@pytest.mark.thorough
def test_the_test_program_reports_a_wrong_number(exported, tmp_path):
    for file in exported.glob("*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    recording = (tmp_path / "arm_recording.h").read_text()
    first = re.search(r"tip_expected\[32\]\[3\] = \{\n\{([-\d.e]+)", recording)
    wrong = repr(float(first[1]) * (1.0 + 1e-10))
    whole = recording[: first.start(1)] + wrong + recording[first.end(1) :]
    (tmp_path / "arm_recording.h").write_text(whole)
    done = make(tmp_path, "test")
    assert done.returncode != 0
    assert "failed" in done.stdout


@pytest.mark.thorough
def test_parameters(exported):
    """With other values of the parameters, the functions are those of the arm that has them."""
    library = Library(exported)
    arm = parametric("second_order")
    others, other_arm = changed(arm)
    given = arguments(arm, 3)
    acting = [given[name] for name in ("q", "qd", "torque", "tip_force")]
    for values, same in ((None, arm), (others, other_arm)):
        qdd = np.zeros(arm.dof)
        library("forward_dynamics", *acting, values, qdd)
        wanted = same.forward_dynamics(*acting)
        assert_same("forward_dynamics", qdd, wanted, same, given["q"])
        M = np.zeros((arm.dof, arm.dof))
        library("mass_matrix", given["q"], values, M)
        assert_same("mass_matrix", M, same.mass_matrix(given["q"]), same, given["q"])


@pytest.mark.thorough
def test_a_run_of_steps_is_that_of_simulate(exported):
    library, arm = Library(exported), parametric("second_order")
    steps, h = 200, 0.2 * library.macros["largest_step"]
    torque = np.random.default_rng(1).normal(size=(steps, arm.n_joints))
    run = fa.simulate(
        arm,
        steps * h,
        torque=torque,
        rate=1.0 / h,
        torque_interpolation="hold",
        integrator="rk4",
        step=h,
    )
    q, qd = run.q.values[0].copy(), run.qd.values[0].copy()
    after = np.zeros_like(q), np.zeros_like(q)
    for k in range(steps):
        library("step", q, qd, np.ascontiguousarray(torque[k]), None, h, None, *after)
        q[:], qd[:] = after
    # Rounding errors add up over the steps, but the arm does not amplify them.
    scale = np.sqrt(np.diag(arm.mass_matrix(q)))
    for found, wanted in ((q, run.q.values[-1]), (qd, run.qd.values[-1])):
        limit = 1e-12 * np.abs(scale * wanted).max()
        np.testing.assert_allclose(scale * found, scale * wanted, rtol=0, atol=limit)


def test_largest_step(tmp_path):
    """Without damping, the limit of the method is 2.83 / 2.61 of the largest step."""
    arm = two_links()
    fa.export_c(arm, tmp_path)
    library, n, growth = Library(tmp_path), arm.dof, []
    rest = np.zeros(n)
    for factor in (1.0, 1.1):
        A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, arm.n_joints))
        h = factor * library.macros["largest_step"]
        library("step_jacobian", rest, rest, np.zeros(arm.n_joints), None, h, A, B)
        # The joints turn freely: their double eigenvalue 1 is found to half of the digits.
        growth.append(abs(np.linalg.eigvals(A)).max())
    assert growth[0] < 1.0 + 1e-6
    assert growth[1] > 1.05


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="other systems name symbols differently")
def test_no_state_no_allocation_and_prefixed_names(exported, tmp_path):
    """The object file has no writable data, and refers to the mathematical library only."""
    path = tmp_path / "arm.o"
    command = [compiler("gcc"), "-std=c99", "-O0", "-c", str(exported / "arm.c"), "-o", str(path)]
    subprocess.run(command, check=True)
    listed = subprocess.run(["nm", str(path)], capture_output=True, text=True, check=True).stdout
    symbols = [line.split()[-2:] for line in listed.splitlines()]
    assert not [name for kind, name in symbols if kind in "BbDdCc"]
    outside = {name for kind, name in symbols if kind == "U"}
    # GCC combines sine and cosine of the same number, and calls memcpy and memset for arrays.
    assert outside - {"_GLOBAL_OFFSET_TABLE_"} <= MATHEMATICS | {"sincos", "memcpy", "memset"}
    assert all(name.startswith("arm_") for kind, name in symbols if kind.isupper() and kind != "U")


def test_header_in_cpp(exported):
    code = '#include "arm.h"\nint main() { return ARM_DOF > 0 ? 0 : 1; }\n'
    command = [compiler("g++"), "-Wall", "-Werror", "-fsyntax-only", "-x", "c++", "-I", exported]
    subprocess.run([*map(str, command), "-"], input=code, text=True, check=True)


def test_header_names_coordinates_and_parameters(exported):
    header = (exported / "arm.h").read_text()
    arm = parametric("second_order")
    assert f"#define ARM_DOF {arm.dof}\n" in header
    assert "q[0]  joint_angle[1], rad" in header
    assert "ARM_JOINTS_0_FRICTION_COULOMB, /* joints[0].friction.coulomb */" in header


def test_wrong_arguments_write_nothing(tmp_path):
    arm, folder = parametric("linear"), tmp_path / "new"
    with pytest.raises(fa.InputError, match="name must be at most 32 lower-case"):
        fa.export_c(arm, folder, name="My-Arm")
    with pytest.raises(fa.InputError, match="links"):
        fa.export_c(arm, folder, parameters=["links[0].length"])
    with pytest.raises(fa.InputError, match="arm must be an Arm"):
        fa.export_c(arm.spec, folder)
    assert not folder.exists()


@pytest.mark.thorough
def test_files_of_others_are_not_replaced(tmp_path):
    arm, own = parametric("linear"), "all:\n\techo mine\n"
    (tmp_path / "Makefile").write_text(own)
    (tmp_path / "arm.h").mkdir()
    with pytest.raises(fa.InputError, match="already exists") as caught:
        fa.export_c(arm, tmp_path)
    assert len(caught.value.problems) == 2
    assert (tmp_path / "Makefile").read_text() == own
    assert not (tmp_path / "arm.c").exists()
    for _ in range(2):  # those of an earlier export are replaced
        assert len(fa.export_c(arm, tmp_path / "new")) == 5


@pytest.mark.thorough
def test_command(tmp_path):
    path = tmp_path / "swing.yaml"
    fa.save_arm(parametric("linear"), path)
    found = CliRunner().invoke(app, ["export", "c", str(path), "--parameter", "payload.mass"])
    assert found.exit_code == 0, found.output
    assert "ARM_PAYLOAD_MASS" in (tmp_path / "swing_c" / "arm.h").read_text()
    assert_recorded_run_is_equal(tmp_path / "swing_c", "gcc")
    wrong = CliRunner().invoke(app, ["export", "c", str(path), "--parameter", "payload.mas"])
    assert wrong.exit_code == 2
    assert "export_c: parameters[0]" in wrong.output
    assert "did you mean mass?" in wrong.output


def test_without_casadi(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(fa.InputError, match=r"pip install 'flexarm\[casadi\]'"):
        fa.export_c(parametric("linear"), tmp_path)
