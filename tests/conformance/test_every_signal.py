"""Every signal of instruments has the same value in readings, linear models and filters."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.linear.step_derivatives.sampled_step import FreeParameters
from flexarm.model.hardware import CHANNEL_SIGNALS, POINT_SIGNALS

TICK = 0.002
GRAVITY = np.array([0.3, -9.81])
NO_TORQUE = np.zeros(2)


def two_links():
    link = {"elements": 1, "gauges": [fa.Gauge(station=0.1, distance=0.005)]}
    return fa.Arm(
        links=[
            fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.5, **link),
            fa.Link(length=0.7, flexural_rigidity=20.0, mass_per_length=0.4, **link),
        ],
        joints=[
            fa.Joint(hub_inertia=0.05, damping=0.1),
            fa.Joint(mass=0.2, hub_inertia=0.02, rotor_inertia=0.02, stiffness=200.0),
        ],
        payload=fa.Payload(mass=0.3, inertia=0.01, offset=(0.05, 0.02)),
        gravity=GRAVITY.tolist(),
        theory="second_order",
    )


@pytest.fixture(scope="module")
def arm():
    return two_links()


@pytest.fixture(scope="module")
def state(arm):
    """Return coordinates and rates of the arm in motion."""
    q = arm.from_nodal([0.4, -0.8], [[[0.01, 0.02]], [[0.006, 0.012]]])
    return q, arm.from_nodal([1.2, -0.7], [[[0.05, 0.1]], [[-0.04, -0.05]]])


class Constant:
    """Requests constant torques."""

    sample_time = TICK

    def reset(self):
        pass

    def update(self, t, measurement, reference):
        return [0.5, 0.2]


def measured(arm, state, instrument, **options):
    hardware = fa.Hardware([instrument])
    start = {"initial": state[0], "initial_rate": state[1]}
    return fa.simulate(
        arm, 0.04, controller=Constant(), hardware=hardware, rate=1 / TICK, **start, **options
    )


# Channels ----------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.parametrize("signal", CHANNEL_SIGNALS)
def test_readings_equal_the_channel_of_the_result(signal, arm, state):
    x, y = arm.tip(state[0])[:2]
    speed = arm.tip_velocity(*state)[1]
    # The tip reaches the wall after half of the run.
    wall = fa.Wall((x, y + 0.02 * speed), (0.0, -np.sign(speed)))
    result = measured(arm, state, fa.Instrument(signal), contacts=[fa.Contact(wall, 1e4)])
    read, true = result[f"measured_{signal}"].values, result[signal].values[:-1]
    if signal == "torque":  # a reading precedes the torque that the controller requests from it
        assert not np.any(read[0])
        read, true = read[1:], true[:-1]
    # The channels are computed for all samples at once, with other roundings.
    np.testing.assert_allclose(read, true.reshape(read.shape), rtol=1e-12, atol=1e-12)
    assert np.any(read)


# Points ------------------------------------------------------------------------------------------


class Differences:
    """Motion of the tip by central differences of fourth order, without torques."""

    def __init__(self, arm, q, qd):
        step = 1e-3
        times = step * np.arange(-2, 3)
        qdd = arm.forward_dynamics(q, qd, NO_TORQUE)
        path = np.array([arm.tip(q + t * qd + t**2 / 2 * qdd)[:2] for t in times])
        self.position = path[2]
        self.velocity = np.array([1, -8, 0, 8, -1]) @ path / (12 * step)
        self.acceleration = np.array([-1, 16, -30, 16, -1]) @ path / (12 * step**2)
        root = arm.tip(q)[2] - arm.nodal(q)[1][-1, 1]  # angle of the root tangent of link 2
        self.turned = np.array([[np.cos(root), np.sin(root)], [-np.sin(root), np.cos(root)]])


#: The two components of each kind of `Sensor` in each of its frames.
READINGS = {
    ("position", "world"): lambda tip: tip.position,
    ("velocity", "world"): lambda tip: tip.velocity,
    ("acceleration", "world"): lambda tip: tip.acceleration,
    ("acceleration", "link"): lambda tip: tip.turned @ (tip.acceleration - GRAVITY),
}


def frames():
    """Yield every kind of sensor with every frame that it has."""
    for kind, frame in product(POINT_SIGNALS, ("world", "link")):
        try:
            fa.Sensor(kind, 2, frame=frame)
        except fa.ModelError:
            continue
        yield kind, frame


def test_every_point_signal_has_an_expected_reading():
    assert set(READINGS) == set(frames()), "add it to READINGS"


@pytest.mark.parametrize(("kind", "frame"), READINGS)
def test_sensor_of_a_point_has_the_same_value_everywhere(kind, frame, arm, state):
    sensor = fa.Sensor(kind, 2, frame=frame, name="point")
    expected = READINGS[kind, frame](Differences(arm, *state))
    instrument = fa.Instrument(sensor, noise=1e-9)
    values = {
        "reading": measured(arm, state, fa.Instrument(sensor)).measured_point.values[0],
        "linear model": fa.linearize(arm, *state, NO_TORQUE, outputs=[sensor]).output,
        "filter": predicted(arm, state, instrument),
    }
    for place, value in values.items():
        # Truncation: step^4 times the sixth derivatives of a motion of a few rad/s.
        np.testing.assert_allclose(value, expected, rtol=0, atol=1e-5, err_msg=place)


def predicted(arm, state, instrument):
    angle = fa.Instrument("joint_angle", noise=1e-9)
    readings = PredictedReadings(arm, [instrument, angle])
    constants = FreeParameters(arm, ["payload.mass"]).at()
    return readings.predict(np.concatenate(state), NO_TORQUE, constants).values[:2]
