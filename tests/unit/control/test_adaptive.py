"""Adaptive control on rigid arms, where its theory is exact: page "Control under uncertainty"."""

import numpy as np
import pytest
from rigid_loops import Swing, errors, rigid_arm
from scipy.optimize import least_squares

import flexarm as fa
from flexarm.control.design.rigid_model import RigidParameters, parameter_names
from oracles.rigid_double_pendulum import ABSOLUTE

ANGLE, RATE = np.array([0.4, -0.9]), np.array([1.3, -2.1])
WANTED_RATE, WANTED_ACCELERATION = np.array([0.7, 0.2]), np.array([3.0, 5.0])
NAMES = ("joint_2.coulomb", "payload.mass", "link_1.inertia", "link_2.first_moment")


def test_regressor_columns_add_up_to_the_inverse_dynamics():
    friction = fa.Friction(coulomb=0.3, static=0.5, viscous=0.1)
    other = fa.Friction(coulomb=0.2, coulomb_negative=0.4, viscous_negative=0.3)
    joints = [
        fa.Joint(hub_inertia=0.1, friction=friction, damping=0.2),
        fa.Joint(mass=0.4, rotor_inertia=1e-3, gear_ratio=20.0, friction=other),
    ]
    for offset in ((0.0, 0.0), (0.05, 0.02)):
        arm = rigid_arm(joints=joints)
        payload = fa.Payload(mass=0.7, inertia=0.01, offset=offset)
        arm = fa.Arm(arm.spec.replace(payload=payload))
        for names in ((), NAMES, parameter_names(arm)):
            model = RigidParameters(arm, names)
            rows = model.regressor(ANGLE, RATE, RATE, WANTED_ACCELERATION)
            found = rows[: model.known].sum(axis=0) + model.values @ rows[model.known :]
            wanted = arm.inverse_dynamics(ANGLE, RATE, WANTED_ACCELERATION)
            np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-13)  # of up to 30 N m


@pytest.mark.parametrize("name", NAMES)
def test_regressor_column_is_the_effect_of_a_unit_of_its_parameter(name):
    arm = rigid_arm(payload=0.5)
    # The rates exceed the smoothing rate so far that the sign is exact.
    model = RigidParameters(arm, NAMES, np.full(2, 0.01))
    column = model.regressor(ANGLE, RATE, RATE, WANTED_ACCELERATION)[2 + NAMES.index(name)]
    if name == "link_2.first_moment":  # no input of users changes it alone: closed form
        np.testing.assert_allclose(column, _by_first_moment_2(), rtol=1e-12)
        return
    changed = {
        "joint_2.coulomb": fa.varied(arm, friction=[None, fa.Friction(coulomb=1.0)]),
        "payload.mass": fa.varied(arm, payload_mass=1.5),
        "link_1.inertia": fa.Arm(
            arm.spec.replace(joints=[fa.Joint(hub_inertia=1.05), arm.spec.joints[1]])
        ),
    }[name]
    more = changed.inverse_dynamics(ANGLE, RATE, WANTED_ACCELERATION)
    less = arm.inverse_dynamics(ANGLE, RATE, WANTED_ACCELERATION)
    np.testing.assert_allclose(column, more - less, rtol=1e-12, atol=1e-13)


def _by_first_moment_2():
    """Return the column of m2 x2 from Lagrange's equations (``oracles.rigid_double_pendulum``)."""
    a1, a2 = ABSOLUTE @ ANGLE
    w1, w2 = ABSOLUTE @ RATE
    v1, v2 = ABSOLUTE @ WANTED_ACCELERATION
    length, cosine, sine = 0.8, np.cos(a1 - a2), np.sin(a1 - a2)
    first = length * (cosine * v2 + sine * w2**2)
    second = length * (cosine * v1 - sine * w1**2) + 9.81 * np.cos(a2)
    return ABSOLUTE.T @ [first, second]


def test_centrifugal_matrix_has_christoffel_symbols():
    """dM/dt - 2 C is skew, without which Lyapunov's function would not decrease."""
    arm = rigid_arm(payload=0.5, gravity=(0.0, 0.0))
    model, still = RigidParameters(arm), np.zeros(2)
    C = np.stack([model.regressor(ANGLE, RATE, e, still)[0] for e in np.eye(2)], axis=1)
    step = 1e-6  # central differences of cosines: error 1e-12 times rates
    ahead, behind = arm.mass_matrix(ANGLE + step * RATE), arm.mass_matrix(ANGLE - step * RATE)
    skew = (ahead - behind) / (2 * step) - 2 * C
    np.testing.assert_allclose(skew + skew.T, 0.0, atol=1e-8)
    assert abs(skew[0, 1]) > 0.1
    np.testing.assert_allclose(C @ RATE, arm.bias_force(ANGLE, RATE), rtol=1e-12)


class Kept(fa.Adaptive):
    """Records the terms of Lyapunov's function."""

    def reset(self):
        super().reset()
        self.s, self.a = [], []

    def step(self, memory, readings, inputs):
        self.a.append(memory["estimate"].tolist())
        self.s.append(self._slid(memory, readings, inputs)[1].s)
        return super().step(memory, readings, inputs)


PARAMETERS = ("payload.mass", "joint_1.viscous", "joint_2.viscous")
TRUE = np.array([0.9, 0.6, 0.4])


def learning(duration, sample_time, **options):
    arm = rigid_arm(payload=0.3)
    friction = [fa.Friction(coulomb=0.0, viscous=v) for v in TRUE[1:]]
    plant = fa.varied(arm, payload_mass=TRUE[0], friction=friction)
    controller = Kept(
        arm, 5.0, [4.0, 2.0], [0.05, 0.3, 0.3], PARAMETERS, sample_time=sample_time, **options
    )
    swing = Swing()
    run = fa.simulate(
        arm,
        duration,
        controller=controller,
        reference=swing,
        plant=plant,
        initial=plant.rest([0.3, -0.2]),
        rate=1.0 / sample_time,
    )
    return plant, controller, run, swing


@pytest.mark.thorough
def test_lyapunovs_function_decreases_by_the_power_of_the_damping():
    sample_time = 2e-4
    plant, controller, run, _ = learning(2.0, sample_time)
    s, a = np.array(controller.s), np.array(controller.a)
    M = np.array([plant.mass_matrix(q) for q in run.joint_angle.values[:-1]])
    V = 0.5 * np.einsum("ti,tij,tj->t", s, M, s)
    V += 0.5 * np.sum((a - TRUE) ** 2 / controller.adaptation, axis=1)
    # Friction is learned at the reference rate: its part proportional to s adds damping.
    damping = controller.damping + TRUE[1:]
    taken = np.concatenate([[0.0], np.cumsum(np.sum(damping * s**2, axis=1))])[:-1]
    # Torques are constant for 0.2 ms: V differs from its law by terms of first order in the sample
    # time.
    np.testing.assert_allclose(V + sample_time * taken, V[0], rtol=5e-3)
    assert np.all(np.diff(V) < 1e-5 * V[0])
    assert V[-1] < 0.5 * V[0]


@pytest.mark.thorough
def test_parameters_and_motion_converge_under_excitation():
    _, controller, run, swing = learning(20.0, 1e-3)
    # The error of sampling: the torque is late by half a millisecond on the average.
    np.testing.assert_allclose(list(controller.estimate.values()), TRUE, rtol=0.02)
    angle, _ = errors(run, swing)
    assert abs(angle[-2000:]).max() < 1e-3
    assert abs(angle[:500]).max() > 0.2


@pytest.mark.thorough
def test_estimates_are_bounded_and_leak_back():
    _, bounded, _, _ = learning(3.0, 1e-3, bounds={"payload.mass": (0.2, 0.5)})
    mass = np.array(bounded.a)[:, 0]
    assert mass.max() == 0.5
    assert mass.min() >= 0.2
    _, leaking, _, _ = learning(3.0, 1e-3, leakage=1e3)
    assert abs(np.array(leaking.a) - [0.3, 0.0, 0.0]).max() < 0.01


def test_errors_within_the_dead_zone_do_not_change_estimates():
    _, controller, _, _ = learning(1.0, 1e-3, dead_zone=100.0)
    np.testing.assert_array_equal(np.array(controller.a), [[0.3, 0.0, 0.0]] * 1000)


def strained_poles(arm, bandwidth, damping, gain):
    """Return poles (1/s) of the linear arm with the control law at rest.

    Filters are in continuous time: washout at 0.5 Hz, noise at 100 Hz; the model is the rigid
    bar's inertia.
    """
    model = fa.linearize(arm, outputs=["joint_angle", "joint_rate", "strain"])
    n = len(model.A)
    angle, rate, strain = (np.append(row, [0.0, 0.0]) for row in model.C)
    slow, fast = np.eye(n + 2)[n:]
    curvature = -strain / arm.gauges[0][2]
    slow_rate = 2.0 * np.pi * 0.5 * (gain * curvature - slow)
    fast_rate = 2.0 * np.pi * 100.0 * (gain * curvature - slow - fast)
    inertia = float(arm.rigid().mass_matrix([0.0])[0, 0])
    torque = inertia * (fast_rate - bandwidth * rate) - damping * (rate + bandwidth * angle - fast)
    A = np.zeros((n + 2, n + 2))
    A[:n, :n] = model.A
    A[:n] += model.B @ torque[None]
    A[n:] = slow_rate, fast_rate
    return np.linalg.eigvals(A)


def test_strain_feedback_gives_the_damping_of_the_linear_poles():
    """After the motion the first mode vibrates on a constant joint; strain feedback damps it."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 2}
    gauges = [fa.Gauge(station=0.02, distance=0.005)]
    arm = fa.Arm(
        links=[fa.Link(length=1.4142, gauges=gauges, **rod)], joints=[fa.Joint(hub_inertia=0.1)]
    )
    motion = fa.joint_motion(arm, [0.0], [0.5], 0.5)
    decays = []
    for gain in (0.0, 2.0):
        controller = fa.Adaptive(arm, 5.0, 80.0, 0.0, strain_gain=gain, washout=0.5)
        run = fa.simulate(arm, 2.0, controller=controller, reference=motion)
        late = run.link_tip_deflection.sel(time=slice(0.6, None))
        t, bent = late.time.values - 0.6, late.values[:, 0]
        poles = strained_poles(arm, 5.0, 80.0, gain)
        ringing = poles[poles.imag > 1.0]
        first = ringing[np.argmin(ringing.imag)]
        slow = poles[(abs(poles.imag) < 1e-9) & (poles.real < -1.0) & (poles.real > -30.0)].real

        def missed(pole, t=t, bent=bent, slow=slow):
            """Return the part that one vibration and slow terms do not explain; all are fitted
            except the pole."""
            swing = np.exp(-pole[0] * t)[:, None] * np.stack(
                [np.cos(pole[1] * t), np.sin(pole[1] * t)], axis=1
            )
            columns = np.hstack([swing, np.exp(np.outer(t, slow))])
            return columns @ np.linalg.lstsq(columns, bent)[0] - bent

        found = least_squares(missed, [3.0, 20.0]).x
        # A torque that is late by half a millisecond changes the decay by less than a hundredth.
        np.testing.assert_allclose(found, [-first.real, first.imag], rtol=0.01)
        decays.append(found[0])
    assert decays[1] > 2.0 * decays[0]
