"""Exported controllers in processes of their own, over UDP, against `simulate`."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from bridges.c_code_tools import make
from bridges.test_c_controllers import LAWS, feedforward, heavy
from conformance.controller_examples import SAMPLE_TIME
from simulate.test_realtime import free_address


def built(folder, controller):
    """Return the program of an exported controller."""
    files = fa.export_c(heavy(), folder, controller=controller)
    assert folder / "arm_udp.c" in files
    done = make(folder, "udp")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "arm_udp"


def started(program: Path, at: str, limit: int = 20) -> subprocess.Popen:
    """Start a program at an address; it ends by itself after ``limit`` seconds of silence."""
    words = [str(program), at.split(":")[1], str(limit)]
    return subprocess.Popen(words, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    "name", ["computed_torque", "joint_pid", "strain_feedback", "wave_based_control"]
)
def test_closed_loop_over_udp_equals_simulate(name, tmp_path):
    """Without memory, with memory, with strain, and around another controller."""
    arm, controller = heavy(), LAWS[name]()
    motion, at = fa.joint_motion(arm, [0.0, 0.0], [0.3, -0.2], 0.5), free_address()
    with started(built(tmp_path, controller), at) as other:
        plant = fa.Plant(arm, SAMPLE_TIME)
        run = fa.realtime(plant, at, 0.6, motion, clock=False, timeout=20.0)
        assert other.wait(20.0) == 0, other.stderr.read()
    wanted = fa.simulate(arm, 0.6, controller=controller, reference=motion, rate=1.0 / SAMPLE_TIME)
    assert run.sizes["time"] == wanted.sizes["time"]
    # Stable loops do not amplify rounding errors, which add up over 150 samples.
    for channel in ("torque", "joint_angle", "link_tip_deflection"):
        limit = 1e-11 * np.abs(wanted[channel].values).max()
        found = run[channel].values[:-1]
        np.testing.assert_allclose(
            found, wanted[channel].values[:-1], rtol=0, atol=limit, err_msg=channel
        )


def test_a_packet_of_another_length_ends_both_programs(tmp_path):
    """Here without the reference, which the controller follows."""
    at = free_address()
    with started(built(tmp_path, LAWS["joint_pid"]()), at) as other:
        with pytest.raises(fa.SimulationError, match="ended the run"):
            fa.realtime(fa.Plant(heavy(), SAMPLE_TIME), at, 0.1, clock=False, timeout=20.0)
        assert other.wait(20.0) == 1
        assert "sequence number, time, joint_angle (2)" in other.stderr.read()


def test_another_sample_time_ends_both_programs(tmp_path):
    at = free_address()
    with started(built(tmp_path, LAWS["joint_pid"]()), at) as other:
        plant, motion = (
            fa.Plant(heavy(), 2 * SAMPLE_TIME),
            fa.joint_motion(heavy(), [0.0, 0.0], [0.3, -0.2], 0.5),
        )
        with pytest.raises(fa.SimulationError, match="ended the run") as error:
            fa.realtime(plant, at, 0.1, motion, clock=False, timeout=20.0)
        assert other.wait(20.0) == 1
        assert "packet 1 has the time 0.008 s, but the controller" in other.stderr.read()
    assert error.value.result.sizes["tick"] == 1


def test_a_program_without_a_plant_ends(tmp_path):
    with started(built(tmp_path, LAWS["joint_pid"]()), free_address(), 1) as other:
        assert other.wait(20.0) == 1
        assert "no packet" in other.stderr.read()


def test_no_program_for_inputs_that_packets_lack(tmp_path):
    follower = fa.JointPD([8.0, 3.0], [0.8, 0.3], SAMPLE_TIME, feedforward)
    files = fa.export_c(heavy(), tmp_path, controller=follower)
    assert [file.name for file in files if "udp" in file.name] == []
    assert fa.export_c(heavy(), tmp_path)[-1].name == "Makefile"
