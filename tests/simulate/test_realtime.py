"""Plants and controllers against the clock and over UDP, against `simulate`.

No check depends on the load of the computer: runs in lockstep have no deadlines, and runs with
deadlines have a clock that the test moves.
"""

import re
import socket
import struct
import threading

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.simulation.real_time.partners import OwnController, SampleTimes
from flexarm.simulation.real_time.realtime import PlantLoop

H = 0.001
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.6}
LIMIT = [8.0, 3.0]
READINGS = {"joint_angle": 2, "joint_rate": 2, "strain": 1}
SENT = READINGS | dict.fromkeys(("reference_angle", "reference_rate", "reference_acceleration"), 2)


def arm():
    joints = [0.1, {"mass": 0.5, "hub_inertia": 0.02, "housing_inertia": 0.02}]
    return chain((1.4, 1.0), joints, gauge=(0.05, 0.005), gauged=1, elements=[2, 1], **ROD)


def controller():
    """Return a controller with a memory, so that lost and repeated updates have an effect."""
    return fa.JointPID([40.0, 10.0], [20.0, 3.0], [30.0, 8.0], torque_limit=LIMIT, sample_time=H)


def motion():
    return fa.joint_motion(arm(), [0.0, 0.0], [0.3, -0.2], 0.05)


def simulated(samples):
    return fa.simulate(
        arm(), samples * H, controller=controller(), reference=motion(), rate=1.0 / H
    )


def free_address():
    """Return an address at which nothing listens."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{one.getsockname()[1]}"


class Partner(threading.Thread):
    """Controller in another thread; its result, or its error."""

    def __init__(self, function, *args, **options):
        super().__init__(daemon=True)
        self.given, self.found = (function, args, options), None
        self.start()

    def run(self):
        function, args, options = self.given
        try:
            self.found = function(*args, **options)
        except fa.FlexarmError as error:
            self.found = error

    def result(self):
        self.join(30.0)
        return self.found


def assert_same(run, wanted):
    """The arithmetic is the same; the sums of references may round differently."""
    for name in ("q", "qd", "torque"):
        scale = np.abs(wanted[name].values).max()
        np.testing.assert_allclose(run[name], wanted[name], rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("clock", [False, True])
def test_one_process_equals_simulate(clock):
    run = fa.realtime(fa.Plant(arm(), H), controller(), 60 * H, motion(), clock=clock)
    assert_same(run, simulated(60))
    assert run.sizes["tick"] == 60
    np.testing.assert_allclose(run.measured_joint_angle, run.joint_angle[:-1], atol=1e-15)
    assert ("sample_late" in run) == clock
    assert run.failure == ""


@pytest.mark.parametrize("own", [False, True])
def test_lockstep_over_udp_equals_simulate(own):
    """With the reference of the packets, and with one of the controller's process."""
    at = free_address()
    mine = {"reference": motion(), "readings": READINGS} if own else {"readings": SENT}
    other = Partner(fa.realtime, at, controller(), **mine)
    sent = None if own else motion()
    run = fa.realtime(fa.Plant(arm(), H), at, 60 * H, sent, clock=False)
    assert_same(run, simulated(60))
    answered = other.result()
    np.testing.assert_array_equal(answered.torque_command, run.torque[:-1])
    np.testing.assert_array_equal(answered.measured_strain, run.measured_strain)
    assert answered.packets_lost == 0


class Relay(threading.Thread):
    """Relay between plant and controller that loses every third packet and doubles the others."""

    def __init__(self, to):
        super().__init__(daemon=True)
        self.inside, self.outside = (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)
        )
        self.outside.bind(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.outside.getsockname()[1]}"
        host, port = to.split(":")
        self.inside.bind((host, 0))
        self.to, self.plant = (host, int(port)), None
        threading.Thread(target=self.back, daemon=True).start()
        self.start()

    def run(self):
        count = 0
        while True:
            data, self.plant = self.outside.recvfrom(9999)
            count += 1
            if count % 3:
                for _ in range(2):
                    self.inside.sendto(data, self.to)

    def back(self):
        count = 0
        while True:
            data = self.inside.recv(9999)
            count += 1
            if count % 3 and self.plant:
                self.outside.sendto(data, self.plant)


def test_lost_and_doubled_packets_do_not_change_a_lockstep_run():
    at = free_address()
    other = Partner(fa.realtime, at, controller(), readings=SENT)
    relay = Relay(at)
    run = fa.realtime(fa.Plant(arm(), H), relay.address, 12 * H, motion(), clock=False)
    assert_same(run, simulated(12))
    assert run.packets_repeated > 0
    answered = other.result()
    assert answered.sizes["tick"] == 12
    assert answered.packets_repeated > 0


@pytest.mark.parametrize("token", [12345.0, 0.0])
def test_layout_of_packets(token):
    """Token, sequence number, time, readings, reference; answers with the first three.

    The first packet requests the run, with the number -2: the time of its answer is the token. That
    of a controller that returns the first three numbers of every packet is 0.
    """
    at = free_address()
    host, port = at.split(":")
    received = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind((host, int(port)))
        other = Partner(fa.realtime, fa.Plant(arm(), H), at, 3 * H, motion(), clock=False)
        while True:
            data, sender = one.recvfrom(9999)
            row = struct.unpack(f"<{len(data) // 8}d", data)
            time = token if row[1] == -2.0 else row[2]
            one.sendto(struct.pack("<5d", row[0], row[1], time, 0.5, -0.25), sender)
            if row[1] == -1.0:
                break
            if not received or received[-1][1] != row[1]:
                received.append(row)
    run, found = other.result(), np.array(received)
    ticks = np.arange(3)
    np.testing.assert_array_equal(found[0, 1:3], [-2.0, 0.0])
    np.testing.assert_array_equal(found[0, 3:], found[1, 3:])
    found = found[1:]
    np.testing.assert_array_equal(found[:, 0], token)
    np.testing.assert_array_equal(found[:, 1], ticks)
    np.testing.assert_allclose(found[:, 2], H * ticks, rtol=1e-12)
    wanted = [run.measured_joint_angle, run.measured_joint_rate, run.measured_strain]
    wanted += [f(H * ticks) for f in (motion().joint_angle, motion().joint_rate)]
    wanted += [motion().joint_acceleration(H * ticks)]
    np.testing.assert_allclose(found[:, 3:], np.hstack(wanted), rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(run.torque, [[0.5, -0.25]] * 4)


class HandClock:
    """Clock that the test moves."""

    def __init__(self):
        self.time = 100.0

    def now(self):
        return self.time

    def wait_until(self, instant):
        self.time = max(self.time, instant)


class Late(OwnController):
    """Controller whose answers take given times; a negative one is lost."""

    def __init__(self, clock, delays):
        super().__init__(controller(), motion(), 2)
        self.clock, self.delays = clock, delays

    def answer(self, packet, seconds, repeat):
        delay = self.delays.get(packet.number, 1e-4)
        self.clock.time += seconds if delay < 0.0 else min(delay, seconds)
        if delay < 0.0 or delay > seconds:
            return None
        return super().answer(packet, seconds, repeat)


def paced(delays, samples, timeout=1.0):
    clock = HandClock()
    partner = Late(clock, delays)
    loop = PlantLoop(fa.Plant(arm(), H), partner, None, clock, True, 0.5 * H, timeout)
    return loop.run(samples)


def test_late_answers_hold_the_last_torque():
    run = paced({3: 0.7 * H, 7: -1.0, 8: -1.0}, 12)
    assert run.torques_held == 3
    torque = run.torque.values
    np.testing.assert_array_equal(torque[3], torque[2])
    np.testing.assert_array_equal(torque[7:9], torque[[6, 6]])
    assert not np.array_equal(torque[9], torque[8])
    np.testing.assert_allclose(run.sample_start, H * np.arange(12), atol=1e-12)
    wanted = np.full(12, 1e-4)
    wanted[[3, 7, 8]] = 0.5 * H
    wanted[0] = np.nan  # the clock starts with the first answer
    np.testing.assert_allclose(run.sample_answer, wanted, atol=1e-12)
    mean = 1e6 * wanted[1:].mean()
    assert re.search(rf"^answer +{mean:.1f} ", run.timing, re.MULTILINE)


class SlowFirst(fa.Plant):
    """Plant whose first step in a process takes 50 ms."""

    clock, loaded = HandClock(), False

    def step(self, torque):
        self.clock.time += 0.0 if SlowFirst.loaded else 0.05
        SlowFirst.loaded = True
        return super().step(torque)


def test_the_clock_starts_after_the_first_step_of_the_process():
    clock = SlowFirst.clock
    plant = SlowFirst(arm(), H)
    loop = PlantLoop(plant, Late(clock, {}), None, clock, True, 0.5 * H, 1.0)
    run = loop.run(12)
    assert SlowFirst.loaded
    assert run.missed_deadlines == 0
    np.testing.assert_allclose(run.sample_late, 0.0, atol=1e-12)
    assert_same(run, simulated(12))


def test_a_silent_controller_ends_a_run_on_the_clock_with_its_result():
    delays = dict.fromkeys(range(4, 99), -1.0)
    with pytest.raises(fa.SimulationError, match=r"no answer from JointPID for 0\.01 s") as error:
        paced(delays, 30, timeout=10 * H)
    run = error.value.result
    assert 4 < run.sizes["tick"] < 20
    np.testing.assert_array_equal(run.torque[4:], [run.torque[3]] * (run.time.size - 4))
    assert "no answer" in run.failure
    assert error.value.time == pytest.approx(float(run.time[-1]))


def test_late_samples_and_missed_deadlines():
    times = SampleTimes()
    for started, ended, planned in ((5.0, 5.9, 0.0), (6.0, 8.5, 1.0), (8.5, 8.9, 2.0)):
        times.add(started, started + 0.1, ended, planned)
    assert times.late == pytest.approx([0.0, 0.0, 1.5])
    assert times.busy == pytest.approx([0.9, 2.5, 0.4])
    assert times.missed(1.0) == 2
    assert times.missed(1.95) == 1
    assert "2500000.0" in times.table().splitlines()[-1]


def test_a_plant_that_starts_elsewhere_is_reported():
    """`simulate` starts on the reference; a plant has its own state."""
    moved = fa.joint_motion(arm(), [0.3, -0.2], [0.3, -0.1], 0.02)
    own = {"controller": controller(), "reference": moved, "clock": False}
    plant = fa.Plant(arm(), H)
    with pytest.warns(fa.FlexarmWarning, match=r"starts 0.3 rad .*plant.reset\(arm.rest\(\[ 0.3,"):
        fa.realtime(plant, duration=0.02, **own)
    plant.reset(arm().rest([0.3, -0.2]))
    run = fa.realtime(plant, duration=0.02, **own)
    wanted = fa.simulate(arm(), 0.02, controller=controller(), reference=moved, rate=1.0 / H)
    np.testing.assert_allclose(run.q, wanted.q, rtol=0, atol=1e-12)  # as in lockstep above
