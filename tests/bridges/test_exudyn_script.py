"""Exported scripts, executed by Exudyn, against runs of flexarm."""

import runpy

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.test_rigid_chain import arm, fixed_at_joint_2
from flexarm.bridges.rigid_chain.export import coordinates, rigid_chain
from flexarm.cli.main import app

DURATION = 0.5


def swing(t):
    return np.array([2.0 * np.sin(3.0 * t), 1.0])


def in_exudyn(path, angles, torque):
    """Return the tip's path (samples, 2) from a script."""
    pytest.importorskip("exudyn", reason="Exudyn is not installed: the script was not run")
    script = runpy.run_path(str(path))
    times, x, y = script["run"](*script["build"](angles, torque), duration=DURATION)
    np.testing.assert_allclose(np.diff(times), DURATION / (len(times) - 1), rtol=1e-6)
    return np.stack([x, y], axis=1)


def simulated(one, angles, torque, samples):
    rate = (samples - 1) / DURATION
    return fa.simulate(one, DURATION, initial=one.rest(angles), torque=torque, rate=rate).tip.values


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("driven", [False, True])
def test_run_in_exudyn(fixed, driven, tmp_path):
    """The chain is the same; the flexible arm differs by what the bars do not resolve."""
    flexible = fixed_at_joint_2() if fixed else arm()
    start = np.array([0.3, -0.5])[: flexible.n_joints]
    path = fa.export_exudyn(flexible, tmp_path / "arm.py", virtual_joints=4)
    torque = (lambda t: swing(t)[: flexible.n_joints]) if driven else None
    found = in_exudyn(path, start, torque)
    bars = rigid_chain(flexible, 4)
    places = coordinates(bars.arm, bars.driven)
    angles = bars.arm.joint_angles(np.zeros(bars.arm.dof))
    angles[places] = start

    def on_bars(t):
        padded = np.zeros(bars.arm.n_joints)
        padded[places] = torque(t)
        return padded

    wanted = simulated(bars.arm, angles, on_bars if driven else None, len(found))
    moved = np.linalg.norm(wanted[-1] - wanted[0])
    assert moved > 0.1
    # The script's Runge-Kutta method has steps of one radian of the fastest vibration.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-5 * moved)
    exact = simulated(flexible, start, torque, len(found))
    # Four bars have an error of 0.5 % in the fourth frequency, which hardly moves.
    np.testing.assert_allclose(found, exact, rtol=0, atol=2e-3 * moved)


def test_command_and_errors(tmp_path):
    path = tmp_path / "boom.yaml"
    fa.save_arm(arm(), path)
    found = CliRunner().invoke(app, ["export", "exudyn", str(path), "--virtual-joints", "3"])
    assert found.exit_code == 0, found.output
    text = (tmp_path / "boom.py").read_text()
    assert '("bending2_3", ' in text
    assert "frequency 2, Hz" in text
    still = fa.Link(length=0.5, mass_per_length=1.0, flexible=False)
    post = fa.Arm(links=[still], joints=[fa.Joint(fixed=True)])
    with pytest.raises(fa.InputError, match="arm has no joint that moves"):
        fa.export_exudyn(post, tmp_path / "post.py")
    assert not (tmp_path / "post.py").exists()


def test_description_fits_the_arm(tmp_path):
    """The example in the script has one number for each driven joint."""
    found = fa.export_exudyn(fixed_at_joint_2(), tmp_path / "one.py").read_text()
    assert "build(angles=[0.3], torque=lambda t: [1.0])" in found
    assert "gravity" not in found.partition('"""\n')[0]
    found = fa.export_exudyn(arm(), tmp_path / "two.py").read_text()
    assert "build(angles=[0.3, 0.3], torque=lambda t: [1.0, 1.0])" in found
