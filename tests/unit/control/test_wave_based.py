"""Wave-based control against the block diagram of O'Connor, by python-control."""

import control
import numpy as np
import pytest
from strain_loops import TICK, base_driven, closed_poles, continuous, echo, modal_law, one_link

import flexarm as fa
from flexarm.control.analysis.margins import loop_at
from flexarm.control.hardware.measurement import Measurement


def test_law_is_the_published_block_diagram():
    """O'Connor (2007): half of the target is launched, and the returning wave is added.

    x0 = r / 2 + b, b = (x0 - integral of the force / Z) / 2, for a mass at a spring and the
    impedance Z = sqrt(stiffness mass). The mass follows by w^2 / (s^2 + w s + w^2), the transfer
    function with which the source separates the waves.
    """
    sampled, omega = modal_law(fa.WaveBasedControl, leakage=0.0)  # the default damping ratio
    law = continuous(sampled)
    mass = control.tf([omega**2], [1.0, 0.0, omega**2])
    force = omega**2 * (1.0 - mass)
    impedance = omega  # of a unit mass
    returning = 0.5 * (1.0 - force / (impedance * control.tf([1.0, 0.0], [1.0])))
    published = mass * control.feedback(0.5, 2.0 * returning, sign=1)
    printed = control.tf([omega**2], [1.0, omega, omega**2])
    ours = mass * control.feedback(1.0, law * base_driven(omega), sign=1)
    for w in omega * np.array([0.1, 0.5, 0.9, 1.3, 4.0]):
        assert complex(published(1j * w)) == pytest.approx(complex(printed(1j * w)), rel=1e-9)
        # The law is read by differences of strains, whose rounding is 1e-8 of it.
        assert complex(ours(1j * w)) == pytest.approx(complex(printed(1j * w)), rel=1e-6)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9])
def test_poles_have_the_requested_damping(ratio):
    sampled, omega = modal_law(fa.WaveBasedControl, damping_ratio=ratio, leakage=0.0)
    found = closed_poles(continuous(sampled), base_driven(omega))
    found = found[np.argsort(found.imag)]
    pair = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
    wanted = [np.conj(pair), 0.0, pair]  # the integral of the strain has no effect at rest
    np.testing.assert_allclose(found, wanted, atol=1e-6 * omega)


def test_stiff_joint_damps_all_modes_of_a_link():
    """A joint loop of 240 Hz around modes of 3.6, 23 and 63 Hz; only the first is designed."""
    arm, w = one_link(3), 1500.0
    inner = fa.JointPD(5.0 * w**2, 7.0 * w, sample_time=TICK)
    poles = loop_at(fa.WaveBasedControl(arm, inner, leakage=0.0), arm, np.zeros(1)).poles()
    poles = poles[poles.imag > 1.0]
    lowest = poles[np.argmin(abs(poles))]
    # Higher modes yield quasi-statically to the motion of the joint and change the damping a bit.
    assert -lowest.real / abs(lowest) == pytest.approx(0.5, abs=0.02)
    found = fa.modes(arm).frequency_hz
    higher = poles[(abs(poles) > np.pi * found[1]) & (abs(poles) < 3.0 * np.pi * found[2])]
    assert len(higher) == 2
    assert (higher.real < 0.0).all()


@pytest.mark.thorough
def test_joint_returns_to_a_target_that_is_given_at_once():
    """Without leakage the momentum of the moved link is zero at the end, and so is the motion."""
    arm = one_link()
    target = fa.joint_motion(arm, [0.05], [0.05 + 1e-9], 0.1)  # constant, where the arm is not
    inner = fa.JointPD(5.0 * 200.0**2, 10.0 * 0.7 * 200.0)
    ends, swings = [], []
    for controller in (inner, fa.WaveBasedControl(arm, inner, leakage=0.0)):
        run = fa.simulate(
            arm, 4.0, controller=controller, reference=target, initial=arm.rest([0.0]), rate=200.0
        )
        late = run.tip.values[run.time.values > 2.0, 1]
        ends.append(run.joint_angle.values[-1, 0])
        swings.append(np.ptp(late))
    assert ends[1] == pytest.approx(0.05, abs=3e-4)  # the joints are late by two milliseconds
    assert swings[0] > 0.05
    assert swings[1] < 1e-3 * swings[0]


def test_constant_strain_turns_the_joint_by_a_limited_angle():
    arm, strain = one_link(), 1e-5
    omega = 2.0 * np.pi * fa.modes(arm).frequency_hz[0]
    controller = fa.WaveBasedControl(arm, echo(), leakage=0.8)
    reading = {"joint_angle": np.zeros(1), "joint_rate": np.zeros(1)}
    found = [
        float(controller.update(k * TICK, Measurement(strain=np.array([s]), **reading), None)[0])
        for k, s in enumerate([strain] * 5000)
    ]
    slope = (found[1] - found[0]) / TICK
    assert found[-1] == pytest.approx(slope / (0.8 * omega), rel=2e-3)
    assert abs(found[-1]) > 1e-6
