"""Exported controllers in processes of their own, over UDP, against `simulate`."""

import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from bridges.c_code_tools import make
from bridges.test_c_controllers import LAWS, feedforward, heavy
from conformance.controller_examples import SAMPLE_TIME
from simulate.foreign_packets import Hostile, Sender, packed, place, send_stale, udp_socket
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


@pytest.mark.sampled("strain_feedback")
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


@pytest.mark.thorough
def test_a_packet_of_another_length_ends_both_programs(tmp_path):
    """Here without the reference, which the controller follows."""
    at = free_address()
    with started(built(tmp_path, LAWS["joint_pid"]()), at) as other:
        with pytest.raises(fa.SimulationError, match="ended the run"):
            fa.realtime(fa.Plant(heavy(), SAMPLE_TIME), at, 0.1, clock=False, timeout=20.0)
        assert other.wait(20.0) == 1
        assert "token, sequence number, time, joint_angle (2)" in other.stderr.read()


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


@pytest.mark.thorough
def test_a_program_without_a_plant_ends(tmp_path):
    with started(built(tmp_path, LAWS["joint_pid"]()), free_address(), 1) as other:
        assert other.wait(20.0) == 1
        assert "no packet" in other.stderr.read()


def test_no_program_for_inputs_that_packets_lack(tmp_path):
    follower = fa.JointPD([8.0, 3.0], [0.8, 0.3], SAMPLE_TIME, feedforward)
    files = fa.export_c(heavy(), tmp_path, controller=follower)
    assert [file.name for file in files if "udp" in file.name] == []
    assert fa.export_c(heavy(), tmp_path)[-1].name == "Makefile"


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """Return the program of a controller with a memory."""
    return built(tmp_path_factory.mktemp("pid"), LAWS["joint_pid"]())


def moved():
    return fa.joint_motion(heavy(), [0.0, 0.0], [0.3, -0.2], 0.5)


def plant_run(at, timeout=20.0):
    plant = fa.Plant(heavy(), SAMPLE_TIME)
    return fa.realtime(plant, at, 12 * SAMPLE_TIME, moved(), clock=False, timeout=timeout)


def assert_as_simulated(run):
    wanted = fa.simulate(
        heavy(),
        12 * SAMPLE_TIME,
        controller=LAWS["joint_pid"](),
        reference=moved(),
        rate=1.0 / SAMPLE_TIME,
    )
    limit = 1e-11 * np.abs(wanted.torque.values).max()  # as above
    np.testing.assert_allclose(run.torque[:-1], wanted.torque[:-1], rtol=0, atol=limit)


def wait_until_it_listens(at):
    """A program that listens answers a request."""
    with udp_socket() as one:
        one.settimeout(0.05)
        one.connect(place(at))
        for _ in range(400):
            try:
                one.send(packed(5.0, -2.0, 0.0))
                return np.frombuffer(one.recv(999), "<f8")
            except OSError:
                time.sleep(0.05)
    raise AssertionError("the program does not listen")


@pytest.mark.sampled("3-lost2")
@pytest.mark.parametrize(("seed", "lost"), [(1, (0, 0)), (2, (3, 0)), (3, (0, 3))])
def test_the_program_ignores_packets_of_others_and_repeats_lost_ones(seed, lost, program):
    at = free_address()
    with started(program, at) as other:
        answer = wait_until_it_listens(at)
        np.testing.assert_array_equal(answer[:2], [5.0, -2.0])
        send_stale(at, 3)
        run = plant_run(Hostile(at, seed, lost).address)
        assert other.wait(20.0) == 0, other.stderr.read()
    assert_as_simulated(run)
    assert min(run.packets_foreign, run.packets_discarded) > 0


def test_tokens_of_the_program_are_random_and_belong_to_requests(program):
    tokens = []
    for _ in range(2):
        at = free_address()
        with started(program, at, 1) as other:
            first, again = wait_until_it_listens(at)[2], wait_until_it_listens(at)[2]
            assert first == again
            tokens.append(first)
            with udp_socket() as one:  # a run that ends before its first sample
                one.sendto(packed(first, -1.0, 0.0), place(at))
            assert other.wait(20.0) == 0
    assert len(set(tokens)) == 2
    assert all(1.0 <= token <= 2.0**48 and token.is_integer() for token in tokens)


def test_a_program_that_is_restarted_does_not_continue_the_run(program):
    at = free_address()
    with started(program, at, 2) as other:
        token = wait_until_it_listens(at)[2]
        other.kill()
    with started(program, at, 2) as other:
        wait_until_it_listens(at)
        with udp_socket() as one:
            one.settimeout(0.2)
            one.connect(place(at))
            one.send(packed(token, 0.0, 0.0, *np.zeros(10)))
            with pytest.raises(TimeoutError):
                one.recv(999)
        assert_as_simulated(plant_run(at))
        assert other.wait(20.0) == 0


def test_others_do_not_extend_the_time_limit_of_the_program(program):
    at = free_address()
    with started(program, at, 1) as other:
        with Sender(at):
            assert other.wait(20.0) == 1
        assert "no packet" in other.stderr.read()
