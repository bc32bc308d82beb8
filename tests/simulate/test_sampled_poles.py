"""Closed loops against theory: poles of the sampled loop, and the equation of the error.

python-control samples the linear model with a zero-order hold; the controllers are written out as
difference equations. A run of the nonlinear arm from a small deviation must follow the sampled
loop: each mode has its own pole, decay and frequency in one complex number.
"""

import control
import numpy as np
import pytest

import flexarm as fa
from arms import chain

TICK = 0.002
ANGLES = np.array([0.3, 0.8])


def arm():
    rod = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    joints = [0.05, {"hub_inertia": 0.05, "mass": 0.2}]
    return chain((0.8, 0.6), joints, gauge=(0.0, 0.005), **rod)


def sampled_plant(model_arm):
    """Return Phi, Gamma over one sample time, and rows for angles, rates and strains of the
    state."""
    outputs = ["joint_angle", "joint_rate", "strain"]
    model = fa.linearize(model_arm, model_arm.rest(ANGLES), outputs=outputs)
    held = control.c2d(model.to_control(), TICK, "zoh")
    C = np.asarray(held.C)
    return np.asarray(held.A), np.asarray(held.B), C[:2], C[2:4], C[4:]


def joint_pd():
    K, D = np.diag([30.0, 12.0]), np.diag([3.0, 1.0])

    def loop(Phi, Gamma, angle, rate, strain):
        return Phi - Gamma @ (K @ angle + D @ rate)

    return fa.JointPD(np.diag(K), np.diag(D), sample_time=TICK), loop, 0


def joint_pid():
    K, D, held = np.diag([30.0, 12.0]), np.diag([3.0, 1.0]), np.diag([25.0, 10.0])

    def loop(Phi, Gamma, angle, rate, strain):
        """State and the integral's torque, which adds the error after it is used."""
        return np.block(
            [[Phi - Gamma @ (K @ angle + D @ rate), Gamma], [-held * TICK @ angle, np.eye(2)]]
        )

    return fa.JointPID(np.diag(K), np.diag(D), np.diag(held), sample_time=TICK), loop, 2


def computed_torque():
    frequency, ratio = 1.5, 0.8
    w = 2.0 * np.pi * frequency
    M = arm().rigid().mass_matrix(ANGLES)

    def loop(Phi, Gamma, angle, rate, strain):
        return Phi - Gamma @ M @ (w**2 * angle + 2.0 * ratio * w * rate)

    return fa.ComputedTorque(arm(), frequency, ratio, sample_time=TICK), loop, 0


def strain_feedback():
    K, D = np.diag([30.0, 12.0]), np.diag([3.0, 1.0])
    S, R, cutoff = np.diag([1.5e3, 400.0]), np.diag([4.0, 2.0]), 60.0
    lag = 1.0 / (2.0 * np.pi * cutoff)
    kept, gain = (2 * lag - TICK) / (2 * lag + TICK), 2.0 / (2 * lag + TICK)

    def loop(Phi, Gamma, angle, rate, strain):
        """State, previous strain and its rate: rate = kept rate' + gain (strain - strain')."""
        now = K @ angle + D @ rate + S @ strain + gain * R @ strain
        return np.block(
            [
                [Phi - Gamma @ now, gain * Gamma @ R, -kept * Gamma @ R],
                [strain, np.zeros((2, 4))],
                [gain * strain, -gain * np.eye(2), kept * np.eye(2)],
            ]
        )

    controller = fa.StrainFeedback(
        np.diag(K), np.diag(D), S, R, rate_cutoff=cutoff, sample_time=TICK
    )
    return controller, loop, 4


CASES = [joint_pd, joint_pid, computed_torque, strain_feedback]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_small_motion_follows_the_poles_of_the_sampled_loop(case):
    controller, loop, memory = case()
    flexible = arm()
    closed = loop(*sampled_plant(flexible))
    poles, vectors = np.linalg.eig(closed)
    assert abs(poles).max() < 1.0  # these gains are stable
    ticks = 60
    rng = np.random.default_rng(1)
    small = 1e-5
    deviation = small * rng.normal(size=(2, flexible.dof))
    # Bending of a size that matches these angles, without rates.
    deviation[0] *= np.where(np.isin(np.arange(flexible.dof), flexible.joint_index), 1.0, 0.05)
    deviation[1] = 0.0
    reference = fa.joint_motion(flexible, ANGLES, ANGLES, 1.0)
    run = fa.simulate(
        flexible,
        ticks * TICK,
        controller=controller,
        reference=reference,
        initial=flexible.rest(ANGLES) + deviation[0],
        rate=1.0 / TICK,
        rtol=1e-11,
        atol=1e-15,
    )
    found = np.concatenate([run.q.values - flexible.rest(ANGLES), run.qd.values], axis=1)
    x = np.concatenate([found[0], np.zeros(memory)])
    if memory == 4:  # the filter starts from the first strain
        x[-4:-2] = run.strain.values[0]
    wanted = [x]
    for _ in range(ticks):
        wanted.append(closed @ wanted[-1])
    wanted = np.array(wanted)
    np.testing.assert_allclose(
        # Products of small deviations, 1e-5 of them, and the run's tolerance.
        found,
        wanted[:, : found.shape[1]],
        rtol=0,
        atol=2e-4 * np.abs(found).max(axis=0).max(),
    )
    if memory:
        return
    # Mode by mode: its left eigenvector selects one mode, which its pole multiplies at each sample.
    seen = found @ np.linalg.inv(vectors).T
    strong = np.abs(seen[:-1]) > 1e-3 * np.abs(seen[0]).max()
    for k, pole in enumerate(poles):
        steps = (seen[1:, k] / seen[:-1, k])[strong[:, k]]
        if steps.size > 5:
            assert abs(np.median(steps.real) + 1j * np.median(steps.imag) - pole) < 1e-3


@pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning")
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # of the fast growth
def test_critical_gain_of_the_sampled_loop():
    """Errors decay slightly below it and grow slightly above it."""
    flexible = arm()
    Phi, Gamma, angle, rate, _ = sampled_plant(flexible)

    def radius(gain):
        D = np.diag([gain, 0.3 * gain])
        return abs(np.linalg.eigvals(Phi - Gamma @ (30.0 * angle + D @ rate))).max()

    low, high = 2.0, 400.0
    assert radius(low) < 1.0 < radius(high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 else (low, middle)
    grown = []
    for gain in (0.97 * low, 1.03 * low):
        controller = fa.JointPD(30.0, [gain, 0.3 * gain], sample_time=TICK)
        start = flexible.rest(ANGLES + 1e-6)
        reference = fa.joint_motion(flexible, ANGLES, ANGLES, 1.0)
        run = fa.simulate(
            flexible, 0.6, controller=controller, reference=reference, initial=start, rate=1 / TICK
        )
        fast = np.abs(np.diff(run.torque.values, axis=0)).max(axis=1)
        grown.append(fast[-50:].max() / fast[20:70].max())
    assert grown[0] < 0.5
    assert grown[1] > 2.0


def test_error_of_computed_torque_obeys_its_equation():
    """A rigid arm with a large motion and an initial error: first order in the sample time, then
    exact."""
    rigid = fa.Arm(links=arm().spec.links, joints=arm().spec.joints, gravity=(0.0, -9.81)).rigid()
    motion = fa.joint_motion(rigid, [0.2, -0.5], [1.4, 0.9], 0.8)
    off = np.array([0.2, -0.1])
    frequency, ratio = np.array([1.5, 2.5]), np.array([0.6, 1.0])
    w = 2.0 * np.pi * frequency
    t = np.linspace(0.0, 1.0, 51)[:, None]
    wd = w[0] * np.sqrt(1.0 - ratio[0] ** 2)
    wanted = np.empty((51, 2))
    wanted[:, 0] = (
        off[0]
        * np.exp(-ratio[0] * w[0] * t[:, 0])
        * (np.cos(wd * t[:, 0]) + ratio[0] * w[0] / wd * np.sin(wd * t[:, 0]))
    )
    wanted[:, 1] = off[1] * np.exp(-w[1] * t[:, 0]) * (1.0 + w[1] * t[:, 0])
    missed = []
    for tick in (4e-3, 2e-3, 1e-3, 5e-4):
        controller = fa.ComputedTorque(rigid, frequency, ratio, sample_time=tick)
        run = fa.simulate(
            rigid,
            1.0,
            controller=controller,
            reference=motion,
            initial=rigid.rest(motion.joint_angle(0.0) + off),
            rate=50.0,
        )
        error = run.joint_angle.values - motion.joint_angle(run.time.values)
        missed.append(np.abs(error - wanted).max())
    orders = np.log2(np.array(missed[:-1]) / missed[1:])
    # The hold delays the torque by half a sample: first order.
    np.testing.assert_allclose(orders, 1.0, atol=0.1)
    assert missed[-1] < 2e-3
