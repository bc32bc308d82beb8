"""The handshake of `realtime`: packets of other programs and of earlier runs change nothing.

Runs are in lockstep, so that no check depends on the load of the computer.
"""

import struct
import threading

import numpy as np
import pytest

import flexarm as fa
from flexarm.simulation.real_time import realtime as module
from simulate.foreign_packets import Hostile, Sender, packed, place, send_stale, udp_socket
from simulate.test_realtime import (
    SENT,
    H,
    Partner,
    arm,
    assert_same,
    controller,
    free_address,
    motion,
    simulated,
)

PATIENT = {"timeout": 30.0}


def listening(at, **options):
    """Return a controller in another thread."""
    return Partner(fa.realtime, at, controller(), readings=SENT, **(PATIENT | options))


def plant_run(at, samples=12, **options):
    plant = fa.Plant(arm(), H)
    return fa.realtime(plant, at, samples * H, motion(), clock=False, **(PATIENT | options))


def test_packets_of_others_before_the_run_are_ignored():
    """Also those that wait in the queue of the controller before it reads the first one."""
    at = free_address()
    other = listening(at)
    send_stale(at, 3)
    with Sender(at):
        run = plant_run(at)
    assert_same(run, simulated(12))
    answered = other.result()
    assert answered.sizes["tick"] == 12
    assert answered.packets_foreign > 0
    assert answered.failure == ""


@pytest.mark.parametrize("seed", range(3))
def test_packets_of_others_during_the_run_are_ignored_by_both_sides(seed):
    """Stale and repeated ones, and copies with another token, number or time."""
    at = free_address()
    other = listening(at)
    run = plant_run(Hostile(at, seed).address)
    assert_same(run, simulated(12))
    answered = other.result()
    np.testing.assert_array_equal(answered.torque_command, run.torque[:-1])
    assert min(run.packets_foreign, run.packets_discarded, answered.packets_foreign) > 0


@pytest.mark.parametrize("lost", [(1, 0), (3, 0), (0, 3), (2, 4)])
def test_lost_packets_of_the_handshake_are_repeated(lost):
    at = free_address()
    other = listening(at)
    run = plant_run(Hostile(at, 5, lost).address)
    assert_same(run, simulated(12))
    assert run.packets_repeated > 0
    assert other.result().sizes["tick"] == 12


def test_a_controller_that_is_restarted_in_the_handshake():
    """The first one grants the run and goes; the second one draws a token of its own."""
    at = free_address()
    with udp_socket() as first:
        first.bind(place(at))
        plant = Partner(plant_run, at)
        data, sender = first.recvfrom(9999)
        request = struct.unpack("<3d", data[:24])
        assert request[1] == -2.0
        first.sendto(packed(request[0], -2.0, 777.0), sender)
        while struct.unpack("<3d", first.recv(9999)[:24])[:2] != (777.0, 0.0):
            pass
    other = listening(at)
    assert_same(plant.result(), simulated(12))
    assert other.result().sizes["tick"] == 12


def granted(one):
    """Grant the run that a plant requests; return the address of the plant."""
    data, sender = one.recvfrom(9999)
    one.sendto(packed(struct.unpack("<d", data[:8])[0], -2.0, 777.0), sender)
    return sender


def test_a_controller_that_is_restarted_in_the_run_does_not_continue_it():
    """Its memory is lost, so the run ends; the new controller serves the next run."""
    at = free_address()
    with udp_socket() as first:
        first.bind(place(at))
        plant = Partner(plant_run, at, timeout=0.5)
        sender, last = granted(first), -1.0
        while last < 4.0:
            row = struct.unpack("<3d", first.recv(9999)[:24])
            if row[0] == 777.0:
                last = row[1]
                first.sendto(packed(*row, 0.5, -0.25), sender)
    other = listening(at)
    failure = plant.result()
    assert "no answer from 127.0.0.1" in str(failure)
    assert failure.result.sizes["tick"] == 5
    assert_same(plant_run(at), simulated(12))
    assert other.result().sizes["tick"] == 12


def test_answers_with_another_time_are_discarded():
    at = free_address()
    with udp_socket() as one:
        one.bind(place(at))
        plant = Partner(plant_run, at, samples=2)
        sender = granted(one)
        while True:
            row = struct.unpack("<3d", one.recv(9999)[:24])
            if row[0] == 777.0:
                late = row[2] + 1e-6
                one.sendto(packed(row[0], row[1], late, 9.0, 9.0), sender)
                one.sendto(packed(*row, 0.5, -0.25), sender)
                if row[1] == -1.0:
                    break
    run = plant.result()
    np.testing.assert_array_equal(run.torque, [[0.5, -0.25]] * 3)
    assert run.packets_discarded >= 2


class Waits(fa.Controller):
    """A controller that waits at its fifth sample until another plant has failed."""

    sample_time = H

    def __init__(self):
        self.inner, self.reached, self.released = controller(), threading.Event(), threading.Event()

    def reset(self):
        self.inner.reset()

    def update(self, t, measurement, reference):
        if t > 3.5 * H:
            self.reached.set()
            self.released.wait(30.0)
        return self.inner.update(t, measurement, reference)


def test_a_second_plant_does_not_disturb_the_run():
    at, waits = free_address(), Waits()
    other = Partner(fa.realtime, at, waits, readings=SENT, **PATIENT)
    first = Partner(plant_run, at)
    assert waits.reached.wait(30.0)
    with pytest.raises(fa.SimulationError, match="no answer"):
        plant_run(at, timeout=0.3)
    waits.released.set()
    assert_same(first.result(), simulated(12))
    assert other.result().sizes["tick"] == 12


@pytest.mark.thorough
def test_others_do_not_extend_the_time_limits():
    """A controller without a plant, and a plant whose controller sends packets of another run."""
    at = free_address()
    with Sender(at):
        failure = listening(at, timeout=0.3).result()
    assert "no packet at 127.0.0.1" in str(failure)
    assert "packets of other programs or earlier runs were ignored" in str(failure)
    with udp_socket() as one:
        one.bind(place(at))
        plant = Partner(plant_run, at, timeout=0.3)
        sender = granted(one)
        while plant.is_alive():
            one.sendto(packed(778.0, 0.0, 0.0, 1.0, 1.0), sender)
    assert "no answer from 127.0.0.1" in str(plant.result())


def test_requests_that_are_remembered_are_limited(monkeypatch):
    """Requests of plants that have gone do not take the place of the newest one."""
    monkeypatch.setattr(module, "_REQUESTS", 4)
    at = free_address()
    other = listening(at)
    with udp_socket() as one:
        for token in range(1, 20):
            one.sendto(packed(float(token), -2.0, 0.0), place(at))
    assert_same(plant_run(at), simulated(12))
    assert other.result().sizes["tick"] == 12
