"""The hardware of a scenario file: errors with their line, and the same run as in Python."""

from typing import get_args

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.linear.models.state_space import CHANNEL_OUTPUTS
from flexarm.model import locate_scenario
from flexarm.model.hardware import CHANNEL_SIGNALS, POINT_SIGNALS, Signal

ARM = """\
flexarm: 1
arm:
  links:
    - length: 0.8
      flexural_rigidity: 40.0
      mass_per_length: 0.5
      elements: 1
      gauges: [{station: 0.1, distance: 0.005}]
    - {length: 0.6, flexural_rigidity: 25.0, mass_per_length: 0.4, elements: 1}
  joints: [{hub_inertia: 0.05}, {hub_inertia: 0.03}]
motion: {kind: joint, start: [0.2, -0.4], end: [0.9, 0.5], duration: 0.3}
drive: {kind: joint_pd, proportional: [20, 8], derivative: [2, 0.8], sample_time: 0.002,
  reference: rigid, feedforward: none}
run: {duration: 0.4, rate: 500}
"""
HARDWARE = """\
hardware:
  seed: 3
  instruments:
    - {signal: joint_angle, resolution: 0.0001, rate_cutoff: 80}
    - {signal: strain, noise: 2e-6, bias: 1e-6}
    - {signal: tip, name: camera, sample_time: 0.02, delay: 0.03}
    - {signal: acceleration, link: 2, station: 0.3, frame: link, limit: 20}
  motors: {torque_limit: [3, 1], delay: 0.0005, time_constant: 0.001}
"""


def written(tmp_path, text):
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return path


@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")  # of the accelerometer
@pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning")  # the motors are slow
def test_same_run_as_in_python(tmp_path):
    from_file = fa.run_scenario(written(tmp_path, ARM + HARDWARE))
    arm = fa.load_arm(tmp_path / "scenario.yaml")
    point = fa.Sensor("acceleration", 2, 0.3, "link")
    hardware = fa.Hardware(
        [
            fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=80.0),
            fa.Instrument("strain", noise=2e-6, bias=1e-6),
            fa.Instrument("tip", name="camera", sample_time=0.02, delay=0.03),
            fa.Instrument(point, limit=20.0),
        ],
        fa.Motors(torque_limit=[3.0, 1.0], delay=0.0005, time_constant=0.001),
        seed=3,
    )
    by_hand = fa.simulate(
        arm,
        0.4,
        controller=fa.JointPD([20.0, 8.0], [2.0, 0.8], 0.002),
        reference=fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3),
        hardware=hardware,
        rate=500.0,
    )
    assert set(from_file.data_vars) == set(by_hand.data_vars)
    for name in by_hand.data_vars:
        np.testing.assert_array_equal(from_file[name], by_hand[name])
    assert abs(from_file.torque).max() <= 3.0
    # The file in the result has the same hardware.
    again = fa.run_scenario(written(tmp_path, from_file.attrs["scenario"]))
    np.testing.assert_array_equal(again.q, by_hand.q)


def test_signals_of_files_equal_those_of_python():
    assert set(CHANNEL_SIGNALS) == set(CHANNEL_OUTPUTS)
    assert set(get_args(Signal)) == {*CHANNEL_SIGNALS, *POINT_SIGNALS}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("signal: strain", "signal: strian", "scenario.yaml:19: hardware.instruments[1].signal"),
        ("noise: 2e-6", "noise: -1", "hardware.instruments[1].noise must be at least 0"),
        ("name: camera", "link: 1", "link is not supported for the signal tip"),
        ("link: 2,", "", "link is required for the signal acceleration"),
        ("link: 2,", "link: 3,", "link must be the number of a link, 1 to 2"),
        ("station: 0.3", "station: 0.7", "station must be at most 0.6"),
        ("name: camera", "name: strain", "name repeats"),
        ("[3, 1]", "[3, 1, 2]", "torque_limit must have length 2, one value for each joint"),
        ("[3, 1]", "-2", "torque_limit must be greater than 0"),
        ("delay: 0.0005", "current_limit: 2", "torque_constant is required with current_limit"),
        ("sample_time: 0.02,", "sample_time: 0.003,", "].sample_time must be a multiple of the"),
        ("seed: 3", "seed: -3", "hardware.seed must be at least 0"),
    ],
)
def test_problems_are_reported_with_their_place(tmp_path, old, new, words):
    text = ARM + HARDWARE.replace(old, new)
    assert text != ARM + HARDWARE
    with pytest.raises(fa.InputError) as caught:
        prepare(*locate_scenario(written(tmp_path, text)))  # also by "flexarm check"
    assert words in str(caught.value)
    assert "scenario.yaml:" in str(caught.value)
    assert len(caught.value.problems) == 1


def test_hardware_without_a_controller_is_rejected(tmp_path):
    drive = "\n".join(ARM.splitlines()[-3:-1])
    text = (ARM + HARDWARE).replace(drive, "drive: {kind: rigid_inverse_dynamics}")
    with pytest.raises(fa.InputError, match="hardware requires a controller as drive"):
        fa.run_scenario(written(tmp_path, text))
