"""Event times against closed forms, for every integrator and every drive."""

import numpy as np
import pytest
from scipy.special import ellipk

import flexarm as fa
from arms import table_one_arm
from flexarm.integrate import INTEGRATORS

LENGTH, DENSITY, GRAVITY = 0.7, 0.5, 9.81
INERTIA = DENSITY * LENGTH**3 / 3.0


def rod(**options):
    """Return one rigid link: a physical pendulum, or a wheel without gravity."""
    link = fa.Link(length=LENGTH, flexural_rigidity=1.0, mass_per_length=DENSITY, flexible=False)
    return fa.Arm(links=[link], **options)


def by_name(result, name):
    return result.event_time.values[result.event_name.values == name]


def pendulum_events(swing, **options):
    """Return times at which a pendulum, released at an angle, is lowest, and at which it turns."""
    arm = rod(gravity=(0.0, -GRAVITY))
    events = [
        fa.joint_event(arm, 1, -np.pi / 2, name="lowest"),
        fa.Event(lambda t, q, qd: qd[0], name="turns"),
    ]
    result = fa.simulate(arm, 4.0, initial=arm.rest([swing - np.pi / 2]), events=events, **options)
    quarter = np.sqrt(2.0 * LENGTH / (3.0 * GRAVITY)) * ellipk(np.sin(swing / 2.0) ** 2)
    return result, quarter


@pytest.mark.sampled(
    "20.0-gauss_6",
    "20.0-rk4",
    "20.0-cowell_4",
    "20.0-generalized_alpha",
    "1000.0-kennedy_carpenter_5",
    "1000.0-dormand_prince_8",
)
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("rate", [1000.0, 20.0])
def test_pendulum_passes_and_turns_at_quarter_periods(integrator, rate):
    fixed = not INTEGRATORS[integrator].adaptive
    options = {"step": 1e-3} if fixed else {"rtol": 1e-10, "atol": 1e-12}
    result, quarter = pendulum_events(2.5, integrator=integrator, rate=rate, **options)
    count = int(4.0 / quarter)
    expected = quarter * np.arange(1, count + 1)
    # Ten times the largest error of the methods at these settings; order 2 has much larger ones.
    found = 2e-8 if INTEGRATORS[integrator].order > 2 else 1e-4
    np.testing.assert_allclose(result.event_time, expected, rtol=0.0, atol=found)
    assert result.event_name.values.tolist() == (["lowest", "turns"] * count)[:count]
    assert result.event_direction.values.tolist() == ([-1, 1, 1, -1] * count)[:count]
    # The state is that of the event: at the bottom, and at rest; rates are of order 10.
    lowest = result.event_name.values == "lowest"
    np.testing.assert_allclose(result.event_q.values[lowest, 0], -np.pi / 2, atol=1e-10)
    np.testing.assert_allclose(result.event_qd.values[~lowest, 0], 0.0, atol=1e-10)
    assert result.attrs["ended_by"] == "duration"


def test_times_converge_with_the_tolerance():
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8):
        result, quarter = pendulum_events(
            2.5, integrator="dormand_prince_8", rtol=rtol, atol=rtol / 100, rate=50.0
        )
        expected = quarter * np.arange(1, result.sizes["event"] + 1)
        errors.append(abs(result.event_time.values - expected).max())
    # In proportion to the tolerance; the factor of five allows for chance.
    assert errors[1] < 0.05 * errors[0]
    assert errors[2] < 0.05 * errors[1]
    assert errors[2] < 1e-7


@pytest.mark.thorough
def test_times_do_not_depend_on_the_rate():
    """They are located by repeated steps, not by interpolation between samples 50 ms apart."""
    coarse, _ = pendulum_events(2.5, rate=20.0)
    fine, _ = pendulum_events(2.5, rate=5000.0)
    np.testing.assert_allclose(coarse.event_time, fine.event_time, rtol=0.0, atol=1e-8)


def test_free_rotation_reaches_angles_at_exact_times():
    arm = rod()
    angles = [0.3, 1.0, 2.7]
    events = [fa.joint_event(arm, 1, angle, name=f"{angle}") for angle in angles]
    result = fa.simulate(arm, 1.0, initial_rate=[3.0], events=events, rate=64.0)
    np.testing.assert_allclose(result.event_time, np.array(angles) / 3.0, rtol=1e-11)
    assert result.event_name.values.tolist() == ["0.3", "1.0", "2.7"]


def test_tip_crosses_a_line_at_the_exact_angles():
    """The line y = x / 2 + 0.1 is crossed in both directions."""
    arm = rod()
    event = fa.tip_event(arm, point=(0.0, 0.1), normal=(-0.5, 1.0), name="line")
    result = fa.simulate(arm, 2.0 * np.pi, initial_rate=[1.0], events=[event], rate=100.0)
    # L sin(a) - L cos(a) / 2 = 0.1: an angle of R sin(a - b) with tan b = 1 / 2.
    shift = np.arctan(0.5)
    part = np.arcsin(0.1 / (LENGTH * np.hypot(1.0, 0.5)))
    expected = [shift + part, shift + np.pi - part]
    np.testing.assert_allclose(result.event_time, expected, rtol=1e-10)
    assert result.event_direction.values.tolist() == [1, -1]
    # The function is a distance in metres: only the direction of the normal matters.
    assert event.function(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)))[0] == pytest.approx(
        -(0.5 * LENGTH + 0.1) / np.hypot(1.0, 0.5)
    )


def test_times_of_bounces_equal_their_closed_form():
    """A constant torque drives a rod against a wall; each impact multiplies its rate by -e."""
    arm = rod()
    torque, restitution, start = -2.0, 0.7, 0.4
    acceleration = torque / INERTIA
    wall = fa.joint_event(arm, 1, 0.0, name="wall", direction=-1, terminal=True)
    angle, rate, times, time = [start], [0.0], [], 0.0
    for _ in range(8):
        result = fa.simulate(
            arm,
            5.0,
            torque=lambda t: [torque],
            initial=angle,
            initial_rate=rate,
            events=[wall],
            rate=200.0,
        )
        assert result.attrs["ended_by"] == "wall"
        time += float(result.time[-1])
        times.append(time)
        angle, rate = result.q.values[-1], -restitution * result.qd.values[-1]
    first = np.sqrt(2.0 * start / -acceleration)
    flights = 2.0 * first * restitution ** np.arange(1, 8)
    expected = first + np.concatenate([[0.0], np.cumsum(flights)])
    np.testing.assert_allclose(times, expected, rtol=1e-9)


def test_joint_reaches_and_leaves_its_stop():
    limits = fa.JointLimits(lower=-1.0, upper=0.5, stiffness=50.0)
    arm = rod(joints=[fa.Joint(limits=limits)])
    event = fa.joint_event(arm, 1, "upper", name="stop")
    result = fa.simulate(arm, 2.0, initial_rate=[2.0], events=[event])
    frequency = np.sqrt(50.0 / INERTIA)
    # The corner of the stop is rounded over 1e-6 rad.
    np.testing.assert_allclose(
        result.event_time[:2], [0.25, 0.25 + np.pi / frequency], atol=2e-6, rtol=0.0
    )
    assert result.event_direction.values.tolist()[:2] == [1, -1]
    lower = fa.joint_event(arm, 1, "lower", terminal=True)
    result = fa.simulate(arm, 3.0, initial_rate=[2.0], events=[lower])
    assert float(result.time[-1]) == pytest.approx(0.25 + np.pi / frequency + 0.75, abs=1e-5)


def test_terminal_event_is_the_last_sample():
    arm = rod()
    events = [
        fa.joint_event(arm, 1, 0.4, name="soon"),
        fa.joint_event(arm, 1, 1.0, name="end", terminal=True),
        fa.joint_event(arm, 1, 1.0001, name="never"),
    ]
    result = fa.simulate(arm, 5.0, initial_rate=[2.0], events=events, rate=100.0)
    assert result.attrs["ended_by"] == "end"
    assert result.event_name.values.tolist() == ["soon", "end"]
    assert float(result.time[-1]) == float(result.event_time[-1]) == pytest.approx(0.5, rel=1e-12)
    assert np.all(np.diff(result.time) > 0.0)
    np.testing.assert_array_equal(result.q[-1], result.event_q[-1])
    np.testing.assert_array_equal(result.qd[-1], result.event_qd[-1])


def test_terminal_event_after_the_last_sample():
    """Samples at 0, 0.1, ..., 0.9; the run lasts until 0.95 and the event is at 0.93."""
    arm = rod()
    event = fa.joint_event(arm, 1, 0.93, terminal=True)
    result = fa.simulate(arm, 0.95, initial_rate=[1.0], events=[event], rate=10.0)
    assert result.time.values == pytest.approx([*np.arange(10) / 10, 0.93])
    assert result.tip.values[-1] == pytest.approx(LENGTH * np.array([np.cos(0.93), np.sin(0.93)]))
    assert result.attrs["ended_by"] == "event_1"


def test_event_at_a_sample_is_counted_once():
    arm = rod()
    # Exact in binary: the angle at the sample of t = 0.5 is zero, or zero to rounding.
    event = fa.Event(lambda t, q, qd: t - 0.5, name="half")
    result = fa.simulate(arm, 1.0, initial_rate=[2.0], events=[event], rate=64.0)
    assert by_name(result, "half").tolist() == [0.5]
    last = fa.Event(lambda t, q, qd: t - 0.5, terminal=True)
    result = fa.simulate(arm, 1.0, initial_rate=[2.0], events=[last], rate=64.0)
    assert result.sizes["time"] == 33
    assert float(result.time[-1]) == 0.5


def test_start_at_zero_is_not_an_event():
    arm = rod()
    event = fa.joint_event(arm, 1, 0.0)
    result = fa.simulate(arm, 1.0, initial_rate=[1.0], events=[event])
    assert result.sizes["event"] == 0


def test_events_between_two_samples_are_in_order():
    arm = rod()
    order = [0.57, 0.52, 0.55, 0.59]
    events = [
        fa.joint_event(arm, 1, angle, name=str(angle), terminal=angle == 0.57) for angle in order
    ]
    result = fa.simulate(arm, 1.0, initial_rate=[1.0], events=events, rate=10.0)
    assert result.event_name.values.tolist() == ["0.52", "0.55", "0.57"]
    np.testing.assert_allclose(result.event_time, [0.52, 0.55, 0.57], rtol=1e-12)
    assert result.attrs["ended_by"] == "0.57"


@pytest.mark.parametrize(("direction", "expected"), [(0, 4), (1, 2), (-1, 2)])
def test_direction(direction, expected):
    arm = rod()
    event = fa.Event(lambda t, q, qd: np.sin(q[0]) + 0.2, direction=direction)
    result = fa.simulate(arm, 4.0 * np.pi, initial_rate=[1.0], events=[event], rate=50.0)
    assert result.sizes["event"] == expected
    if direction:
        assert set(result.event_direction.values) == {direction}


@pytest.mark.thorough
def test_tangent_zero_is_not_a_crossing_and_short_crossings_need_the_rate():
    arm = rod()

    def dip(depth):
        # Below zero for 2 sqrt(depth) around 0.5003 rad, not at a sample.
        return fa.Event(lambda t, q, qd: (q[0] - 0.5003) ** 2 - depth)

    run = {"initial_rate": [1.0], "rate": 100.0}
    assert fa.simulate(arm, 1.0, events=[dip(0.0)], **run).sizes["event"] == 0
    assert fa.simulate(arm, 1.0, events=[dip(1e-8)], **run).sizes["event"] == 0
    run["rate"] = 20000.0
    result = fa.simulate(arm, 1.0, events=[dip(1e-8)], **run)
    np.testing.assert_allclose(result.event_time, [0.5002, 0.5004], rtol=1e-9)
    assert result.event_direction.values.tolist() == [-1, 1]


class Steps:
    """A controller that returns another torque at each sample, for any readings."""

    sample_time = 0.01

    def reset(self):
        self.ticks = 0

    def update(self, t, measurement, reference):
        self.ticks += 1
        return [self.torque(self.ticks - 1)]

    @staticmethod
    def torque(tick):
        return 0.5 + 0.4 * np.cos(3.0 * tick)


@pytest.mark.parametrize("rate", [7.0, 100.0, 1000.0])
@pytest.mark.parametrize("integrator", ["auto", "rk4", "kennedy_carpenter_5"])
def test_closed_loop_events_use_the_constant_torque(rate, integrator):
    """The angle is a parabola in each sample time; results have a higher or a lower rate."""
    arm = rod()
    h, angle, speed = Steps.sample_time, 0.0, 0.0
    for tick in range(200):
        acceleration = Steps.torque(tick) / INERTIA
        if angle + h * speed + 0.5 * h * h * acceleration >= 1.0:
            break
        angle, speed = angle + h * speed + 0.5 * h * h * acceleration, speed + h * acceleration
    part = (-speed + np.sqrt(speed**2 + 2.0 * acceleration * (1.0 - angle))) / acceleration
    event = fa.joint_event(arm, 1, 1.0, name="there", terminal=True)
    controller = Steps()
    result = fa.simulate(
        arm, 2.0, controller=controller, events=[event], rate=rate, integrator=integrator
    )
    # 1e-7 of the angle's change in a sample time, over its speed.
    assert float(result.event_time[0]) == pytest.approx(tick * h + part, abs=1e-9)
    assert float(result.time[-1]) == float(result.event_time[0])
    assert result.torque.values[-1, 0] == Steps.torque(tick)
    assert result.attrs["ended_by"] == "there"
    assert controller.ticks == tick + 1


@pytest.mark.thorough
def test_prescribed_joint_and_a_load_over_time():
    """Joint 1 is prescribed; a load acts on the other; compared with a run at tight tolerances."""
    arm = table_one_arm(gravity=(0.0, -9.81), rigidity=2000.0)
    swing = fa.PrescribedAngle(
        lambda t: 0.5 * np.sin(3.0 * t),
        lambda t: 1.5 * np.cos(3.0 * t),
        lambda t: -4.5 * np.sin(3.0 * t),
    )
    push = fa.Load(link=2, force=(0.0, 3.0), factor=lambda t: np.cos(5.0 * t))

    def run(**options):
        events = [
            fa.joint_event(arm, 1, 0.3, name="told"),
            fa.joint_event(arm, 2, -1.0, name="free"),
            fa.tip_event(arm, (0.0, 0.0), (0.0, 1.0), name="low"),
        ]
        return fa.simulate(arm, 2.0, prescribed={1: swing}, loads=[push], events=events, **options)

    result, tight = run(rate=50.0), run(rtol=1e-12, atol=1e-14)
    first = np.arcsin(0.6) / 3.0
    expected = [first, np.pi / 3.0 - first]
    assert by_name(result, "told") == pytest.approx(expected, abs=1e-7)
    assert result.event_name.values.tolist() == tight.event_name.values.tolist()
    assert {"free", "low"} < set(result.event_name.values)
    np.testing.assert_allclose(result.event_time, tight.event_time, atol=1e-7, rtol=0.0)


@pytest.mark.sampled("generalized_alpha")
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_flexible_arm_with_every_integrator(integrator):
    """The tip crosses a line, and a mode crosses zero many times; compared with a run at tight
    tolerances."""
    arm = table_one_arm()

    def torque(t):
        return [4.0 * np.sin(6.0 * t), 1.5 * np.sin(6.0 * t)]

    def run(**options):
        events = [
            fa.tip_event(arm, (0.0, 0.9), (0.3, 1.0)),
            fa.Event(lambda t, q, qd: q[arm.joint_index[0] + 1], name="straight"),
        ]
        return fa.simulate(
            arm, 1.5, torque=torque, initial=arm.rest([0.8, -1.5]), events=events, **options
        )

    tight = run(rtol=1e-12, atol=1e-14)
    assert {"event_1", "straight"} == set(tight.event_name.values)
    step = None if INTEGRATORS[integrator].adaptive else 1e-4
    result = run(integrator=integrator, rtol=1e-8, atol=1e-10, step=step, rate=100.0)
    assert result.event_name.values.tolist() == tight.event_name.values.tolist()
    # Tip errors of 1e-7 m at speeds of 1 m/s.
    late = np.full(result.sizes["event"], 1e-6)
    if INTEGRATORS[integrator].order == 2:
        # A vibration of w rad/s has a phase error of the part (w h)^2 / 12 of the time; the third,
        # of 295 rad/s here, is the fastest that matters in the mode, which hardly moves the tip.
        straight = result.event_name.values == "straight"
        late[straight] = (295.0 * step) ** 2 / 12.0 * result.event_time.values[straight]
    assert np.all(abs(result.event_time.values - tight.event_time.values) < late)


def test_events_do_not_change_the_run():
    arm = table_one_arm()
    options = {"initial": arm.rest([0.3, 0.4]), "torque": lambda t: [np.sin(9.0 * t), 0.2]}
    plain = fa.simulate(arm, 0.5, **options)
    events = [fa.joint_event(arm, 1, 0.35), fa.Event(lambda t, q, qd: qd[0])]
    watched = fa.simulate(arm, 0.5, events=events, **options)
    assert watched.sizes["event"] > 0
    for name in plain.data_vars:
        np.testing.assert_array_equal(watched[name], plain[name])
    assert "event" not in plain.sizes
    assert plain.attrs["ended_by"] == "duration"


@pytest.mark.parametrize("rate", [30.0, 1000.0])
def test_hardware_with_delay_and_lag(rate):
    """The torque changes within a sample time, and its motor lags; compared with a run at tight
    tolerances."""
    arm = rod()
    hardware = fa.Hardware(motors=fa.Motors(time_constant=0.02, delay=0.004))
    event = fa.joint_event(arm, 1, 1.0, name="there", terminal=True)

    def run(**options):
        return fa.simulate(
            arm, 2.0, controller=Steps(), hardware=hardware, events=[event], **options
        )

    result, tight = run(rate=rate), run(rtol=1e-12, atol=1e-14, rate=7000.0)
    assert result.attrs["ended_by"] == "there"
    assert result.joint_angle.values[-1, 0] == pytest.approx(1.0, abs=1e-12)
    assert float(result.time[-1]) == pytest.approx(float(tight.time[-1]), abs=1e-8)


def test_contact_start_and_end():
    """A rod against a wall without damping: free rotations between bounces take the same time."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=0.6, flexible=False)])
    wall = fa.Contact(fa.Wall((np.cos(0.5), 0.0), (-1.0, 0.0)), 1e5)
    events = [
        fa.contact_event(arm, wall, name="made"),
        fa.contact_event(arm, wall, name="lost", direction=1),
    ]
    options = {"initial": [1.0], "initial_rate": [-2.0], "contacts": [wall], "events": events}
    result = fa.simulate(arm, 1.5, **options)
    # From 1 to 0.5 rad at 2 rad/s, back, and no further contact, because no force acts.
    assert result.event_name.values.tolist() == ["made", "lost"]
    assert result.event_time.values[0] == pytest.approx(0.25, abs=1e-9)
    touching = result.event_q.values[:, 0]
    np.testing.assert_allclose(touching, 0.5, atol=1e-9)
    ended = fa.simulate(
        arm, 1.5, **{**options, "events": [fa.contact_event(arm, wall, terminal=True)]}
    )
    assert float(ended.time[-1]) == pytest.approx(0.25, abs=1e-9)
    with pytest.raises(fa.InputError, match="contact must be a Contact"):
        fa.contact_event(arm, "wall")
