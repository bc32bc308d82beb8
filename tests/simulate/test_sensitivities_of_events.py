"""Derivatives of the times of events and of runs that end there, against differences."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from central_differences import differences
from flexarm.model.paths import number_at, with_number
from random_arms import random_spec

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]
NAMES = "event_time", "event_q", "event_qd"
DURATION = 0.4
WALL = fa.Wall((0.0, 0.3), (0.0, -1.0))


def an_arm(stops=False):
    rod = {"flexural_rigidity": [90.0, 40.0], "mass_per_length": 0.5, "elements": 2, "modes": 1}
    limits = fa.JointLimits(lower=-1.0, upper=0.5, stiffness=500.0, damping=0.2)
    joints = [{"hub_inertia": 0.1, "limits": limits if stops else None}, 0.05]
    return chain((0.8, 0.6), joints, payload=0.3, **rod)


def wall_contact(stiffness=2e3):
    return fa.Contact(WALL, stiffness, damping=0.1)


def events_of(arm, kind, terminal):
    """Return the events of one kind for an arm."""
    made = {
        "joint": lambda **more: fa.joint_event(arm, 1, 0.2, **more),
        "stop": lambda **more: fa.joint_event(arm, 1, "upper", direction=-1, **more),
        "tip": lambda **more: fa.tip_event(arm, (0.0, 0.25), (0.1, 1.0), **more),
        "contact": lambda **more: fa.contact_event(arm, wall_contact(), **more),
        "own": lambda **more: fa.Event(
            lambda t, q, qd: np.sin(3.0 * q[0]) - 0.3 * qd[1] ** 2 - 8.0 * t**2, **more
        ),
    }
    return [made[kind](terminal=terminal, name=kind)]


PATHS = ["payload.mass", "links[0].length", "initial_rate[0]", "links[1].flexural_rigidity"]


@pytest.mark.sampled("own-True")
@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("kind", ["joint", "stop", "tip", "contact", "own"])
def test_events_against_differences(kind, terminal):
    arm = an_arm(stops=kind == "stop")
    rate = 0.3 * np.ones(arm.dof)
    rate[len(rate) // 2 :] *= 0.1
    given = {
        "torque": lambda t: [3.0, -1.0 + t], "rate": 200.0,
        "integrator": "rk4", "step": 1e-4,
        "contacts": [wall_contact()] if kind == "contact" else (),
    }  # fmt: skip

    def run(own, start):
        return fa.simulate(
            own, DURATION, events=events_of(own, kind, terminal), initial_rate=start, **given
        )

    plain = run(arm, rate)
    assert 0 < plain.sizes["event"] < 8
    found = fa.sensitivities(
        arm, DURATION, PATHS, events=events_of(arm, kind, terminal), initial_rate=rate,
        channels=["tip"], error_estimate=False, **given,
    )  # fmt: skip
    np.testing.assert_array_equal(found["event_name"], plain["event_name"])
    np.testing.assert_array_equal(found["time"], plain["time"])
    for place, path in enumerate(PATHS):

        def values(value, path=path):
            start, own = rate.copy(), arm
            if path.startswith("initial_rate"):
                start[0] = value
            else:
                own = fa.Arm(with_number(arm.spec, path, value))
            result = run(own, start)
            return [result[name].values for name in (*NAMES, "tip")]

        first = rate[0] if path.startswith("initial_rate") else number_at("", arm.spec, path)
        step = 3e-4 * abs(first)
        wanted = differences(values, first, step)
        for name, (exact, error) in zip((*NAMES, "tip"), wanted, strict=True):
            if name == "tip" and not terminal:
                continue
            largest = np.abs(exact).max()
            # Located within 1e-12 of the interval; rounding over the step of the difference.
            # Where a stop or a contact opens or closes, the rate of its force is not constant over
            # the last step, 1e-4 s, so that the derivatives have an error in proportion to it.
            same = {"stop": 5e-3, "contact": 1e-3}.get(kind, 1e-6)
            allowed = 10.0 * error + same * largest + 1e-11 / step
            assert allowed < 0.05 * largest, (path, name)
            np.testing.assert_allclose(
                found[name].values[place], exact, rtol=0, atol=allowed, err_msg=f"{path} {name}"
            )


def test_a_turning_rigid_link():
    """The angle a is passed at a / w, whose derivative by w is -a / w^2."""
    link = fa.Link(length=1.0, mass_per_length=1.0, flexural_rigidity=1e3)
    arm = fa.Arm(links=[link], gravity=(0.0, 0.0)).rigid()
    found = fa.sensitivities(
        arm, 1.0, ["initial_rate[0]", "initial[0]"], initial_rate=[0.8], channels=["joint_angle"],
        events=[fa.joint_event(arm, 1, 0.4, terminal=True)],
    )  # fmt: skip
    np.testing.assert_allclose(
        found["event_time"].values[:, 0], [-0.4 / 0.64, -1.0 / 0.8], rtol=1e-9
    )
    np.testing.assert_allclose(found["event_qd"].values[:, 0, 0], [1.0, 0.0], atol=1e-9)
    # The last sample moves with the event, and the angle there is given.
    np.testing.assert_allclose(found["joint_angle"].values[:, -1, 0], 0.0, atol=1e-9)


@pytest.mark.sampled("5")
@pytest.mark.parametrize("seed", [1, 5])
def test_random_arms_with_a_controller(seed):
    arm = fa.Arm(random_spec(np.random.default_rng(seed), links=2, elements=1))
    size = np.diag(arm.rigid().mass_matrix(arm.rigid().rest([0.0, 0.0])))
    given = {
        "controller": fa.JointPD(30.0 * size, 5.0 * size, sample_time=0.004),
        "reference": fa.joint_motion(arm, [0.0, 0.0], [0.9, -0.5], 0.1),
        "events": [fa.joint_event(arm, 1, 0.02), fa.joint_event(arm, 1, 0.05, terminal=True)],
        "integrator": "rk4", "step": 0.1 / fa.modes(arm).frequency_hz[-1] / 2 / np.pi,
    }  # fmt: skip
    start = arm.rest([0.0, 0.0])
    found = fa.sensitivities(arm, 0.3, ["initial[1]"], initial=start, channels=["tip"], **given)
    assert found.sizes["event"] == 2

    def values(value):
        moved = start.copy()
        moved[1] = value
        result = fa.simulate(arm, 0.3, initial=moved, **given)
        return [result["event_time"].values, result["tip"].values[-1]]

    both = found["event_time"].values[0], found["tip"].values[0, -1]
    for own, (exact, error) in zip(both, differences(values, start[1], 1e-5), strict=True):
        allowed = 10.0 * error + 1e-5 * np.abs(exact).max()
        assert allowed < 0.02 * np.abs(exact).max()
        np.testing.assert_allclose(own, exact, rtol=0, atol=allowed)


def test_no_event_happens():
    arm = an_arm()
    found = fa.sensitivities(
        arm, 0.01, ["payload.mass"], channels=["q"], events=[fa.joint_event(arm, 1, 3.0)]
    )
    assert found["event_time"].shape == (1, 0)


def test_the_gap_by_a_number_of_its_contact():
    arm = an_arm()
    given = {"contacts": [wall_contact()], "events": [fa.contact_event(arm, wall_contact())]}
    given["initial_rate"] = 0.3 * np.ones(arm.dof)
    with pytest.raises(fa.InputError, match=r"not differentiated by contacts\[0\].stiffness"):
        fa.sensitivities(
            arm, DURATION, ["contacts[0].stiffness"], torque=lambda t: [3.0, -1.0 + t], **given
        )


@pytest.mark.sampled("contact")
@pytest.mark.parametrize("kind", ["stop", "contact"])
def test_steps_of_the_default_integrator(kind):
    """The derivatives follow those of accurate runs, although a force begins or ends there."""
    arm, path = an_arm(stops=kind == "stop"), "payload.mass"
    rate = 0.3 * np.ones(arm.dof)
    rate[len(rate) // 2 :] *= 0.1
    given = {
        "torque": lambda t: [3.0, -1.0 + t], "initial_rate": rate, "rate": 200.0,
        "contacts": [wall_contact()] if kind == "contact" else (),
    }  # fmt: skip
    found = fa.sensitivities(
        arm, DURATION, [path], events=events_of(arm, kind, False), channels=["q"], **given
    )["event_time"].values[0]

    def times(value):
        own = fa.Arm(with_number(arm.spec, path, value))
        events = events_of(own, kind, False)
        exact = {"rtol": 1e-11, "atol": 1e-13}
        return [fa.simulate(own, DURATION, events=events, **given, **exact)["event_time"].values]

    ((wanted, error),) = differences(times, 0.3, 1e-4)
    largest = np.abs(wanted).max()
    assert error < 1e-7 * largest
    np.testing.assert_allclose(found, wanted, rtol=0, atol=5e-7 * largest)


def time_slope(make, path, value, event_of):
    """Return the derivative of an event's time, and a central difference of it."""
    given = {"torque": lambda t: [0.3], "initial_rate": [0.8]}
    found = fa.sensitivities(
        make(value), 2.0, [path], events=[event_of(make(value))], channels=["q"], **given
    )
    ends = [
        fa.simulate(make(value + change), 2.0, events=[event_of(make(value + change))], **given)
        for change in (1e-5, -1e-5)
    ]
    wanted = (ends[0]["event_time"].values[0] - ends[1]["event_time"].values[0]) / 2e-5
    return found["event_time"].values[0, 0], wanted


def test_the_tip_by_the_angle_of_a_fixed_joint():
    def make(angle):
        rigid = {"mass_per_length": 1.0, "flexural_rigidity": 1e3, "flexible": False}
        return fa.Arm(
            links=[fa.Link(length=1.0, **rigid), fa.Link(length=0.7, **rigid)],
            joints=[fa.Joint(), fa.Joint(fixed=True, rest_angle=angle)], gravity=(0.0, 0.0),
        )  # fmt: skip

    found, wanted = time_slope(
        make, "joints[1].rest_angle", 0.5,
        lambda arm: fa.tip_event(arm, (0.0, 0.6), (0.0, 1.0), terminal=True),
    )  # fmt: skip
    assert abs(wanted) > 0.1
    assert found == pytest.approx(wanted, rel=1e-5)  # located within the tolerance of the steps


def test_a_stop_by_its_angle():
    def make(upper):
        limits = fa.JointLimits(lower=-1.0, upper=upper, stiffness=500.0, damping=0.2)
        link = fa.Link(length=1.0, mass_per_length=1.0, flexural_rigidity=1e3)
        joints = [fa.Joint(limits=limits)]
        return fa.Arm(links=[link], joints=joints, gravity=(0.0, 0.0)).rigid()

    found, wanted = time_slope(
        make, "joints[0].limits.upper", 0.3,
        lambda arm: fa.joint_event(arm, 1, "upper", direction=1, terminal=True),
    )  # fmt: skip
    assert wanted > 0.5
    assert found == pytest.approx(wanted, rel=1e-5)


def test_an_event_by_numbers_that_move_no_point():
    """Numbers that are zero and may not be negative, too."""
    arm = an_arm()
    paths = ["joints[0].damping", "joints[1].damping"]
    event = fa.tip_event(arm, (0.0, 0.25), (0.1, 1.0))
    found = fa.sensitivities(
        arm, DURATION, paths, torque=lambda t: [3.0, -1.0 + t], events=[event], channels=["q"]
    )
    assert np.all(found["event_time"] > 0.0)  # damping delays the tip


def test_an_array_of_other_objects_is_refused():
    events = np.array([object(), object()], dtype=object)
    with pytest.raises(fa.InputError, match=r"events"):
        fa.sensitivities(an_arm(), DURATION, ["payload.mass"], events=events)
