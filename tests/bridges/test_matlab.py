"""Exported MATLAB files, run by GNU Octave, against the methods of the arm."""

import sys

import casadi
import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

import flexarm as fa
from bridges.octave import octave
from bridges.symbolic_cases import PARAMETERS, arguments, assert_same, changed, parametric
from flexarm.bridges.matlab.export import EXPRESSIONS, statements
from flexarm.cli.main import app
from random_options import busy

#: Rounding of some thousand operations, which kernels and statements order differently.
RELATIVE = 1e-12


def light(theory="linear", payload=0.1):
    """Return a slow arm of one link, with damping."""
    return fa.Arm(
        links=[
            fa.Link(
                length=1.0,
                flexural_rigidity=20.0,
                mass_per_length=0.3,
                modes=2,
                damping=fa.ModalDamping(ratio=[0.02, 0.02]),
            )
        ],
        joints=[fa.Joint(hub_inertia=0.2, damping=0.1)],
        payload=fa.Payload(mass=payload),
        gravity=(0.0, -9.81),
        theory=theory,
    )


def assert_dynamics_are_equal(arm, folder, cases, parameters=(), values=None, exported=None):
    """Compare the accelerations of all cases, evaluated in one call and one by one."""
    fa.export_mat(exported or arm, folder / "arm.mat", parameters=parameters)
    names = ("q", "qd", "torque", "tip_force")
    given = {name: np.array([case[name] for case in cases]).T for name in names}
    more = "" if values is None else ", parameters"
    if values is not None:
        given["parameters"] = np.reshape(values, (-1, 1))
    single = ", ".join(f"{name}(:, k)" for name in names)
    script = f"""
    together = arm_dynamics(q, qd, torque, tip_force{more});
    single = zeros(size(q));
    for k = 1:size(q, 2)
        single(:, k) = arm_dynamics({single}{more});
    end
    """
    found = octave(folder, script, given, ("together", "single"))
    for k, case in enumerate(cases):
        expected = arm.forward_dynamics(*(case[name] for name in names))
        assert np.abs(expected).max() > 0.0
        for accelerations in found.values():
            assert_same("forward_dynamics", accelerations[:, k], expected, arm, case["q"])


def test_dynamics_with_parameters(tmp_path):
    values, other = changed(parametric("second_order"))
    cases = [arguments(other, seed) for seed in range(8)]
    exported = parametric("second_order")
    assert_dynamics_are_equal(other, tmp_path, cases, list(PARAMETERS), values, exported)


@pytest.mark.sampled("2000")
@pytest.mark.parametrize("seed", [2000, 2001, 2004])
def test_random_arms_with_every_option(seed, tmp_path):
    arm = busy(seed, theory=["linear", "second_order"][seed % 2]).arm
    assert_dynamics_are_equal(arm, tmp_path, [arguments(arm, k) for k in range(8)])


def test_default_arguments_and_wrong_sizes(tmp_path):
    """Tip force and parameters are optional; a row instead of a column is an error."""
    arm = light("second_order")
    fa.export_mat(arm, tmp_path / "my-arm.mat", parameters=["payload.mass"])
    case = arguments(arm, 3)
    script = """
    qdd = my_arm_dynamics(q, qd, torque);
    heavier = my_arm_dynamics(q, qd, torque, [0; 0; 0], 2 * 0.1);
    message = '';
    try
        my_arm_dynamics(q', qd', torque);
    catch failure
        message = failure.message;
    end
    """
    found = octave(tmp_path, script, case, ("qdd", "heavier", "message"))
    state = case["q"], case["qd"], case["torque"]
    np.testing.assert_allclose(found["qdd"], arm.forward_dynamics(*state), rtol=RELATIVE)
    other = light("second_order", 0.2)
    assert np.abs(found["heavier"] - found["qdd"]).max() > 1.0
    np.testing.assert_allclose(found["heavier"], other.forward_dynamics(*state), rtol=RELATIVE)
    rows = "3 of q, 3 of qd, 1 of torque, 3 of tip_force, 1 of parameters"
    assert found["message"] == f"The rows must be {rows}."


@pytest.mark.parametrize(
    ("stem", "function"),
    [
        ("2 links", "arm_2_links_dynamics"),
        ("_ü", "arm____dynamics"),
        ("a" * 70, "a" * 54 + "_dynamics"),
    ],
)
def test_names_of_the_function(stem, function, tmp_path):
    """Names of MATLAB begin with a letter of ASCII and have at most 63 characters."""
    arm = light().rigid()
    linear = fa.linearize(arm, arm.rest([0.1]))
    table, script = fa.export_mat(arm, tmp_path / f"{stem}.mat", linear=linear)
    assert (table.name, script.name) == (f"{stem}.mat", f"{function}.m")
    assert script.read_text().startswith(f"function qdd = {function}(")


def test_every_expression(tmp_path):
    """Each operation of CasADi has the value that CasADi computes."""
    x, y = casadi.SX.sym("x"), casadi.SX.sym("y")
    unary = ["sqrt", "exp", "expm1", "log", "log1p", "sin", "cos", "tan", "atan", "sinh", "cosh"]
    unary += ["tanh", "fabs", "sign"]
    values = [getattr(casadi, name)(x) for name in unary]
    values += [x + y, x - y, x * y, x / y, -x, 1 / x, x * x, 2 * x, x**y, x**2.5, 0.25 + x]
    values += [casadi.atan2(x, y), casadi.fmin(x, y), casadi.fmax(x, y)]
    function = casadi.Function("f", [x, y], [casadi.vertcat(*values)], ["x", "y"], ["z"])
    used = {function.instruction_id(k) for k in range(function.n_instructions())}
    # No expression has the operation ASSIGN; some versions of CasADi have no TWICE for 2 x.
    written = {getattr(casadi, f"OP_{name}") for name in EXPRESSIONS}
    assert written - used - {casadi.OP_TWICE} == {casadi.OP_ASSIGN}
    points = np.array([[0.7, 1.9, 2.3], [1.3, 0.4, 2.3]])
    script = f"z = zeros({len(values)}, 3);\n" + "\n".join(statements(function))
    z = octave(tmp_path, script, {"x": points[:1], "y": points[1:]}, ("z",))["z"]
    expected = np.array(function(*points.reshape(2, 1, 3)))
    np.testing.assert_allclose(z, expected, rtol=1e-15 * 8)  # a few units in the last place
    with pytest.raises(NotImplementedError, match="in MATLAB"):
        list(statements(casadi.Function("f", [x], [casadi.erf(x)])))


def test_linear_model(tmp_path):
    """Octave computes the poles and the response to a torque pulse from the structure."""
    arm = light()
    rest = fa.equilibrium(arm, [0.4])
    linear = fa.linearize(arm, rest, inputs=["torque", "tip_force"], outputs=["tip"])
    fa.export_mat(arm, tmp_path / "arm.mat", linear=linear)
    script = """
    load('arm.mat');
    poles = eig(linear.A);
    names = [linear.states; linear.inputs; linear.outputs];
    units = [linear.state_units; linear.input_units; linear.output_units];
    n = rows(linear.A);
    step = expm([linear.A, linear.B(:, 1); zeros(1, n + 1)] * 0.01);
    x = zeros(n, 1); y = zeros(rows(linear.C), 100);
    for k = 1:100
        y(:, k) = linear.C * x + linear.D(:, 1);
        x = step(1:n, 1:n) * x + step(1:n, n + 1);
    end
    point = [linear.q; linear.torque];
    """
    found = octave(tmp_path, script, {}, ("poles", "names", "units", "y", "point"))
    by_value = np.sort_complex(found["poles"].round(9))
    np.testing.assert_allclose(by_value, np.sort_complex(linear.poles.round(9)), atol=1e-8)
    assert tuple(found["names"]) == linear.states + linear.inputs + linear.outputs
    assert list(found["units"]) == [linear.units[name] for name in found["names"]]
    assert np.array_equal(found["point"], [*rest.q, *rest.torque])
    import control

    times = 0.01 * np.arange(100)
    own = control.forced_response(linear.to_control()[:, 0], times, np.ones(100)).outputs
    assert np.abs(own).max() > 0.1
    # Both are exact for a constant input; the exponentials differ by their rounding.
    np.testing.assert_allclose(found["y"], own.reshape(found["y"].shape), atol=1e-9)


def test_run_in_octave_is_that_of_simulate(tmp_path):
    """The ode45 of Octave integrates the exported function to the result in the same file."""
    arm = light()
    start = arm.rest([-1.2])
    result = fa.simulate(arm, 0.5, initial=start, rate=100.0, rtol=1e-9)
    fa.export_mat(arm, tmp_path / "swing.mat", result=result)
    script = """
    load('swing.mat');
    n = columns(result.q);
    rates = @(t, x) [x(n+1:end); swing_dynamics(x(1:n), x(n+1:end), 0)];
    options = odeset('RelTol', 1e-8, 'AbsTol', 1e-10);
    [t, x] = ode45(rates, result.time, [result.q(1, :), result.qd(1, :)]', options);
    last = x(end, 1:n); q = result.q; unit = result.units.q; tip = size(result.tip);
    version = result.attributes.flexarm_version;
    thirds = [result.joint / 3, result.attributes.steps / 3];  % integers would be rounded
    """
    found = octave(tmp_path, script, {}, ("last", "q", "unit", "tip", "version", "thirds"))
    assert np.array_equal(found["thirds"], [1 / 3, result.attrs["steps"] / 3])
    assert np.array_equal(found["q"], result.q.values)
    assert found["unit"] == result.q.attrs["units"]
    assert found["tip"].tolist() == [51, 2]
    assert found["version"] == fa.__version__
    moved = np.abs(result.q.values[-1] - result.q.values[0])
    assert moved[0] > 0.2
    # The tolerances of both programs.
    np.testing.assert_allclose(found["last"], result.q.values[-1], atol=1e-6)


@pytest.mark.thorough
def test_command(tmp_path):
    """An arm, a scenario and a result file; the options of the linear model."""
    arm = light()
    fa.save_arm(arm, tmp_path / "swing.yaml")
    run = CliRunner().invoke

    def content(file, *options):
        done = run(app, ["export", "mat", str(tmp_path / file), *options])
        assert done.exit_code == 0, done.output
        return done.output, loadmat(tmp_path / "swing.mat", simplify_cells=True)

    options = ["--angles", "0.3", "--inputs", "tip_force", "--outputs", "torque, joint_angle"]
    printed, found = content("swing.yaml", *options, "--parameter", "payload.mass")
    assert printed.split() == [str(tmp_path / name) for name in ("swing.mat", "swing_dynamics.m")]
    rest = fa.equilibrium(arm, [0.3])
    expected = fa.linearize(arm, rest, inputs=["tip_force"], outputs=["torque", "joint_angle"])
    for name, value in expected.arrays().items():
        assert np.array_equal(np.squeeze(found["linear"][name]), np.squeeze(value)), name
    assert "payload.mass" in (tmp_path / "swing_dynamics.m").read_text()
    assert "result" not in found
    fa.export_mat(arm, tmp_path / "swing.mat")
    default = loadmat(tmp_path / "swing.mat", simplify_cells=True)["linear"]
    assert default["outputs"].tolist() == ["joint_angle[1]", "tip[x]", "tip[y]"]
    assert np.array_equal(default["torque"], fa.equilibrium(arm, [0.0]).torque[0])

    result = fa.simulate(arm, 0.1)
    fa.write_result(result, tmp_path / "swing.nc")
    assert np.array_equal(content("swing.nc")[1]["result"]["tip"], result.tip.values)
    (tmp_path / "fall.yaml").write_text("flexarm: 1\narm: swing.yaml\nrun: {duration: 0.1}\n")
    found = content("fall.yaml", "--out", str(tmp_path / "swing.mat"))[1]
    assert np.array_equal(found["result"]["tip"], result.tip.values)


def test_wrong_arguments(tmp_path):
    arm = light()
    with pytest.raises(fa.InputError, match="linear must be a LinearModel"):
        fa.export_mat(arm, tmp_path / "arm.mat", linear=arm)
    with pytest.raises(fa.InputError, match="result must be a result of simulate"):
        fa.export_mat(arm, tmp_path / "arm.mat", result=arm)
    with pytest.raises(fa.InputError, match=r"path must end in \.mat"):
        fa.export_mat(arm, tmp_path / "arm.m")
    assert not list(tmp_path.iterdir())


def test_without_casadi(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(fa.InputError, match=r"pip install 'flexarm\[casadi\]'"):
        fa.export_mat(light(), tmp_path / "arm.mat")
