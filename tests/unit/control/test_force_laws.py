"""Force controllers called directly: bounds, motion without contact, previewed references, wrong
gains."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.arm_scales import slow_rate
from flexarm.control.hardware.measurement import Measurement
from flexarm.simulation.loop.control_loop import sampled_reference

LINK = {"mass_per_length": 0.6, "flexural_rigidity": 105.0, "elements": 1}
ARM = fa.Arm(
    links=[fa.Link(length=1.2, **LINK), fa.Link(length=0.9, **LINK)],
    joints=[fa.Joint(hub_inertia=0.1)] * 2,
)
LINE = fa.line_motion(ARM, (1.4, 0.2), (1.4, 0.5), 1.0)
PRESSED = fa.pressed_motion(ARM, LINE, 4.0, (-1.0, 0.0))
STILL = np.zeros(2)
FORCED = [fa.HybridForce, fa.Impedance, fa.Admittance]
every = pytest.mark.parametrize("kind", FORCED)


def reading(force, angle=None, rate=STILL):
    angle = PRESSED.joint_angle(0.0) if angle is None else angle
    return Measurement(joint_angle=angle, joint_rate=rate, contact_force=np.array([[-force, 0.0]]))


class AtRest:
    """The pressing motion, stopped at its start."""

    def joint_angle(self, t):
        return PRESSED.joint_angle(0.0)

    def contact_force(self, t):
        return PRESSED.contact_force(0.0)

    def normal(self, t):
        return PRESSED.normal(0.0)

    def pressing_torque(self, t):
        return PRESSED.pressing_torque(0.0)

    def joint_rate(self, t):
        return STILL

    joint_acceleration = joint_rate


@every
def test_at_its_reference_the_controller_holds_the_bent_arm(kind):
    controller = kind(ARM)
    controller.reset()
    torque = controller.update(0.0, reading(4.0), AtRest())
    np.testing.assert_allclose(torque, PRESSED.holding_torque(0.0), atol=1e-12)


@every
def test_arm_may_be_its_own_reference_without_a_force(kind):
    controller = kind(ARM)
    controller.reset()
    measurement = Measurement(joint_angle=np.array([0.4, 0.3]), joint_rate=STILL)
    np.testing.assert_allclose(controller.update(0.0, measurement, None), STILL, atol=1e-12)


def jacobian_row():
    a, b = np.cumsum(PRESSED.joint_angle(0.0))
    return np.array([-1.2 * np.sin(a) - 0.9 * np.sin(b), -0.9 * np.sin(b)])


def pushes(controller, forces):
    """Return the force along x beyond the reference's, for a sequence of measured forces."""
    controller.reset()
    row, found = jacobian_row(), []
    for k, force in enumerate(forces):
        torque = controller.update(k * controller.sample_time, reading(force), AtRest())
        found.append(np.dot(torque - PRESSED.holding_torque(0.0), row) / np.dot(row, row))
    return np.array(found)


def test_hybrid_adds_the_integral_of_the_error():
    controller = fa.HybridForce(ARM, force_integral=10.0, force_proportional=0.5)
    found = pushes(controller, [3.0, 3.0, 3.5])
    np.testing.assert_allclose(found, [0.5, 0.51, 0.27], atol=1e-12)


def test_force_without_contact_is_limited_by_the_approach_speed():
    controller = fa.HybridForce(ARM, normal_damping=20.0, approach_speed=0.1)
    # 4 N less 2 N for any time; the integral starts at the first contact.
    np.testing.assert_allclose(pushes(controller, [0.0] * 50), -2.0, atol=1e-12)
    found = pushes(controller, [0.0] * 50 + [4.0, 4.0])
    np.testing.assert_allclose(found[-2:], 0.0, atol=1e-12)


def test_integral_is_bounded_by_half_of_the_force():
    controller = fa.HybridForce(ARM, force_integral=1000.0)
    assert pushes(controller, [1.0] * 20)[-1] == pytest.approx(2.0)
    assert pushes(controller, [9.0] * 20)[-1] == pytest.approx(-2.0)


class Strokes(AtRest):
    """Two strokes with motion without force between them."""

    def contact_force(self, t):
        return 0.0 if 20.5 * 1e-3 < t < 22.5 * 1e-3 else 4.0


def test_integral_is_cleared_where_the_force_is_zero():
    controller = fa.HybridForce(ARM)
    row, found = jacobian_row(), []
    for k in range(25):
        force = 4.0 if k > 22 else 3.0
        torque = controller.update(k * controller.sample_time, reading(force), Strokes())
        found.append(np.dot(torque - PRESSED.holding_torque(0.0), row) / np.dot(row, row))
    assert found[20] == pytest.approx(20 * controller.force_integral * 1e-3), (
        "the integral of the first stroke"
    )
    np.testing.assert_allclose(found[23:], 0.0, atol=1e-12)


def test_admittance_moves_its_reference_at_a_bounded_speed():
    slow = fa.Admittance(ARM, damping=1.0, most_speed=0.05)
    fast = fa.Admittance(ARM, damping=1.0, most_speed=1e9)
    # Error 2 N over 1 N s/m: 2 m/s requested, 0.05 m/s allowed; the first sample has the damper's
    # force.
    ratio = pushes(slow, [6.0])[0] / pushes(fast, [6.0])[0]
    assert ratio == pytest.approx(0.05 / 2.0)


def test_three_joints_keep_their_posture():
    arm = fa.Arm(links=[fa.Link(length=0.6, **LINK)] * 3, joints=[fa.Joint(hub_inertia=0.1)] * 3)
    controller = fa.Impedance(
        arm, tangent_stiffness=60.0, normal_stiffness=60.0, posture_frequency=4.0
    )
    goal = np.array([0.5, -0.7, 0.9])

    class Goal:
        def joint_angle(self, t):
            return goal

        def joint_rate(self, t):
            return np.zeros(3)

        joint_acceleration = joint_rate

        def contact_force(self, t):
            return 0.0

        def normal(self, t):
            return [1.0, 0.0]

        def pressing_torque(self, t):
            return np.zeros(3)

    rigid = arm.rigid()
    angles = goal + np.array([0.02, -0.03, 0.04])
    measurement = Measurement(joint_angle=angles, joint_rate=np.zeros(3))
    torque = controller.update(0.0, measurement, Goal())
    found = rigid.forward_dynamics(rigid.rest(angles), np.zeros(3), torque)[rigid.joint_index]
    back = -16.0 * (angles - goal)
    step = 1e-7
    tip = [rigid.tip(rigid.rest(angles + step * e))[:2] for e in np.eye(3)]
    J = (np.array(tip) - rigid.tip(rigid.rest(angles))[:2]).T / step
    M = rigid.mass_matrix(rigid.rest(angles))
    free = np.linalg.svd(J)[2][2]
    pulled = np.linalg.solve(M, J.T @ [1.0, 0.0]), np.linalg.solve(M, J.T @ [0.0, 1.0])
    # Without the springs of the tip, the remaining torque is along the self-motion of the posture.
    K = -60.0 * J @ (angles - goal)
    rest = found - K[0] * pulled[0] - K[1] * pulled[1]
    # The tip's path is curved: second order of the offset of 0.04 rad.
    assert free @ rest == pytest.approx(free @ back, rel=0.1)


def test_previewed_reference_equals_the_reference():
    seen = sampled_reference(PRESSED, 1e-3, 1.0)
    for name in ("joint_angle", "joint_acceleration", "contact_force", "pressing_torque", "tip"):
        ask, wanted = getattr(seen, name), getattr(PRESSED, name)
        for t in (0.0, 0.4, 400 * 1e-3, 0.4004, 1.0, 7.0):
            np.testing.assert_allclose(ask(t), wanted(t), rtol=1e-13, atol=1e-13)
        times = np.array([0.1, 0.25])
        np.testing.assert_array_equal(ask(times), wanted(times))
    assert seen.end_time == PRESSED.end_time
    assert not hasattr(sampled_reference(LINE, 1e-3, 1.0), "contact_force")
    plain = AtRest()
    assert sampled_reference(plain, 1e-3, 1.0) is plain


@every
def test_wrong_gains_are_reported_together(kind):
    with pytest.raises(fa.InputError) as caught:
        kind(
            ARM,
            sample_time=0.0,
            **{"normal_damping" if kind is not fa.Admittance else "damping": -1},
        )
    assert len(caught.value.problems) == 2


def test_default_rates_with_a_delay_do_not_depend_on_the_mesh():
    def rate(elements, delay):
        link = {"length": 1.0, "mass_per_length": 0.5, "flexural_rigidity": 200.0}
        links = [fa.Link(**link, elements=elements)] * 2
        joints = [fa.Joint(hub_inertia=0.01)] * 2
        arm = fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=1.0))
        return slow_rate(arm, 1e-3, delay)

    assert rate(16, 2e-3) == pytest.approx(rate(8, 2e-3), rel=0.05)
    assert rate(8, 1e-12) == rate(8, 0.0)
