"""Motors, instruments, joint stops and contacts at their limits: numbers and warnings of runs."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from controllers import Script
from random_arms import random_spec

TICK = 0.001
ENCODER = [fa.Instrument("joint_angle", resolution=2.0 * np.pi / 4096, rate_cutoff=100.0)]


def one_link(**spec):
    rod = {"flexural_rigidity": 100.0, "mass_per_length": 0.5, "elements": 2, "damping": 0.02}
    return chain([1.0], [0.05], **rod, **spec)


def limited(**motors):
    return fa.Hardware(ENCODER, motors=fa.Motors(**motors))


def texts(*arguments, **options):
    """Simulate; return the result, and the texts of its warnings about limits."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fa.simulate(*arguments, **options)
    return result, [str(w.message) for w in caught if w.category is fa.LimitWarning]


class NoAntiWindup(fa.Controller):
    """The step of joint PID of one joint without a limit."""

    def __init__(self, *gains, sample_time):
        self._law, self.sample_time = fa.JointPID(*gains, sample_time=sample_time), sample_time

    def initial_memory(self, readings, inputs):
        return self._law.initial_memory(readings, inputs)

    def step(self, memory, readings, inputs):
        return self._law.step(memory, readings, inputs)


def test_windup_of_a_saturated_motor_is_reported():
    """Joint PID knows the limit of the motor during the run, which stops its integral.

    The motion is too fast for the motor all the same.
    """
    arm = one_link()
    motion = fa.joint_motion(arm, [0.0], [1.0], 0.2)
    gains = 30.0, 6.0, 100.0

    def run(law):
        hardware = limited(torque_limit=1.0)
        return texts(arm, 8.0, controller=law, reference=motion, hardware=hardware, rate=100.0)

    wound, warned = run(NoAntiWindup(*gains, sample_time=0.004))
    assert abs(wound.joint_angle[-1, 0] - 1.0) > 20.0
    assert len(warned) == 1
    assert "motor 1 is at its limit" in warned[0]
    assert "an integral that stops at the limit" in warned[0]
    assert warned[0] in wound.attrs["warning"]
    assert wound.saturation[0] > 0.9
    assert wound.longest_saturation[0] > 3.0
    law = fa.JointPID(*gains, sample_time=0.004)
    kept, warned = run(law)
    assert abs(kept.joint_angle[-1, 0] - 1.0) < 0.01
    assert len(warned) == 1
    assert "integral" not in warned[0]
    assert 0.9 > kept.saturation[0] > 0.2
    assert law.torque_limit == np.inf  # as before the run
    same, _ = run(fa.JointPID(*gains, torque_limit=1.0, sample_time=0.004))
    assert same.joint_angle.equals(kept.joint_angle)


def test_limits_that_are_handed_to_a_law():
    """A limit of its own that is larger is reduced, joint by joint, and restored."""
    arm = fa.Arm(links=[fa.Link(length=0.5, flexible=False, mass_per_length=1.0)] * 2)
    motion = fa.joint_motion(arm, [0.0, 0.0], [1.0, 0.5], 0.2)
    motors = limited(torque_limit=[1.0, 0.5])
    peaks = []
    for limit in (np.inf, [np.inf, 0.4], 100.0, [1.0, 0.4]):
        law = fa.JointPID(30.0, 6.0, 100.0, torque_limit=limit)
        run, _ = texts(arm, 0.5, controller=law, reference=motion, hardware=motors)
        peaks.append(np.abs(run.torque_command.values).max(axis=0).tolist())
        np.testing.assert_array_equal(law.torque_limit, limit)
    assert peaks == [[1.0, 0.5], [1.0, 0.4], [1.0, 0.5], [1.0, 0.4]]


def test_a_braking_motor_exceeds_its_torque_at_rest():
    """Back electromotive force helps to brake: a voltage is no limit that a law can have."""
    arm = fa.Arm(links=[fa.Link(length=0.5, flexible=False, mass_per_length=1.0)])
    winding = fa.Motors(torque_constant=1.0, resistance=1.0, voltage_limit=3.0)
    initial = {"initial": [0.0], "initial_rate": [1.5]}
    for law in (fa.JointPD(0.0, 2.5), fa.JointPID(0.0, 2.5)):
        run, _ = texts(arm, 0.05, controller=law, hardware=fa.Hardware(motors=winding), **initial)
        assert run.torque.values[0, 0] == pytest.approx(-3.75)
        assert run.saturation.item() == 0.0


def test_other_limits_of_a_users_law_stay_as_they_are():
    @dataclass(frozen=True)
    class Frozen:
        sample_time: float = TICK
        torque_limit: None = None

        def reset(self):
            pass

        def update(self, t, measurement, reference):
            return [2.0 - measurement.joint_angle[0]]

    run, _ = texts(one_link(), 0.02, controller=Frozen(), hardware=limited(torque_limit=1.0))
    assert run.saturation.item() == 1.0


def test_numbers_of_saturated_motors():
    """Two motors; the second one waits for its command and is never at its limit."""
    arm = fa.Arm(links=[fa.Link(length=0.5, flexible=False, mass_per_length=1.0)] * 2)
    rows = np.zeros((40, 2))
    rows[5:10, 0], rows[20:32, 0], rows[:, 1] = 3.0, -2.5, 1.9
    for delay in (0.0, 0.0025):
        hardware = fa.Hardware(motors=fa.Motors(torque_limit=2.0, delay=delay, time_constant=TICK))
        run = fa.simulate(arm, 0.04, controller=Script(rows, TICK), hardware=hardware)
        np.testing.assert_allclose(run.saturation, [17 / 40, 0.0], rtol=1e-9)
        np.testing.assert_allclose(run.longest_saturation, [0.012, 0.0], rtol=1e-9)
        assert run.saturation.attrs["units"] == "1"
        assert run.longest_saturation.attrs["units"] == "s"
    assert "saturation" not in fa.simulate(arm, 0.04, controller=Script(rows, TICK))


@pytest.mark.thorough
def test_a_bounded_limit_gives_no_warning():
    """A step and a motion too fast for the motor: saturated from the start, and both arrive."""
    arm = one_link()
    law, hardware = fa.JointPD(60.0, 12.0), limited(torque_limit=2.0)
    for reference in (fa.joint_motion(arm, [0.0], [1.0], 0.5), None):
        start = None if reference else arm.rest([1.0])
        run, warned = texts(
            arm,
            3.0,
            controller=law,
            reference=reference,
            hardware=hardware,
            initial=start,
        )
        assert not warned
        if reference is not None:
            assert run.saturation[0] > 0.1


def test_a_motor_too_weak_for_gravity_is_reported():
    arm = one_link(gravity=(0.0, -9.81))
    law, hold = fa.JointPD(60.0, 12.0), fa.joint_motion(arm, [0.0], [0.3], 0.5)
    _, warned = texts(arm, 2.0, controller=law, reference=hold, hardware=limited(torque_limit=1.0))
    assert len(warned) == 1
    assert "stronger motor" in warned[0]
    assert "torque_limit" not in warned[0]  # a PD has no integral, and no argument for it


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning")
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_warnings_agree_with_the_harm_on_random_arms():
    """Harm: the error with the limit, over the larger of the travel and the error without it.

    Gains suit the arm, limits are 0.1 to 3 times the largest torque without them.
    """
    rng = np.random.default_rng(11)
    counts = {True: 0, False: 0}
    for _ in range(24):
        arm = fa.Arm(random_spec(rng, links=1, rigid=True, gravity=None))
        inertia = float(arm.mass_matrix(arm.rest([0.0]))[0, 0])
        pace = float(rng.uniform(3.0, 12.0))
        gains = inertia * pace**2, 1.4 * inertia * pace, inertia * pace**3 * rng.choice([0.0, 0.3])
        motion = fa.joint_motion(
            arm, [0.0], [float(rng.uniform(0.2, 2.0))], float(rng.uniform(2, 9)) / pace
        )
        options = {
            "reference": motion,
            "rate": 100.0,
            "controller": fa.JointPID(*gains, sample_time=0.02 / pace),
        }
        free = fa.simulate(arm, 30.0 / pace, **options)
        limit = float(abs(free.torque).max() * np.exp(rng.uniform(np.log(0.1), np.log(3.0))))
        run, warned = texts(
            arm,
            30.0 / pace,
            hardware=limited(torque_limit=limit),
            **options,
        )
        wanted = motion.joint_angle(run.time.values)
        errors = [float(abs(one.joint_angle.values - wanted).max()) for one in (run, free)]
        harm = errors[0] / max(errors[1], float(np.ptp(wanted)))
        counts[bool(warned)] += 1
        if warned:
            assert harm > 0.5
            assert run.saturation[0] > 0.05
        else:
            assert harm < 1.2
    assert min(counts.values()) >= 5  # both answers occur


def test_instruments_at_their_limits():
    arm = one_link()
    motion = fa.joint_motion(arm, [0.0], [1.0], 0.5)
    law = fa.JointPD(60.0, 12.0)
    free = fa.simulate(arm, 1.0, controller=law, reference=motion)
    fast = abs(free.joint_rate.values[:-1, 0])
    for share, expected in ((0.05, False), (0.3, True)):
        limit = float(np.quantile(fast, 1.0 - share))
        instruments = [*ENCODER, fa.Instrument("joint_rate", "gyro", limit=limit)]
        run, warned = texts(
            arm,
            1.0,
            controller=law,
            reference=motion,
            hardware=fa.Hardware(instruments),
        )
        beyond = abs(run.measured_gyro.values[:, 0]) >= limit
        assert run.instrument.values.tolist() == ["gyro"]
        assert float(run.reading_saturation[0]) == pytest.approx(beyond.mean())
        edges = np.flatnonzero(np.diff(np.concatenate([[0], beyond, [0]])))
        longest = np.diff(edges)[::2].max() * law.sample_time
        assert float(run.longest_reading_saturation[0]) == pytest.approx(longest)
        assert bool(warned) == expected
        assert all("the instrument 'gyro'" in text for text in warned)


@pytest.mark.parametrize("length", [1e-4, 1.0, 100.0])
def test_stops_of_slides_are_judged_by_the_arm(length):
    link = fa.Link(length=0.5 * length, mass_per_length=2.0, flexible=False)
    for stiffness, warns in ((50.0, True), (2e3, False)):
        limits = fa.JointLimits(
            lower=-0.3 * length, upper=0.3 * length, stiffness=stiffness * length
        )
        arm = fa.Arm(links=[link], joints=[fa.Joint(kind="prismatic", limits=limits)])
        with warnings.catch_warnings(record=True) as log:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", fa.ImplausibleValueWarning)
            run = fa.simulate(arm, 1.5, torque=lambda t: [5.0 * length**2])
        assert run.stop_depth.units == "m"
        # Energy: the force times the path from the middle is that of the spring.
        depth = (5.0 + np.sqrt(25.0 + 3.0 * stiffness)) / stiffness * length
        assert float(run.stop_depth[0]) == pytest.approx(depth, rel=0.01)
        expected = f"joint 1 slides {depth:.3g} m beyond its stop, {depth / length / 0.6:.0%} of"
        assert [expected in str(item.message) for item in log] == [True] * warns


def test_joint_stops():
    limits = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=2000.0)
    link = fa.Link(length=1.0, flexible=False, mass_per_length=1.0)
    arm = fa.Arm(links=[link, link], joints=[fa.Joint(limits=limits), fa.Joint(damping=5.0)])
    run, warned = texts(arm, 3.0, initial_rate=arm.rest([2.0, 0.0]))
    angle = run.joint_angle.values[:, 0]
    assert float(run.stop_depth[0]) == pytest.approx(abs(angle).max() - 0.5)
    assert run.stop_hits[0] == np.sum(np.diff((abs(angle) > 0.5).astype(int)) > 0) >= 2
    assert np.isnan([run.stop_depth[1], run.stop_hits[1]]).all()
    assert not warned
    # Most impacts are shorter than the time between two samples.
    for rate in (10.0, 4.0):
        rare = fa.simulate(arm, 3.0, initial_rate=arm.rest([2.0, 0.0]), rate=rate)
        assert rare.stop_hits[0] == run.stop_hits[0]
    joints = [fa.Joint(limits=limits.replace(stiffness=10.0)), fa.Joint(damping=5.0)]
    soft = fa.Arm(links=[link, link], joints=joints)
    _, warned = texts(soft, 3.0, initial_rate=arm.rest([2.0, 0.0]))
    assert ["beyond its stop" in text for text in warned] == [True]


def test_depth_of_contacts():
    arm = one_link()
    rates = arm.rest([1.0])
    for stiffness, expected in ((1e4, False), (1.0, True)):
        wall = fa.Contact(fa.Wall((0.0, 0.2), (0.0, -1.0)), stiffness)
        run, warned = texts(arm, 0.6, initial_rate=rates, contacts=[wall])
        assert float(run.contact_depth[0]) == pytest.approx(-float(run.contact_gap.min()))
        assert ["deep in its surface" in text for text in warned] == [True] * expected
    post = fa.Contact(fa.RoundWall((0.98, 0.2), 0.02), 1000.0)
    _, warned = texts(arm, 0.3, initial_rate=rates, contacts=[post])
    assert len(warned) == 1


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")
def test_batches_have_the_numbers_of_single_runs():
    arm = one_link()
    motion = fa.joint_motion(arm, [0.0], [1.0], 0.2)
    instruments = [*ENCODER, fa.Instrument("joint_rate", "gyro", limit=0.5)]
    hardware = fa.Hardware(instruments, motors=fa.Motors(torque_limit=1.0))
    starts = [arm.rest([0.1 * k]) for k in range(9)]
    law = fa.JointPID(60.0, 12.0, 200.0)
    options = {"controller": law, "reference": motion, "hardware": hardware, "rate": 200.0}
    batch = fa.simulate_batch(arm, 2.0, initial=starts, **options)
    for k in (0, 4, 8):
        single = fa.simulate(arm, 2.0, initial=starts[k], **options)
        for name in ("saturation", "longest_saturation", "reading_saturation"):
            np.testing.assert_array_equal(batch[name][k], single[name])
            assert batch[name].attrs == single[name].attrs
        assert batch.instrument.values.tolist() == ["gyro"]
        assert batch.warning[k] == single.attrs["warning"]
    assert "motor 1" in str(batch.warning[0].item())
    table = fa.compare(arm, {"pid": law}, 2.0, {"step": motion}, hardware=hardware, rate=200.0)
    assert float(table.saturation.squeeze()) == float(batch.saturation[0, 0])
    assert "motor 1" in table.warning.item()


def test_plant_reports_motors_at_their_limits():
    plant = fa.Plant(one_link(), TICK, limited(torque_limit=1.0))
    for torque, expected in ((0.5, False), (-2.0, True), (0.9, False)):
        plant.step([torque])
        assert plant.saturated.tolist() == [expected]
    assert not fa.Plant(one_link()).saturated.any()
