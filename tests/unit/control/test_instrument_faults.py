"""Faults of instruments: what a controller reads before, during and after them."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.control.hardware.measurement import Readings
from flexarm.model import locate_study

TICK = 0.1


def read(instrument, values):
    """Return the readings (samples, k) of values (samples, k), one for each sample."""
    readings = Readings(instrument, TICK, np.random.default_rng(0))
    found = []
    for k, value in enumerate(np.asarray(values, dtype=float)):
        kept: dict[str, np.ndarray] = {}
        if readings.exact:
            found.append(value)
            continue
        readings.take(k, value)
        readings.write_available(k, kept)
        found.append(kept[instrument.label])
    return np.array(found)


VALUES = [[1.0, 10.0], [2.0, 20.0], [3.0, 30.0], [4.0, 40.0], [5.0, 50.0]]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (fa.InstrumentFault("bias", 0.5, start=0.2), [1.0, 2.0, 3.5, 4.5, 5.5]),
        (fa.InstrumentFault("bias", 0.5, start=0.1, end=0.3), [1.0, 2.5, 3.5, 4.0, 5.0]),
        (fa.InstrumentFault("drift", 2.0, start=0.2), [1.0, 2.0, 3.0, 4.2, 5.4]),
        (fa.InstrumentFault("gain", 0.0, start=0.3), [1.0, 2.0, 3.0, 0.0, 0.0]),
        (fa.InstrumentFault("gain", -1.0), [-1.0, -2.0, -3.0, -4.0, -5.0]),
        (fa.InstrumentFault("frozen", start=0.2, end=0.4), [1.0, 2.0, 2.0, 2.0, 5.0]),
    ],
    ids=["bias", "bias ends", "drift", "lost", "sign", "frozen"],
)
def test_readings_are_wrong_from_the_start_of_a_fault_to_its_end(fault, expected):
    found = read(fa.Instrument("joint_angle", faults=[fault]), VALUES)
    assert found[:, 0] == pytest.approx(expected)
    one = read(fa.Instrument("joint_angle", faults=[fault.replace(channel=1)]), VALUES)
    assert one[:, 0] == pytest.approx(expected)
    assert one[:, 1] == pytest.approx(np.array(VALUES)[:, 1])


def test_faults_act_in_order_before_resolution_and_limit():
    faults = [fa.InstrumentFault("bias", 0.3), fa.InstrumentFault("gain", 2.0)]
    instrument = fa.Instrument("joint_angle", resolution=1.0, limit=4.0, faults=faults)
    assert read(instrument, [[1.0], [2.0]])[:, 0].tolist() == [3.0, 4.0]


def arm():
    link = fa.Link(length=0.8, flexural_rigidity=20.0, mass_per_length=0.5, elements=1)
    return fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05, damping=0.1)])


@pytest.mark.thorough
def test_a_biased_encoder_moves_the_arm_by_its_bias():
    fault = fa.InstrumentFault("bias", 0.02)
    instruments = [fa.Instrument("joint_angle", faults=[fault]), fa.Instrument("joint_rate")]
    controller = fa.JointPID(20.0, 3.0, 40.0)
    reference = fa.joint_motion(arm(), [0.0], [0.3], 0.5)
    hardware = fa.Hardware(instruments)
    table = fa.compare(
        arm(),
        {"pid": controller},
        8.0,
        {"move": reference},
        {"healthy": arm(), "biased": (arm(), [hardware])},
        settling=4.0,
        rate=100.0,
        progress=False,
    )
    settled = table.tip_error_settled.squeeze()
    assert settled.sel(plant="healthy") < 1e-4
    # The integral brings the reading, not the angle, to the reference.
    assert settled.sel(plant="biased").item() == pytest.approx(0.8 * 0.02, rel=0.01)


STUDY = """\
flexarm: 1
arm:
  links: [{length: 0.8, flexural_rigidity: 20.0, mass_per_length: 0.5, elements: 1}]
  joints: [{hub_inertia: 0.05, damping: 0.1}]
motions:
  move: {kind: joint, start: [0.0], end: [0.3], duration: 0.5}
drives:
  pd: {kind: joint_pd, proportional: 20, derivative: 3}
  torque alone: {kind: rigid_inverse_dynamics}
plants:
  healthy: {}
  lost:
    hardware:
      instruments:
        - {signal: joint_angle, faults: [{kind: gain, size: 0.0, start: 0.3}]}
        - {signal: joint_rate}
run: {duration: 1.0, rate: 100}
"""


@pytest.mark.thorough
def test_a_plant_of_a_study_file_has_its_own_instruments(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    table = fa.run_study(path, progress=False)
    error = table.tip_error_peak.squeeze()
    assert error.sel(controller="pd", plant="lost") > 5.0 * error.sel(
        controller="pd", plant="healthy"
    )
    # A drive without feedback has no instruments.
    alone = error.sel(controller="torque alone").values
    assert alone[0] == alone[1]


def test_instruments_of_a_plant_that_do_not_fit_are_named(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.replace("signal: joint_rate", "signal: strain"))
    with pytest.raises(fa.ModelError, match=r"strain, but the arm has no gauges"):
        fa.run_study(path)


@pytest.mark.parametrize(
    ("signal", "count"),
    [
        ("joint_angle", 1),
        ("joint_rate", 1),
        ("joint_twist", 1),
        ("link_tip_slope", 1),
        ("tip", 2),
        ("tip_angle", 1),
        ("torque", 1),
        (fa.Sensor("velocity", link=1), 2),
    ],
)
def test_a_fault_of_a_channel_that_does_not_exist_is_named_before_the_run(signal, count):
    def hardware(channel):
        late = fa.InstrumentFault("gain", 0.0, start=5.0, channel=channel)
        names = ["joint_angle", "joint_rate"]
        exact = [fa.Instrument(name) for name in names if name != signal]
        return fa.Hardware([*exact, fa.Instrument(signal, faults=[late])])

    law = fa.JointPD(1.0, 1.0)
    fa.simulate(arm(), 0.01, controller=law, hardware=hardware(count), progress=False)
    rule = rf"faults\[0\]\.channel must be at most {count}, the number of readings"
    with pytest.raises(fa.InputError, match=rule):
        fa.simulate(arm(), 0.01, controller=law, hardware=hardware(count + 1), progress=False)


def test_a_channel_of_a_plant_of_a_study_is_checked(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.replace("start: 0.3}", "start: 0.3, channel: 2}"))
    with pytest.raises(fa.ModelError, match="channel must be at most 1"):
        locate_study(path)


def inverted(size=-1.0, **times):
    fault = fa.InstrumentFault("gain", size, **times)
    return fa.Hardware([fa.Instrument("joint_angle", faults=[fault]), fa.Instrument("joint_rate")])


def growth(hardware):
    law = fa.JointPD(20.0, 3.0)
    return fa.loop_margins(law, arm(), [0.0], hardware=hardware).growth.item()


def test_a_gain_fault_of_the_whole_run_belongs_to_the_loop():
    healthy = growth(inverted(1.0))
    assert healthy < 0.0
    assert growth(inverted(-1.0)) > 1.0
    assert growth(inverted(-1.0, channel=1)) > 1.0
    # Later and passing faults do not.
    assert growth(inverted(-1.0, start=1.0)) == healthy
    assert growth(inverted(-1.0, end=1.0)) == healthy
    # A lost or frozen reading is no feedback: the loop is that without a proportional gain.
    alone = fa.Hardware([fa.Instrument("joint_angle"), fa.Instrument("joint_rate")])
    open_loop = fa.loop_margins(fa.JointPD(0.0, 3.0), arm(), [0.0], hardware=alone).growth.item()
    assert growth(inverted(0.0)) == pytest.approx(open_loop, abs=1e-6)
    frozen = fa.Instrument("joint_angle", faults=[fa.InstrumentFault("frozen")])
    stuck = fa.Hardware([frozen, fa.Instrument("joint_rate")])
    assert growth(stuck) == pytest.approx(open_loop, abs=1e-6)


def test_a_run_with_an_inverted_sensor_warns_before_it_starts():
    with pytest.warns(fa.UnstableLoopWarning, match="the sampled loop is unstable at the start"):
        fa.simulate(
            arm(), 1.0, controller=fa.JointPD(20.0, 3.0), hardware=inverted(), progress=False
        )


def test_check_reports_a_loop_that_an_inverted_sensor_of_a_plant_makes_unstable(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY.replace("size: 0.0, start: 0.3", "size: -1.0"))
    found = PreparedStudy(*locate_study(path)).unstable_loops()
    assert list(found) == ["pd on lost along move"]
