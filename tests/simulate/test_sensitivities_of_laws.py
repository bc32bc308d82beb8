"""Derivatives of loops with laws that switch, round or have corners, and with wrong readings."""

import numpy as np
import pytest

import flexarm as fa
from controllers import Law

pytestmark = pytest.mark.compiled
LINK = fa.Link(length=1.0, mass_per_length=1.0, flexural_rigidity=1e3)
ARM = fa.Arm(links=[LINK], gravity=(0.0, 0.0)).rigid()
FIXED = {"integrator": "rk4", "step": 1e-3, "rate": 100.0}


def of_reading(torque):
    """Return a controller whose torque is a function of the readings."""
    return Law(lambda readings, inputs: [torque(readings)])


class ConditionalIntegral(fa.Controller):
    sample_time = 0.01

    def initial_memory(self, readings, inputs):
        return {"sum": 0.0}

    def step(self, memory, readings, inputs):
        error = readings.joint_angle[0] - 0.3
        total = memory["sum"] + (error if abs(error) < 0.01 else 0.0)
        return {"sum": total}, [-5.0 * error - readings.joint_rate[0] - 50.0 * total]


def damped(measurement):
    return -5.0 * measurement.joint_angle[0] - measurement.joint_rate[0]


def slope(path, controller, angle=0.0, rate=0.8, duration=0.3, **more):
    """Return the derivative of the last angle."""
    found = fa.sensitivities(
        ARM, duration, [path], channels=["joint_angle"], controller=controller, initial=[angle],
        initial_rate=[rate], **FIXED, **more,
    )  # fmt: skip
    return found["joint_angle"].values[0, -1, 0]


def by_rate(controller, angle=0.0, rate=0.8, duration=0.3, **more):
    """Return the derivative of the last angle by the initial rate, by a central difference."""
    step = 1e-5  # rounding 1e-11, and short enough that no sample enters or leaves a branch
    ends = [
        fa.simulate(
            ARM, duration, controller=controller, initial=[angle], initial_rate=[rate + change],
            **FIXED, **more,
        )["joint_angle"].values[-1, 0]
        for change in (step, -step)
    ]  # fmt: skip
    return (ends[0] - ends[1]) / (2.0 * step)


def test_a_branch_that_few_samples_take():
    given = {"controller": ConditionalIntegral(), "angle": 0.2, "duration": 1.0}
    wanted = by_rate(**given)
    assert wanted < -3.0  # -0.03 without the branch
    assert slope("initial_rate[0]", **given) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize(
    ("kind", "size"), [("bias", 0.05), ("drift", 0.5), ("gain", -0.2), ("frozen", None)]
)
def test_faults_of_instruments(kind, size):
    fault = fa.InstrumentFault(kind, size, start=0.1)
    read = [fa.Instrument("joint_angle", faults=[fault]), fa.Instrument("joint_rate")]
    given = {"controller": of_reading(damped), "hardware": fa.Hardware(instruments=read)}
    assert slope("initial_rate[0]", **given) == pytest.approx(by_rate(**given), rel=1e-7)


RATE_ALONE = of_reading(lambda measurement: -measurement.joint_rate[0])


def test_the_rate_of_a_limited_angle():
    limited = fa.Hardware(instruments=[fa.Instrument("joint_angle", limit=0.1, rate_cutoff=20.0)])
    with pytest.raises(fa.InputError, match="limit is reached by joint_angle"):
        slope("initial_rate[0]", RATE_ALONE, angle=0.095, rate=0.05, hardware=limited)


def test_a_rate_above_the_limit_of_its_angle():
    wide = fa.Hardware(instruments=[fa.Instrument("joint_angle", limit=3.0, rate_cutoff=20.0)])
    given = {"controller": RATE_ALONE, "rate": 9.0, "hardware": wide}
    assert slope("initial_rate[0]", **given) == pytest.approx(by_rate(**given), rel=1e-7)


@pytest.mark.parametrize(
    "torque",
    [
        lambda measurement: -20.0 * max(0.0, measurement.joint_angle[0]),
        lambda measurement: 20.0 * abs(measurement.joint_angle[0]),
        lambda measurement: -5e-4 * np.round(measurement.joint_angle[0] / 1e-4),
    ],
)
def test_corners_and_rounding(torque):
    with pytest.raises(fa.InputError, match="be differentiable"):
        slope("initial[0]", of_reading(torque), rate=0.01)


def test_a_corner_that_no_parameter_reaches():
    """The rate is zero at the start, where the law has a corner in it, whatever the angle is."""
    law = of_reading(lambda m: -5.0 * m.joint_angle[0] - 0.5 * abs(m.joint_rate[0]))
    plain = slope("initial[0]", law, angle=0.3, rate=0.0)
    step = 1e-6
    ends = [
        fa.simulate(ARM, 0.3, controller=law, initial=[0.3 + change], **FIXED)["joint_angle"]
        for change in (step, -step)
    ]
    wanted = (ends[0] - ends[1]).values[-1, 0] / (2.0 * step)
    assert plain == pytest.approx(wanted, rel=1e-7)
    with pytest.raises(fa.InputError, match="be differentiable"):
        slope("initial_rate[0]", law, angle=0.3, rate=0.0)


@pytest.mark.parametrize("limit", [0.3, 1.45])
def test_a_torque_limit_within_a_law_is_no_rounding(limit):
    law = of_reading(lambda m: float(np.clip(damped(m), -limit, limit)))
    given = {"controller": law, "angle": 0.2}
    assert slope("initial_rate[0]", **given) == pytest.approx(by_rate(**given), rel=1e-6)


def test_a_dead_band_is_no_rounding():
    """At 0.3 the steps of the differences reach beyond both ends of the dead band."""

    def torque(measurement):
        error = measurement.joint_angle[0] - 0.3
        return -5.0 * np.sign(error) * max(0.0, abs(error) - 1e-3)

    assert slope("initial[0]", of_reading(torque), angle=0.3, rate=0.0) == pytest.approx(
        1.0, abs=1e-12
    )


class Surface:
    """A reference at rest that presses with a constant force along x."""

    friction = 0.0
    vectorized = True

    def __init__(self, angle):
        self.angle = np.asarray(angle)

    def joint_angle(self, t):
        return np.broadcast_to(self.angle, (*np.shape(t), 2))

    def joint_rate(self, t):
        return np.zeros((*np.shape(t), 2))

    joint_acceleration = pressing_torque = joint_rate

    def contact_force(self, t):
        return 4.0 + 0.0 * np.asarray(t)

    def normal(self, t):
        return np.broadcast_to([-1.0, 0.0], (*np.shape(t), 2))

    def tip(self, t):
        return np.broadcast_to([1.4, 0.2], (*np.shape(t), 2))


@pytest.mark.parametrize("law", [fa.HybridForce, fa.AdaptiveForce, fa.NeuralForce])
def test_controllers_that_read_the_force_in_contact(law):
    rod = {"mass_per_length": 0.6, "flexural_rigidity": 105.0, "elements": 1}
    arm = fa.Arm(links=[fa.Link(length=1.2, **rod), fa.Link(length=0.9, **rod)])
    angle = [0.7, -1.1]
    reach = float(arm.tip(arm.rest(angle))[0])
    wall = fa.Contact(fa.Wall((reach - 1e-4, 0.0), (-1.0, 0.0)), stiffness=1e4, damping=0.5)
    with pytest.raises(fa.InputError, match="reads contact_force, which is not supported"):
        fa.sensitivities(
            arm, 0.02, ["links[1].mass_per_length"], controller=law(arm),
            reference=Surface(angle), contacts=[wall],
        )  # fmt: skip
