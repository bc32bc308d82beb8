"""Adaptive force laws, called directly: the law in numbers, and the theorem in its own model."""

import control
import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.arm_scales import slow_rate
from flexarm.control.design.rigid_model import TaskPlan
from flexarm.control.hardware.measurement import Measurement

LINK = {"mass_per_length": 0.6, "flexural_rigidity": 105.0, "elements": 1}
ARM = fa.Arm(
    links=[fa.Link(length=1.2, **LINK), fa.Link(length=0.9, **LINK)],
    joints=[fa.Joint(hub_inertia=0.1)] * 2,
)
ANGLE, STILL = np.array([0.7, -1.1]), np.zeros(2)
T = 1e-3
GIVEN = {
    "nominal_force": 5.0,
    "nominal_speed": 0.1,
    "normal_damping": 20.0,
    "approach_speed": 0.1,
    "touch_force": 0.2,
}
#: Nominal rate of the force, N/s: the nominal force in a period of the arm.
FORCE_RATE = 5.0 * slow_rate(ARM, T) / (2.0 * np.pi)
#: Row of the Jacobian for the tip's x at ANGLE.
A, B = np.cumsum(ANGLE)
ROW = np.array([-1.2 * np.sin(A) - 0.9 * np.sin(B), -0.9 * np.sin(B)])


class Surface:
    """A reference at rest whose force and path change with time; the normal is (-1, 0)."""

    friction = 0.2
    vectorized = True

    def __init__(self, force=lambda t: 4.0, speed=0.0):
        self.force, self.speed = force, speed

    def joint_angle(self, t):
        return np.broadcast_to(ANGLE, (*np.shape(t), 2))

    def joint_rate(self, t):
        return np.zeros((*np.shape(t), 2))

    joint_acceleration = pressing_torque = joint_rate

    def contact_force(self, t):
        return self.force(np.asarray(t)) + 0.0 * np.asarray(t)

    def normal(self, t):
        return np.broadcast_to([-1.0, 0.0], (*np.shape(t), 2))

    def tip(self, t):
        return np.stack([0.0 * np.asarray(t) + 1.4, 0.2 + self.speed * np.asarray(t)], axis=-1)


def reading(force, along=0.0, rate=STILL):
    return Measurement(
        joint_angle=ANGLE, joint_rate=rate, contact_force=np.array([[-force, along]])
    )


def push_of(controller, t, reference, force, along=0.0, normal_rate=0.0):
    """Return the force along x beyond the reference's, with a tip that moves along x."""
    rate = ROW * normal_rate / (ROW @ ROW)
    torque = controller.update(t, reading(force, along, rate), reference)
    return float(torque @ ROW / (ROW @ ROW))


@pytest.mark.parametrize("kind", [fa.AdaptiveForce, fa.NeuralForce])
def test_constant_force_at_rest_is_hybrid_control(kind):
    # Within the release time the contact is kept, as by a law that takes every force for one.
    adaptive, hybrid = kind(ARM), fa.HybridForce(ARM, touch_force=0.0)
    for k, force in enumerate((3.0, 3.5, 4.2, 0.1, 0.0, 3.9)):
        wanted = hybrid.update(k * T, reading(force), Surface())
        found = adaptive.update(k * T, reading(force), Surface())
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_push_is_the_estimate_times_force_rate_and_speed():
    reference = Surface(lambda t: 4.0 + 2.0 * t, speed=0.05)
    controller = fa.AdaptiveForce(ARM, adaptation=3.0, force_integral=0.0, **GIVEN)
    signals = np.array([2.0 / FORCE_RATE, -0.05 / 0.1])  # the tangent is (-n_y, n_x) = (0, -1)
    estimate = np.zeros(2)
    for k, force in enumerate((3.0, 3.5, 4.2)):
        found = push_of(controller, k * T, reference, force)
        assert found == pytest.approx(signals @ estimate, abs=1e-11)
        estimate += 3.0 * T * (4.0 + 2.0 * k * T - force) * signals
        got = controller.estimate
        np.testing.assert_allclose([got["stiffness_push"], got["slope_push"]], estimate, rtol=1e-9)


def test_friction_is_estimated_while_the_tip_slides():
    controller, mu = fa.AdaptiveForce(ARM, friction_adaptation=50.0, **GIVEN), 0.35
    slow, fast = Surface(speed=0.05), Surface(speed=0.3)
    for k in range(50):
        controller.update(k * T, reading(4.0, -4.0 * 0.1), slow)
    assert controller.estimate["friction"] == 0.2, "static friction is not sliding friction"
    errors = []
    for k in range(50, 200):
        controller.update(k * T, reading(4.0, -4.0 * mu), fast)
        errors.append(controller.estimate["friction"] - mu)
    # (F.18): the error decays with the gain times the square of the relative force.
    decay = 1.0 - 50.0 * T * (4.0 / 5.0) ** 2
    np.testing.assert_allclose(errors, -0.15 * decay ** np.arange(1, 151), rtol=1e-9)


def begin(controller, reference, **memory):
    """Begin with another memory than at the first sample."""
    first = controller.initial_memory(reading(0.0), controller.planned(0.0, reference))
    controller._keep({**first, **memory})


def test_brief_loss_of_contact_keeps_the_push():
    reference = Surface(lambda t: 4.0 + 2.0 * t, speed=0.05)
    given = {**GIVEN, "adaptation": 0.0, "force_integral": 0.0, "release_time": 0.01}
    controller = fa.AdaptiveForce(ARM, **given)
    begin(controller, reference, estimate=np.array([-2.0, 3.0]))
    force = [4.0, 4.0] + 14 * [0.0] + [4.0]
    pushes = [push_of(controller, k * T, reference, one) for k, one in enumerate(force)]
    kept = -2.0 * 2.0 / FORCE_RATE - 3.0 * 0.05 / 0.1
    np.testing.assert_allclose([*pushes[:11], pushes[-1]], kept, atol=1e-11)
    # Then it approaches with at most normal_damping * approach_speed = 2 N.
    approach = [2.0 - reference.force(k * T) for k in range(12, 16)]
    np.testing.assert_allclose(pushes[12:16], approach, atol=1e-12)


def test_jump_of_the_requested_force_adds_a_bounded_push():
    reference = Surface(lambda t: np.where(np.asarray(t) < 5.5 * T, 4.0, 6.0))
    controller = fa.AdaptiveForce(ARM, adaptation=2.0, force_integral=0.0)
    begin(controller, reference, estimate=np.array([0.5, 0.0]))
    pushes = [push_of(controller, k * T, reference, 4.0) for k in range(10)]
    # Five times the nominal rate of the force, in the two samples of the central difference.
    expected = np.zeros(10)
    expected[5:7] = 5.0 * 0.5
    np.testing.assert_allclose(pushes, expected, atol=1e-11)
    # The error is 0 in the first of them and 2 N in the second.
    assert controller.estimate["stiffness_push"] == pytest.approx(0.5 + T * 2.0 * 2.0 * 5.0)


@pytest.mark.thorough
@pytest.mark.parametrize("more", [0.0, 0.04, 0.1])
def test_request_is_between_both_plans(more):
    line = fa.line_motion(ARM, (1.4, 0.2), (1.4, 0.5), 1.0)
    reference = fa.pressed_motion(ARM, line, 4.0, (-1.0, 0.0), friction=0.2)
    controller, plan, rougher = fa.AdaptiveForce(ARM), TaskPlan(ARM, T), TaskPlan(ARM, T)
    for t in (0.0, 0.3, 0.5):
        memory = {"friction": 0.2 + more, "friction_rate": 0.0}
        found = controller._request(memory, controller.planned(t, reference))
        rows = plan.row(t, reference), rougher.row(t, reference.rougher)
        assert np.abs(rows[1] - rows[0]).max() > 1e-3 or t == 0.0  # friction has an effect
        wanted = plan.request(rows[0] + more / 0.1 * (rows[1] - rows[0]))
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


class MasslessContact:
    """The model of the theorem, (F.15): a tip without mass on a spring of unknown stiffness.

    `slope` is that of the surface relative to the plan, `bias` an unmodelled constant force.
    """

    def __init__(self, controller, reference, compliance, slope=0.0, bias=0.0):
        self.controller, self.reference, self.compliance = controller, reference, compliance
        self.slope, self.bias = slope, bias

    def run(self, start, duration):
        """Return times, errors and estimates at each sample."""
        dt, D = self.controller.sample_time, self.controller.normal_damping
        force, rows = start, []
        self.controller.reset()
        for k in range(round(duration / dt)):
            t = k * dt
            wanted = self.reference.force(t)
            push = push_of(self.controller, t, self.reference, force)
            rows.append(
                (
                    t,
                    wanted - force,
                    self.controller.memory["integral"],
                    *self.controller.memory["estimate"],
                )
            )
            # c D F' = F_r - F + push - bias - D slope v: one exact step for a constant right side.
            rest = wanted + push - self.bias - D * self.slope * -self.reference.speed
            force = rest + (force - rest) * np.exp(-dt / (self.compliance * D))
        return np.array(rows)


C, SLOPE, BIAS = 0.01, 0.08, 0.3


def theorem():
    reference = Surface(lambda t: 4.0 + 1.5 * np.sin(3.0 * t), speed=0.12)
    controller = fa.AdaptiveForce(ARM, adaptation=4.0, **GIVEN | {"touch_force": 0.0})
    return controller, MasslessContact(controller, reference, C, SLOPE, BIAS).run(2.5, 5.0)


def lyapunov(controller, rows):
    """Return V of (F.16) with the true values of this model."""
    D, e = controller.normal_damping, rows[:, 1]
    errors = rows[:, 2] - BIAS, rows[:, 3] - D * C * FORCE_RATE, rows[:, 4] - D * SLOPE * 0.1
    V = 0.5 * D * C * e**2 + 0.5 * errors[0] ** 2 / controller.force_integral
    return V + 0.5 * (errors[1] ** 2 + errors[2] ** 2) / controller.adaptation


def test_lyapunov_function_never_increases():
    controller, rows = theorem()
    V, e = lyapunov(controller, rows), rows[:, 1]
    rise = np.diff(V)
    # Sampling adds at most the squared change of the estimates in one sample.
    assert rise.max() < 1e-5 * V[0]
    fall = controller.sample_time * np.cumsum(e[:-1] ** 2)
    # V' = -e^2; sampling and held torque have an error of first order in T / (D c) = 0.5 %.
    np.testing.assert_allclose(V[0] - V[1:], fall, atol=0.03 * V[0])
    # The theorem bounds the integral of e^2; it gives no rate of convergence to compare with.
    assert fall[-1] < V[0]


@pytest.mark.thorough
def test_without_adaptation_an_error_remains():
    reference = Surface(lambda t: 4.0 + 1.5 * np.sin(3.0 * t), speed=0.12)
    remaining = []
    for gain in (0.0, 4.0):
        controller = fa.AdaptiveForce(ARM, adaptation=gain, **GIVEN | {"touch_force": 0.0})
        rows = MasslessContact(controller, reference, 0.05, SLOPE, BIAS).run(3.0, 8.0)
        remaining.append(np.sqrt(np.mean(rows[-2000:, 1] ** 2)))
    assert remaining[1] < 0.2 * remaining[0]


def test_ramp_of_the_force_equals_the_linear_loop():
    """With a constant force rate the adaptive loop is linear: python-control has its response."""
    rate = 0.5
    reference = Surface(lambda t: 4.0 + rate * t)
    controller = fa.AdaptiveForce(ARM, adaptation=40.0, **GIVEN | {"touch_force": 0.0})
    rows = MasslessContact(controller, reference, C, bias=BIAS).run(4.0, 2.0)
    D, gain = controller.normal_damping, controller.force_integral + 40.0 * (rate / FORCE_RATE) ** 2
    s = control.tf("s")
    # D c e' + e + gain * integral of e = bias + D c * rate
    loop = s / (D * C * s**2 + s + gain)
    _, response = control.forced_response(loop, rows[:, 0], np.full(len(rows), BIAS + D * C * rate))
    np.testing.assert_allclose(rows[:, 1], response, atol=0.01 * abs(response).max())


def test_network_signals_are_bounded_and_repeatable():
    first, second = fa.NeuralForce(ARM, seed=3), fa.NeuralForce(ARM, seed=3)
    reference = Surface(speed=0.3)
    for k in range(5):
        for controller in (first, second):
            controller.update(k * T, reading(3.0), reference)
    np.testing.assert_array_equal(first.memory["estimate"], second.memory["estimate"])
    assert np.abs(first.memory["estimate"][2:]).max() > 0.0
    signals = first._signals(first.planned(0.0, reference))
    assert signals[2:] @ signals[2:] <= 4.0  # both halves at most 2
    other = fa.NeuralForce(ARM, seed=4)
    other.update(0.0, reading(3.0), reference)
    assert not np.array_equal(signals, other._signals(other.planned(0.0, reference)))


def test_network_forgets_with_leakage():
    controller = fa.NeuralForce(ARM, leakage=10.0)
    reference = Surface(speed=0.3)
    controller.update(0.0, reading(3.0), reference)
    learned = controller.memory["estimate"][2:].copy()
    controller.update(T, reading(4.0), reference)
    np.testing.assert_allclose(
        controller.memory["estimate"][2:], (1.0 - 10.0 * T) * learned, rtol=1e-12
    )


def test_network_neither_learns_nor_forgets_at_rest():
    controller = fa.NeuralForce(ARM, leakage=10.0, e_modification=10.0)
    controller.update(0.0, reading(3.0), Surface(speed=0.3))
    learned = controller.memory["estimate"][2:].copy()
    controller.update(T, reading(3.0), Surface(speed=0.05))
    np.testing.assert_array_equal(controller.memory["estimate"][2:], learned)


def test_network_forgets_at_most_everything():
    controller = fa.NeuralForce(ARM, e_modification=1000.0, learning=0.0)
    reference = Surface(speed=0.3)
    ones = np.concatenate([np.zeros(2), np.ones(controller._terms - 2)])
    begin(controller, reference, estimate=ones)
    controller.update(0.0, reading(14.0), reference)
    np.testing.assert_array_equal(controller.memory["estimate"][2:], 0.0)


@pytest.mark.parametrize(
    ("kind", "titles"),
    [
        (fa.AdaptiveForce, ["Adaptive force control"]),
        (fa.NeuralForce, ["Adaptive force control", "Random features"]),
    ],
)
def test_methods_are_cited(kind, titles):
    found = fa.citation(kind(ARM))
    assert all(title in found for title in titles)
