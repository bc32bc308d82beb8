"""Structural damping over time: the measured logarithmic decrement equals the specified one."""

import numpy as np
import pytest

import flexarm as fa

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
CLAMPED = {1: fa.PrescribedAngle(lambda t: 0.0, lambda t: 0.0, lambda t: 0.0)}


def clamped(damping, **fields):
    link = fa.Link(length=1.0, elements=4, damping=damping, **ROD, **fields)
    return fa.Arm(links=[link])


def measured_ratio(times, signal):
    """Return the damping ratio of a decaying oscillation from its extremes (parabolas through
    samples)."""
    middle = signal[1:-1]
    peaks = np.flatnonzero((abs(middle) > abs(signal[:-2])) & (abs(middle) >= abs(signal[2:]))) + 1
    a, b, c = signal[peaks - 1], signal[peaks], signal[peaks + 1]
    heights = abs(b - (a - c) ** 2 / (8 * (a - 2 * b + c)))
    # Two extremes in each period.
    slope = np.polyfit(np.arange(len(heights)), np.log(heights), 1)[0]
    decrement = -2.0 * slope
    return decrement / np.hypot(2.0 * np.pi, decrement)


def ring(arm, mode, prescribed, periods=8.0):
    """Return times and coordinate of the free vibration of one mode."""
    promised = fa.modes(arm)
    start = arm.rest(np.zeros(arm.n_joints)) + 1e-3 * promised.shapes[mode]
    frequency = promised.frequency_hz[mode]
    result = fa.simulate(
        arm,
        periods / frequency,
        initial=start,
        prescribed=prescribed,
        rate=60.0 * frequency,
        rtol=1e-9,
        atol=1e-12,
    )
    shape = promised.shapes[mode]
    signal = result.q.values @ (arm.mass_matrix(start) @ shape)
    return result.time.values, signal, promised


@pytest.mark.parametrize("mode", [0, 1, 2])
@pytest.mark.parametrize(
    "damping",
    [
        fa.ModalDamping(ratio=[0.01, 0.03, 0.05]),
        fa.RayleighDamping(mass_coefficient=2.0, stiffness_coefficient=1e-4),
        fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=2e-4),  # Kelvin-Voigt
        fa.RayleighDamping(mass_coefficient=1.5, stiffness_coefficient=0.0),
    ],
)
def test_decay_of_a_clamped_link(damping, mode):
    arm = clamped(damping)
    times, signal, promised = ring(arm, mode, CLAMPED)
    omega = 2.0 * np.pi * promised.frequency_hz[mode]
    if damping.kind == "modal":
        formula = damping.ratio[mode]
    else:
        formula = (damping.mass_coefficient / omega + damping.stiffness_coefficient * omega) / 2
    assert promised.damping_ratio[mode] == pytest.approx(formula, rel=1e-9)
    # Peaks by parabolas through 60 samples a period.
    assert measured_ratio(times, signal) == pytest.approx(formula, rel=1e-3)


def test_kelvin_voigt_damping_belongs_to_the_material():
    """Damping beta E I v''' beside E I v'': the ratio is beta omega / 2 for every link of the same
    bar."""
    beta = 2e-4
    damping = fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=beta)
    short = fa.modes(clamped(damping))
    for segments in (2, 4):
        cut = fa.modes(clamped(damping, segments=segments))
        # Segments of a linear link do not change it, nor its damping: a stiffness coefficient does
        # what modal ratios of each segment cannot.
        omega = 2.0 * np.pi * cut.frequency_hz[:3]
        np.testing.assert_allclose(cut.damping_ratio[:3], beta * omega / 2, rtol=1e-6)
        np.testing.assert_allclose(cut.frequency_hz[:3], short.frequency_hz[:3], rtol=1e-9)


def test_decay_of_two_links_with_locked_joints():
    """The lowest mode of the chain; `modes` takes its ratio from its shape."""
    damping = fa.RayleighDamping(mass_coefficient=0.5, stiffness_coefficient=1e-3)
    links = [fa.Link(length=1.0, elements=2, damping=damping, **ROD)] * 2
    arm = fa.Arm(links=links)
    hold = {1: CLAMPED[1], 2: CLAMPED[1]}
    times, signal, promised = ring(arm, 0, hold)
    # Mass damping acts on each link's own motion, which couples the modes slightly.
    assert measured_ratio(times, signal) == pytest.approx(promised.damping_ratio[0], rel=0.01)
    assert promised.damping_ratio[0] > 0.005


def test_joint_damping_slows_exponentially():
    link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    arm = fa.Arm(links=[link], joints=[fa.Joint(damping=0.7)])
    result = fa.simulate(arm, 3.0, initial_rate=[2.0], rate=100)
    exact = 2.0 * np.exp(-0.7 * result.time.values)
    np.testing.assert_allclose(result.joint_rate.values[:, 0], exact, rtol=1e-6)
