"""Errors of `realtime`: wrong arguments, silent and wrong partners."""

import numpy as np
import pytest

import flexarm as fa
from conformance.controller_examples import EXAMPLES, two_links
from flexarm.control.contract.base import requirements_of
from simulate.test_realtime import (
    READINGS,
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


def one_joint():
    one = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
    return fa.joint_motion(one, [0.0], [1.0], 1.0)


class Fails(fa.Controller):
    """A controller that fails at a sample."""

    sample_time = H

    def __init__(self, last, what):
        self.last, self.what, self.own = last, what, controller()

    def reset(self):
        self.own.reset()

    def update(self, t, measurement, reference):
        torque = self.own.update(t, measurement, reference)
        if t < (self.last - 0.5) * H:
            return torque
        return self.what(torque)


def raised(torque):
    raise ValueError("no more")


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (raised, "the controller failed with ValueError: no more"),
        (lambda torque: torque * np.nan, "the controller returned an unusable value"),
        (lambda torque: torque[:1], "torque must be numbers of shape"),
    ],
)
def test_a_failing_controller_leaves_the_results_on_both_sides(what, message):
    with pytest.raises(fa.SimulationError, match=message) as error:
        fa.realtime(fa.Plant(arm(), H), Fails(7, what), 20 * H, motion(), clock=False)
    assert error.value.result.sizes["tick"] == 7
    at = free_address()
    other = Partner(fa.realtime, at, Fails(7, what), readings=SENT)
    with pytest.raises(fa.SimulationError, match=r"the controller at 127.* ended the run") as error:
        fa.realtime(fa.Plant(arm(), H), at, 20 * H, motion(), clock=False)
    assert error.value.time == pytest.approx(7 * H)
    first = {"time": slice(7)}
    assert_same(error.value.result.isel(first), simulated(7).isel(first))
    assert message in str(other.result())
    assert other.result().result.sizes["tick"] == 7


def test_an_answer_of_another_length_is_named():
    """Here of a controller for one joint."""
    at = free_address()
    other = Partner(fa.realtime, at, Fails(0, lambda torque: torque[:1]), readings=SENT)
    with pytest.raises(fa.SimulationError, match="has 32 bytes instead of 40: token, sequence"):
        fa.realtime(fa.Plant(arm(), H), at, 20 * H, motion(), clock=False)
    assert other.result().sizes["tick"] == 1


@pytest.mark.parametrize("clock", [False, True])
def test_nobody_listens(clock):
    with pytest.raises(fa.SimulationError, match=r"no answer from 127.* for 0\.2 s") as error:
        fa.realtime(fa.Plant(arm(), H), free_address(), 0.1, clock=clock, timeout=0.2)
    assert error.value.time == 0.0
    assert error.value.result.sizes == {**error.value.result.sizes, "time": 1, "tick": 0}


def test_nobody_sends():
    with pytest.raises(fa.SimulationError, match=r"no packet at 127.* for 0\.2 s") as error:
        fa.realtime(free_address(), controller(), readings=READINGS, timeout=0.2)
    assert error.value.result.sizes["tick"] == 0


def test_packets_of_another_layout_and_another_sample_time():
    for options, message in (
        ({"readings": READINGS}, "has 112 bytes instead of 64: token, sequence number, time"),
        ({"readings": SENT}, "packet 1 has the time 0.002 s, but the controller"),
    ):
        at = free_address()
        other = Partner(fa.realtime, at, controller(), **options)
        with pytest.raises(fa.SimulationError, match="ended the run"):
            fa.realtime(fa.Plant(arm(), 2 * H), at, 0.1, motion(), clock=False)
        assert message in str(other.result())


def test_a_plant_that_fails_ends_the_run_of_its_controller():
    at = free_address()
    other = Partner(fa.realtime, at, controller(), readings=SENT)
    rising = [0.0, 5.5 * H, 5.6 * H, 1.0], [0.0, 0.0, 1.0, 1.0]
    plant = fa.Plant(arm(), H, loads=[fa.Load(link=1, force=(0.0, 1e200), factor=rising)])
    with pytest.raises(fa.SimulationError, match="no longer finite") as error:
        fa.realtime(plant, at, 20 * H, motion(), clock=False)
    assert error.value.result.sizes["tick"] == 5
    assert other.result().sizes["tick"] == 6


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"plant": 3.0}, "plant must be a Plant or an address"),
        ({"plant": "nowhere"}, "plant must be an object or an address such as '127.0.0.1:5005'"),
        ({"controller": "127.0.0.1:0"}, "controller must be an object or an address"),
        ({"controller": 3.0}, "controller must have the method reset"),
        ({"plant": "127.0.0.1:5005", "controller": "127.0.0.1:5005"}, "are both addresses"),
        ({"duration": None}, "duration is required with a plant"),
        ({"plant": "127.0.0.1:5005"}, "duration is determined by the plant"),
        ({"plant": "127.0.0.1:5005", "duration": None}, "readings is required"),
        ({"readings": READINGS}, "readings is only for a controller"),
        ({"clock": False, "answer_within": 1e-3}, "answer_within cannot be combined with clock"),
        ({"answer_within": 0.0}, "answer_within must be greater than 0"),
        ({"answer_within": 2 * H}, r"answer_within must be at most the sample time \(0\.001 s\)"),
        ({"duration": 101 * H}, r"duration must be at most that of the plant \(0\.1 s\)"),
        ({"timeout": 0.0}, "timeout must be"),
        ({"clock": 1}, "clock must be True or False"),
        ({"reference": 3.0}, "reference must have the methods joint_angle"),
        (
            {"controller": "127.0.0.1:5005", "reference": one_joint()},
            r"reference.joint_angle\(0.0\) must be numbers of shape \(2,\)",
        ),
    ],
)
def test_wrong_arguments_are_named(changed, message):
    plant = fa.Plant(arm(), H, duration=0.1)
    given = {"plant": plant, "controller": controller(), "duration": 0.1} | changed
    with pytest.raises(fa.InputError, match=message) as error:
        fa.realtime(**given)
    assert str(error.value).startswith("realtime: ")


@pytest.mark.parametrize(
    ("readings", "message"),
    [
        ({"joint_angel": 2, "joint_rate": 2}, "readings does not contain joint_angle, which Joint"),
        ({"joint_angle": 2}, "readings does not contain joint_rate, which JointPID reads"),
        (READINGS | {"reference_angle": 2}, "contain all of reference_angle, reference_rate, ref"),
    ],
)
def test_readings_that_do_not_fit_are_named(readings, message):
    with pytest.raises(fa.InputError, match=message):
        fa.realtime(free_address(), controller(), readings=readings, timeout=0.2)


@pytest.mark.thorough_cases("mu_synthesis")
@pytest.mark.parametrize("name", EXAMPLES)
def test_required_readings_are_those_of_the_arm(name):
    """The process of a controller has no arm of the plant."""
    one = EXAMPLES[name]()
    needed = requirements_of(one, two_links(), None).measured
    sizes = dict.fromkeys(needed[1:], 2)
    with pytest.raises(fa.InputError, match=f"does not contain {needed[0]}, which"):
        fa.realtime(free_address(), one, readings=sizes, timeout=0.2)


def test_controllers_that_do_not_fit_are_named():
    plant = fa.Plant(arm(), 2 * H)
    one = controller()
    with pytest.raises(fa.InputError, match=r"sample_time must equal that of the plant \(0\.002"):
        fa.realtime(plant, one, 0.1, motion())
    plant.step([0.0, 0.0])
    with pytest.raises(fa.InputError, match=r"plant must be at time zero, got 0\.002 s"):
        fa.realtime(plant, one, 0.1, motion())
    blind = fa.Plant(arm(), H, fa.Hardware(instruments=[fa.Instrument("joint_angle")]))
    with pytest.raises(fa.InputError, match="plant does not measure joint_rate, which JointPID"):
        fa.realtime(blind, one, 0.1, motion())
