"""LQG against linear-quadratic theory: costs, covariances, poles, optimal feedforward."""

import numpy as np
import pytest
from linear_arm import POSTURE, arm_with_gauges

import flexarm as fa
from flexarm.control.design.linear_design import preview_gain

SAMPLE_TIME = 0.002
#: Outputs that determine the whole state of links of one element each.
ALL = (
    "joint_angle",
    "link_tip_deflection",
    "link_tip_slope",
    "joint_rate",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
)


class StateFeedback(fa.Controller):
    """The regulator alone, with instruments for the whole state; it adds up the cost."""

    sample_time = SAMPLE_TIME

    def __init__(self, arm, design):
        self.design = design
        model = fa.linearize(arm, fa.equilibrium(arm, POSTURE), outputs=ALL)
        self.from_outputs, self.rest = np.linalg.inv(model.C), model.output

    def reset(self):
        self.cost = 0.0

    def update(self, t, measurement, reference):
        seen = np.concatenate([measurement[name] for name in ALL])
        x = self.from_outputs @ (seen - self.rest)
        u = -self.design.gain @ x
        self.cost += x @ self.design.weight @ x + u @ self.design.torque_weight @ u
        return u


#: Requirements with which the nonlinearity and six slow poles are visible in runs.
SLOW = {
    "acceptable": {"joint_angle": 0.01, "tip": 0.01, "joint_rate": 0.2},
    "acceptable_torque": [8.08845169, 0.86],
}


@pytest.mark.thorough
def test_cost_of_a_nonlinear_run_approaches_the_riccati_value():
    arm = arm_with_gauges()
    design = fa.LQG(arm, POSTURE, **SLOW, sample_time=SAMPLE_TIME).designs[0]
    away = arm.from_nodal([0.6, 0.5], [np.array([[0.02, 0.05]]), np.array([[-0.01, 0.02]])])
    x0 = np.concatenate([away - 0.0, np.zeros(arm.dof)])
    value = x0 @ design.cost @ x0
    x, summed = x0, 0.0
    loop = design.A - design.B @ design.gain
    for _ in range(4000):  # the slowest motion has decayed to 1e-9 by then
        u = -design.gain @ x
        summed += x @ design.weight @ x + u @ design.torque_weight @ u
        x = loop @ x
    assert summed == pytest.approx(value, rel=1e-8)
    missing = []
    hardware = fa.Hardware(instruments=[fa.Instrument(name) for name in ALL])
    for size in (0.2, 0.1, 0.05):
        controller = StateFeedback(arm, design)
        start = arm.rest(POSTURE) + size * away
        fa.simulate(
            arm,
            6.0,
            controller=controller,
            initial=start,
            hardware=hardware,
            rate=10.0,
            rtol=1e-9,
            atol=1e-12,
        )
        missing.append(controller.cost / size**2 / value - 1.0)
    # Costs of size**2 (1 + a size + b size**2): b is visible at the largest size.
    assert abs(missing[2]) < 0.6 * abs(missing[1]) < 0.6 * abs(missing[0])
    assert abs(missing[2]) < 1e-3


def test_gains_agree_with_python_control():
    control = pytest.importorskip("control")
    arm = arm_with_gauges()
    controller = fa.LQG(arm, POSTURE, sample_time=SAMPLE_TIME)
    design = controller.designs[0]
    model = fa.linearize(arm, fa.equilibrium(arm, POSTURE), outputs=["joint_angle", "strain"])
    plant = model.to_control().sample(SAMPLE_TIME)
    # Two algorithms for the exponential of a matrix with entries up to 1e5.
    np.testing.assert_allclose(design.A, plant.A, rtol=0, atol=1e-9 * np.abs(plant.A).max())
    np.testing.assert_allclose(design.B, plant.B, rtol=0, atol=1e-9 * np.abs(plant.B).max())
    # With slycot, python-control calls SG02AD without scaling. In the units of the state the
    # weights range over seven orders of magnitude, and the gains then differ by 1e-4 from a
    # solution with 60 digits. In units in which every state costs the same they have 12 digits.
    unit, torque_unit = (np.diag(each) ** -0.5 for each in (design.cost, design.torque_weight))
    scaled = plant.A * unit / unit[:, None], plant.B * torque_unit / unit[:, None]
    weight = design.weight * unit * unit[:, None]
    gain = control.dlqr(*scaled, weight, np.eye(arm.n_joints))[0] * torque_unit[:, None] / unit
    np.testing.assert_allclose(design.gain, gain, rtol=1e-9, atol=1e-9 * np.abs(gain).max())


class Shaken(fa.Controller):
    """An LQG with a random error on its torque, which records the innovations."""

    def __init__(self, controller, size):
        self.controller, self.size = controller, size
        self.sample_time = controller.sample_time

    def reset(self):
        self.controller.reset()
        self.generator = np.random.default_rng(5)
        self.innovations = []

    def update(self, t, measurement, reference):
        states = self.controller.designs[0].A.shape[0]
        foreseen = self.controller.designs[0].C @ self.controller.memory.get(
            "prediction", np.zeros(states)
        )
        torque = self.controller.update(t, measurement, reference)
        nominal = self.controller.planned(t, reference)["nominal_reading"]
        measured = np.concatenate([measurement.joint_angle, measurement.strain])
        self.innovations.append(measured - nominal - foreseen)
        return torque + self.generator.normal(0.0, self.size, 2)


@pytest.mark.thorough
def test_innovations_are_white_with_the_covariance_of_the_filter():
    arm = arm_with_gauges()
    noise = {"joint_angle": 2e-5, "strain": 1e-5}
    controller = fa.LQG(
        arm,
        POSTURE,
        measured=noise,
        disturbance={"torque": 0.05},
        sample_time=SAMPLE_TIME,
    )
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    loop = Shaken(controller, 0.05)
    instruments = [fa.Instrument(name, noise=size) for name, size in noise.items()]
    fa.simulate(
        arm,
        16.0,
        controller=loop,
        reference=hold,
        hardware=fa.Hardware(instruments=instruments, seed=3),
        rate=10.0,
    )
    seen = np.array(loop.innovations)[2000:]  # the filter's slowest motion has decayed
    wanted = controller.designs[0].innovation_covariance
    spread = np.sqrt(np.diag(wanted))
    found = seen.T @ seen / len(seen)
    # An estimated correlation of n samples has an error of 1 / sqrt(n): five times that.
    bound = 5.0 * np.sqrt(2.0 / len(seen))
    np.testing.assert_allclose(
        found / np.outer(spread, spread), wanted / np.outer(spread, spread), rtol=0, atol=bound
    )
    for lag in (1, 2, 5):
        memory = seen[lag:].T @ seen[:-lag] / len(seen)
        np.testing.assert_allclose(memory / np.outer(spread, spread), 0.0, atol=bound)


def test_nonlinear_loop_has_the_linear_poles():
    """A sum of decays z**k obeys the recurrence of the polynomial with those roots."""
    arm = arm_with_gauges()
    controller = fa.LQG(arm, POSTURE, **SLOW, sample_time=SAMPLE_TIME)
    poles = controller.loop_poles()
    assert poles[0].real < 0.0
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    run = fa.simulate(
        arm,
        2.0,
        controller=controller,
        reference=hold,
        initial=arm.rest(np.add(POSTURE, 1e-4)),
        rate=500.0,
        rtol=1e-10,
        atol=1e-15,
    )
    slow = poles[poles.real > -10.0]
    assert len(slow) == 6
    # By then the others, from -18 1/s on, have decayed by e**-18.
    x = (run.joint_angle.values - POSTURE)[run.time > 1.0][::3]

    def missed(these):
        recurrence = np.poly(np.exp(3 * SAMPLE_TIME * these)).real
        count = len(recurrence) - 1
        return np.abs(sum(c * x[count - k : len(x) - k] for k, c in enumerate(recurrence))).max()

    for wrong in (slow.real * 1.1 + 1j * slow.imag, slow.real + 1.02j * slow.imag):
        assert missed(slow) < 0.2 * missed(wrong)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:the tip rests:flexarm.AccuracyWarning")  # rigid angles
def test_integral_removes_the_error_of_a_wrong_payload():
    arm = arm_with_gauges(gravity=(0.0, -9.81))
    plant = arm_with_gauges(gravity=(0.0, -9.81), payload=fa.Payload(mass=0.1))
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    errors = {}
    for integral in (None, "joint_angle"):
        controller = fa.LQG(arm, POSTURE, integral=integral, sample_time=SAMPLE_TIME)
        run = fa.simulate(
            arm,
            12.0,
            controller=controller,
            reference=hold,
            plant=plant,
            initial=fa.equilibrium(plant, POSTURE).q,
            rate=10.0,
        )
        errors[integral] = np.abs(run.joint_angle.values[-1] - POSTURE).max()
    assert errors[None] > 1e-3
    assert errors["joint_angle"] < 1e-3 * errors[None]


@pytest.mark.thorough
def test_integral_of_the_tip_removes_its_sag():
    arm = arm_with_gauges(gravity=(0.0, -9.81))
    wanted = arm.rigid().tip(POSTURE)[:2]
    controller = fa.LQG(
        arm,
        POSTURE,
        integral="tip",
        measured={"joint_angle": 1e-4, "strain": 2e-5, "tip": 1e-3},
        sample_time=SAMPLE_TIME,
    )
    start = fa.equilibrium(arm, POSTURE).q
    hardware = fa.Hardware(
        instruments=[fa.Instrument(name) for name in ("joint_angle", "strain", "tip")]
    )
    hold = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    run = fa.simulate(
        arm,
        12.0,
        controller=controller,
        reference=hold,
        initial=start,
        hardware=hardware,
        rate=10.0,
    )
    away = np.linalg.norm(run.tip.values - wanted, axis=1)
    assert away[0] > 1e-3
    assert away[-1] < 1e-3 * away[0]


def test_preview_minimizes_the_cost_under_known_forces():
    """Against the stacked least-squares problem, solved at once."""
    arm = arm_with_gauges()
    design = fa.LQG(arm, POSTURE, sample_time=SAMPLE_TIME).designs[0]
    steps, (n, m), k = 30, design.B.shape, design.B_elastic.shape[1]
    generator = np.random.default_rng(2)
    force, x0 = generator.normal(size=(steps, k)), 1e-2 * generator.normal(size=n)
    gain = preview_gain(design, steps, 1)
    law = -design.gain @ x0 - np.einsum("mik,ik->m", gain[:, :steps], force)

    def half(weight):
        values, vectors = np.linalg.eigh(weight)
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    def residuals(torques):
        """Return square roots of the terms of the cost, with the known forces."""
        x, parts = x0, []
        for i in range(steps):
            parts += [half(design.weight) @ x, half(design.torque_weight) @ torques[i]]
            x = design.A @ x + design.B @ torques[i] + design.B_elastic @ force[i]
        return np.concatenate([*parts, half(design.cost) @ x])

    nothing = residuals(np.zeros((steps, m)))
    columns = [residuals(unit.reshape(steps, m)) - nothing for unit in np.eye(steps * m)]
    best = np.linalg.lstsq(np.array(columns).T, -nothing, rcond=None)[0].reshape(steps, m)
    # Square roots of matrices with eigenvalues over twelve decades.
    np.testing.assert_allclose(law, best[0], rtol=1e-5, atol=1e-5 * np.abs(best).max())


@pytest.mark.thorough
def test_tip_error_is_twenty_times_smaller_than_with_joint_control():
    arm = arm_with_gauges()
    motion = fa.line_motion(arm, (1.2, 0.3), (0.9, 0.6), 0.6, start_time=0.4)
    lqg = fa.LQG(
        arm,
        motion.joint_angle(0.7),
        acceptable={"tip": 0.001, "joint_rate": 0.3},
    )
    joint = fa.JointPD([40.0, 10.0], [10.0, 3.0], feedforward=fa.rigid_torque(arm, motion))
    errors = []
    for controller in (joint, lqg):
        run = fa.simulate(arm, 1.5, controller=controller, reference=motion)
        tip = np.array([arm.rigid().tip(a)[:2] for a in motion.joint_angle(run.time.values)])
        errors.append(np.sqrt(np.mean(np.sum((run.tip.values - tip) ** 2, axis=1))))
    assert errors[1] < errors[0] / 20.0


def test_scheduled_gains_at_a_node_equal_those_of_its_posture():
    arm = arm_with_gauges()
    same = {"acceptable_torque": [8.0, 1.0], "sample_time": SAMPLE_TIME}
    scheduled = fa.LQG(arm, schedule=[None, [0.5, 0.9]], **same)
    alone = fa.LQG(arm, [0.0, 0.9], **same)
    np.testing.assert_allclose(
        np.sort(scheduled.loop_poles(posture=[0.0, 0.9]).real),
        np.sort(alone.loop_poles().real),
        rtol=1e-6,
        atol=1e-6,
    )


def test_recovery_multiplies_the_acceptable_torque():
    """The fictitious torque noise of loop-transfer recovery is their product."""
    arm, exact = arm_with_gauges(), {"rigidity_uncertainty": 0.0, "disturbance": {"torque": 0.1}}
    made = [
        fa.LQG(arm, POSTURE, recovery=recovery, acceptable_torque=torque, **exact).designs[0]
        for recovery, torque in ((2.0, [8.0, 1.0]), (1.0, [16.0, 2.0]), (1.0, [8.0, 1.0]))
    ]
    np.testing.assert_allclose(made[0].estimator, made[1].estimator, rtol=1e-9, atol=1e-12)
    assert not np.allclose(made[0].estimator, made[2].estimator, rtol=0.1)


@pytest.mark.thorough
@pytest.mark.parametrize(("law", "options"), [(fa.LQG, SLOW), (fa.Composite, {})])
def test_saturated_integral_does_not_wind_up(law, options):
    class Naive(law):
        def step(self, memory, readings, inputs):
            after, torque = super().step(memory, readings, inputs)
            rise = self._rise(readings, inputs)
            return {**after, "integral": memory["integral"] + rise}, torque

    arm = arm_with_gauges()
    far = fa.joint_motion(arm, [0.6, 0.9], [0.6, 0.9], 1.0)
    overshoot, limit = [], [3.0, 1.0]
    for kind in (law, Naive):
        controller = kind(arm, POSTURE, integral=True, torque_limit=limit, **options)
        run = fa.simulate(
            arm, 6.0, controller=controller, reference=far, initial=arm.rest(POSTURE), rate=100.0
        )
        overshoot.append(float(run.joint_angle.values[:, 0].max() - 0.6))
        assert np.all(np.abs(run.torque.values) <= limit)
        if kind is law:
            np.testing.assert_allclose(run.joint_angle.values[-1], [0.6, 0.9], atol=2e-3)
    assert overshoot[0] < 0.5 * overshoot[1]


@pytest.mark.parametrize("design", [fa.LQG, fa.MPC])
def test_wrong_sample_time_names_the_property_and_is_not_set(design):
    controller = design(arm_with_gauges(), torque_limit=1.0)
    message = f"^{design.__name__}.sample_time: sample_time must be greater than 0, got 0"
    with pytest.raises(fa.InputError, match=message):
        controller.sample_time = 0.0
    assert controller.sample_time > 0.0
