"""Accelerometers, gyroscopes and joint accelerations of records: MuJoCo's sensors, closed forms."""

import re

import numpy as np
import pytest

import flexarm as fa
from flexarm.identification.record import Label, dataset_of
from flexarm.simulation.calls.inertial import inertial_channels

GRAVITY = 9.81
RATE = 200.0
#: Steps of MuJoCo in a sample: the damping of the stiffest spring is stable.
STEPS = 60


def clamped():
    link = fa.Link(length=0.8, flexural_rigidity=9.0, mass_per_length=0.5, elements=3)
    return fa.Arm(links=[link], joints=[fa.Joint(fixed=True)], gravity=(0.0, -GRAVITY))


def readings(arm, sensors, q, qd, **arguments):
    """Return the channels of one state, the first sample of a run."""
    states = np.repeat(np.stack([q, qd])[None], 3, axis=0)
    options = {"rate": 1000.0, "duration": 2e-3, **arguments}
    channels = inertial_channels(arm, sensors, states[:, 0], states[:, 1], **options)
    return {name: values[0] for name, values in channels.items()}


def test_accelerometers_of_a_sagging_beam_read_gravity_in_the_axes_of_its_sections():
    """The slopes of a clamped beam under its weight: (w x / 6 EI) (3 L^2 - 3 L x + x^2)."""
    arm, places = clamped(), np.array([0.0, 0.3, 0.8])
    q = fa.equilibrium(arm).q
    sensors = [fa.InertialSensor(link=1, station=x, angle=a) for x in places for a in (0.0, 1.2)]
    found = readings(arm, sensors, q, np.zeros(arm.dof))
    load = 0.5 * GRAVITY / 9.0
    slope = -load * places / 6.0 * (3.0 * 0.8**2 - 3.0 * 0.8 * places + places**2)
    axes = np.add.outer(slope, [0.0, 1.2]).ravel()
    assert np.abs(slope[-1]) > 0.04
    # Elements with cubic shapes have slopes within 1e-4 between their nodes; the nodes are exact.
    np.testing.assert_allclose(found["acceleration"], GRAVITY * np.sin(axes), atol=2e-3)
    np.testing.assert_allclose(found["angular_rate"], 0.0, atol=1e-12)


def test_a_turning_rigid_link():
    """Centripetal and tangential acceleration, gravity, and the torque over the inertia."""
    link = fa.Link(length=1.2, mass_per_length=0.8, flexible=False)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)], gravity=(0.0, -GRAVITY))
    angle, rate, torque, x = 0.4, 3.0, 5.0, 0.7
    sensors = [fa.InertialSensor(link=1, station=x, angle=a) for a in (0.0, 0.5 * np.pi)]
    torques = np.full((3, 1), torque)
    found = readings(arm, sensors, np.array([angle]), np.array([rate]), torque=torques)
    inertia = 0.1 + 0.8 * 1.2**3 / 3.0
    turning = (torque - 0.8 * 1.2**2 / 2.0 * GRAVITY * np.cos(angle)) / inertia
    along, across = GRAVITY * np.sin(angle), GRAVITY * np.cos(angle)
    exact = [along - rate**2 * x, across + turning * x]
    np.testing.assert_allclose(found["acceleration"], exact, rtol=1e-12)
    np.testing.assert_allclose(found["angular_rate"], rate, rtol=1e-14)
    np.testing.assert_allclose(found["joint_acceleration"], turning, rtol=1e-12)


def test_joints_that_follow_their_angles():
    """The prescribed acceleration, not that by a torque, acts on the sensors."""
    link = fa.Link(length=1.0, mass_per_length=0.8, flexible=False)
    arm = fa.Arm(links=[link, link])
    times = np.arange(101) * 0.01
    motion = fa.PrescribedAngle.table(times, times**2, "free")
    run = fa.simulate(arm, 1.0, prescribed={1: motion}, rate=100.0)
    sensor = fa.InertialSensor(link=1, angle=0.5 * np.pi)
    options = {"prescribed": {1: motion}, "rate": 100.0, "initial": np.zeros(2)}
    found = inertial_channels(arm, [sensor], run.q.values, run.qd.values, 1.0, **options)
    np.testing.assert_allclose(found["joint_acceleration"][:, 0], 2.0, atol=1e-9)
    np.testing.assert_allclose(found["acceleration"][:, 0], 2.0, atol=1e-9)
    # The tip of the first link, which carries the second one, moves as the link turns.
    np.testing.assert_allclose(found["angular_rate"][:, 0], 2.0 * times, atol=1e-9)


def arm_of(rigidity=20.0, payload=0.1):
    link = fa.Link(
        length=0.6,
        flexural_rigidity=rigidity,
        mass_per_length=0.5,
        damping=fa.RayleighDamping(stiffness_coefficient=2e-4),
        elements=3,
    )
    joint = fa.Joint(hub_inertia=0.02, damping=0.05)
    body = fa.Payload(mass=payload)
    gravity = (0.0, -GRAVITY)
    return fa.Arm(
        links=[link], joints=[joint], payload=body, gravity=gravity, theory="second_order"
    )


def bench(tmp_path):
    """Return a record of MuJoCo's sensors on the hub and the tip of a hanging link of five bars."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: no record to compare")
    text = fa.export_mjcf(arm_of(), tmp_path / "arm.xml", virtual_joints=5).read_text()
    text = re.sub(r'(<body name="link1_1".*?>)', r'\1<site name="hub" euler="0 0 0.7"/>', text)
    kinds = [f'<{kind} site="{x}"/>' for x in ("hub", "tip") for kind in ("accelerometer", "gyro")]
    model = mujoco.MjModel.from_xml_string(text.replace("<sensor>", "<sensor>" + "".join(kinds)))
    model.opt.timestep = 1.0 / (RATE * STEPS)
    data = mujoco.MjData(model)
    data.qpos[0] = -0.5 * np.pi
    times = np.arange(201) / RATE
    torques = np.sin(2.0 * np.pi * 1.3 * times) + 0.5 * np.sin(2.0 * np.pi * 6.0 * times)
    torques *= 0.5 * np.minimum(1.0, times / 0.2)
    rows = []
    for k in range(times.size):
        mujoco.mj_forward(model, data)  # the readings before the torque changes
        rows.append(np.r_[data.sensordata[:12], data.qpos[0], data.qacc[0]])
        data.ctrl[:] = torques[k]
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    table = np.array(rows)
    columns = {
        Label("torque", 1): torques,
        Label("joint_angle", 1): table[:, 12],
        Label("joint_acceleration", 1): table[:, 13],
        Label("acceleration", 1): table[:, 0],
        Label("angular_rate", 1): table[:, 5],
        Label("acceleration", 2): table[:, 6],
        Label("acceleration", 3): table[:, 7],
        Label("angular_rate", 3): table[:, 11],
    }
    sensors = [
        fa.InertialSensor(link=1, station=0.0, angle=0.7),
        fa.InertialSensor(link=1),
        fa.InertialSensor(link=1, angle=0.5 * np.pi),
    ]
    settings = {"interpolation": "hold", "sensors": sensors, "initial_angle": [-0.5 * np.pi]}
    return dataset_of(times, columns), settings


def test_sensors_of_mujoco(tmp_path):
    """A record of accelerometers and gyroscopes gives rigidity and payload, and then its fit."""
    data, settings = bench(tmp_path)
    record = fa.MeasuredRecord(data, outputs=["acceleration", "angular_rate"], **settings)
    free = ["links[0].flexural_rigidity", "payload.mass"]
    found = fa.identify(arm_of(24.0, 0.12), record, free, starts=1, progress=False)
    # The frequencies of the bars are within 1e-3, so that rigidities are within twice that.
    assert found[free[0]] == pytest.approx(20.0, rel=2e-3)
    assert found[free[1]] == pytest.approx(0.1, rel=2e-3)
    every = fa.identify(found.arm, fa.MeasuredRecord(data, **settings), [], progress=False)
    fits = every.fit["fit"].values[0]
    assert np.nanmin(fits) > 98.0, dict(zip(every.fit["channel"].values, fits, strict=True))


def test_sensors_that_do_not_exist_are_named(tmp_path):
    times = np.arange(5) * 0.1
    columns = {Label("torque", 1): times, Label("acceleration", 2): times}
    data = dataset_of(times, columns)
    with pytest.raises(fa.InputError, match="acceleration_2, but the record has 1 sensors"):
        fa.MeasuredRecord(data, sensors=[fa.InertialSensor(link=1)])
    far = [fa.InertialSensor(link=1), fa.InertialSensor(link=3)]
    record = fa.MeasuredRecord(data, sensors=far)
    with pytest.raises(fa.InputError, match=r"sensors\.link must be the number of a link"):
        fa.identify(arm_of(), record, [])
    controller = fa.JointPD([1.0], [1.0], sample_time=0.01)
    with pytest.raises(fa.InputError, match="acceleration is not supported with a controller"):
        fa.MeasuredRecord(data, controller=controller, sensors=far)
