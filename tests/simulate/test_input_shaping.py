"""Shaped motions leave the vibration that the theory of input shaping predicts.

Closed forms of Singer and Seering (1990) and of Singhose et al. (1994), written out here.
"""

import numpy as np
import pytest

import flexarm as fa
from arms import chain

STILL = 4.0  # s, after the end of every motion here


def one_mode(ratio=0.0):
    """Return a link with a single mode on a joint with a prescribed motion."""
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2, "modes": 1}
    return chain([1.0], damping=ratio or None, **rod)


def small_move(arm, duration=0.31):
    # So small and slow that the centrifugal term, (rate / frequency)^2, is 1e-8 of the stiffness.
    return fa.joint_motion(arm, [0.0], [1e-3], duration, start_time=0.1)


def amplitude(arm, motion, frequency_hz, ratio=0.0):
    """Return the complex amplitude of the mode in free vibration, after the motion."""
    run = fa.simulate(
        arm, STILL, prescribed={1: motion}, rate=100.0, rtol=1e-10, atol=1e-13, progress=False
    )
    omega = 2.0 * np.pi * frequency_hz
    pole = omega * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    eta, rate = run.q.values[-1, 1], run.qd.values[-1, 1]
    return (rate - np.conj(pole) * eta) / (2j * pole.imag)


def printed_impulses(method, tolerance=0.05):
    """Return the printed undamped shapers: amplitudes half a period apart."""
    V = tolerance
    return {
        "zv": [1 / 2, 1 / 2],
        "zvd": [1 / 4, 1 / 2, 1 / 4],
        "zvdd": [1 / 8, 3 / 8, 3 / 8, 1 / 8],
        "ei": [(1 + V) / 4, (1 - V) / 2, (1 + V) / 4],
    }[method]


def residual(amplitudes, detuned, ratio=0.0):
    """Return the residual vibration, %, of a system of ``detuned`` times the design frequency.

    Amplitudes are those of the system's free vibration after both motions.
    """
    design = np.pi / np.sqrt(1.0 - ratio**2)  # half a damped period, in 1 / omega
    times = design * np.arange(len(amplitudes))
    pole = detuned * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    return abs(np.sum(amplitudes * np.exp(-pole * times)))


@pytest.mark.sampled("zv")
@pytest.mark.parametrize("method", ["zv", "zvd", "zvdd", "ei"])
def test_residual_over_frequency_error_is_the_closed_form(method):
    arm = one_mode()
    hertz = float(fa.modes(arm).frequency_hz[0])
    motion = small_move(arm)
    plain = abs(amplitude(arm, motion, hertz))
    assert plain > 1e-6  # the unshaped motion causes vibration
    for detuned in (0.7, 0.9, 1.0, 1.05, 1.3):
        made = fa.shaped(motion, method=method, frequency_hz=hertz / detuned)
        left = abs(amplitude(arm, made, hertz)) / plain
        wanted = residual(printed_impulses(method), detuned)
        # The centrifugal term and the tolerance of the run.
        assert left == pytest.approx(wanted, abs=2e-5), detuned


def test_properties_of_the_three_shapers():
    """ZV: zero at the design.

    ZVD: zero slope, too. EI: the tolerance at the design, zero on both sides.
    """
    arm = one_mode()
    hertz = float(fa.modes(arm).frequency_hz[0])
    motion = small_move(arm)
    plain = abs(amplitude(arm, motion, hertz))

    def left(method, detuned, **options):
        made = fa.shaped(motion, method=method, frequency_hz=hertz / detuned, **options)
        return abs(amplitude(arm, made, hertz)) / plain

    assert left("zv", 1.0) < 1e-5
    assert left("zvd", 1.0) < 1e-5
    off = 0.01
    assert left("zv", 1.0 + off) == pytest.approx(np.pi / 2 * off, rel=0.01)  # a slope
    assert left("zvd", 1.0 + off) < 1.1 * (np.pi / 2 * off) ** 2  # none
    for tolerance in (0.02, 0.1):
        assert left("ei", 1.0, tolerance=tolerance) == pytest.approx(tolerance, abs=1e-5)
        side = np.arccos((tolerance - 1.0) / (1.0 + tolerance)) / np.pi
        assert left("ei", side, tolerance=tolerance) < 1e-5
        assert left("ei", 2.0 - side, tolerance=tolerance) < 1e-5


@pytest.mark.sampled("zv")
@pytest.mark.parametrize("method", ["zv", "zvd", "zvdd", "ei"])
def test_damped_modes(method):
    """ZV, ZVD, ZVDD by the printed K = exp(-zeta pi / sqrt(1 - zeta^2)).

    EI leaves the tolerance.
    """
    ratio = 0.12
    arm = one_mode(ratio)
    found = fa.modes(arm)
    hertz = float(found.frequency_hz[0])
    assert found.damping_ratio[0] == pytest.approx(ratio)
    K = np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    motion = small_move(arm)
    made = fa.shaped(motion, arm, method)  # of its own mode, with its damping
    plain = abs(amplitude(arm, motion, hertz, ratio))
    left = abs(amplitude(arm, made, hertz, ratio)) / plain
    if method == "ei":
        # Relative to a single impulse, which the damping over the shaper's two half periods has
        # reduced.
        assert left * K**2 == pytest.approx(0.05, abs=1e-5)
        assert residual(made.amplitudes, 1.0, ratio) == pytest.approx(left, rel=1e-3)
        return
    printed = {
        "zv": [1.0, K],
        "zvd": [1.0, 2 * K, K**2],
        "zvdd": [1.0, 3 * K, 3 * K**2, K**3],
    }[method]
    np.testing.assert_allclose(made.amplitudes, np.array(printed) / np.sum(printed), rtol=1e-12)
    assert left < 1e-5


@pytest.mark.thorough
@pytest.mark.parametrize("ratio", [0.0, 0.1])
def test_specified_insensitivity_limits_the_vibration_in_its_range(ratio):
    """The arm vibrates as the sensitivity of the shaper predicts, within the tolerance."""
    arm = one_mode(ratio)
    hertz = float(fa.modes(arm).frequency_hz[0])
    motion = small_move(arm)
    plain = abs(amplitude(arm, motion, hertz, ratio))
    given = {"method": "si", "tolerance": 0.08, "insensitivity": 0.6, "damping_ratio": ratio}
    for other in (0.7, 0.85, 1.0, 1.2, 1.3, 1.4):
        made = fa.shaped(motion, frequency_hz=hertz / other, **given)
        # (C.3) counts from the first impulse, so the decay until the last one is not a reduction.
        decay = np.exp(-2.0 * np.pi * hertz * ratio * (made.end_time - motion.end_time))
        left = decay * abs(amplitude(arm, made, hertz, ratio)) / plain
        wanted = fa.shaper_sensitivity(other, **given)[0]
        # The centrifugal term and the tolerance of the run.
        assert left == pytest.approx(wanted, abs=2e-5), other
        assert (wanted < 1.001 * 0.08) == (other < 1.35)


def test_two_modes_are_at_rest_after_the_motion():
    link = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=2, modes=2)
    arm = fa.Arm(links=[link])
    motion = small_move(arm, 0.05)

    def energy(given):
        run = fa.simulate(arm, 2.0, prescribed={1: given}, rate=100.0, rtol=1e-10, atol=1e-13)
        return float((run.kinetic_energy + run.strain_energy)[-1])

    plain = energy(motion)
    first = energy(fa.shaped(motion, arm, "zv"))
    both = energy(fa.shaped(motion, arm, "zv", modes=2))
    assert first > 1e-4 * plain  # the second mode matters
    assert both < 1e-9 * plain


@pytest.mark.thorough
@pytest.mark.parametrize("profile", ["quintic", "trapezoidal"])
def test_frequency_that_changes_along_the_motion(profile):
    """A folding elbow raises the lowest frequency by half; impulses follow its phase."""
    rod = {"flexural_rigidity": 600.0, "mass_per_length": 0.5, "elements": 1}
    arm = fa.Arm(
        links=[
            fa.Link(length=1.0, **rod),
            fa.Link(length=1.0, flexible=False, mass_per_length=0.5),
        ],
        joints=[fa.Joint(), fa.Joint(mass=0.5)],
        payload=fa.Payload(mass=1.0),
    )
    start, end = [0.0, 0.2], [0.1, 2.6]
    hertz = [float(fa.modes(arm, angles).frequency_hz[0]) for angles in (start, end)]
    assert hertz[1] > 1.4 * hertz[0]
    motion = fa.joint_motion(arm, start, end, 1.2, profile)

    def energy(given):
        run = fa.simulate(arm, 4.0, prescribed={1: given, 2: given}, rate=50.0)
        return float((run.kinetic_energy + run.strain_energy)[-1])

    plain = energy(motion)
    followed = energy(fa.shaped(motion, arm))
    of_start = energy(fa.shaped(motion, frequency_hz=hertz[0]))
    of_end = energy(fa.shaped(motion, frequency_hz=hertz[1]))
    assert followed < 0.05 * plain
    assert followed < 0.3 * min(of_start, of_end)


@pytest.mark.sampled("moving_average-1.0")
@pytest.mark.parametrize(("window", "turns"), [("moving_average", 1.0), ("raised_cosine", 2.0)])
def test_average_over_whole_periods_leaves_no_vibration(window, turns):
    arm = one_mode()
    hertz = float(fa.modes(arm).frequency_hz[0])
    motion = small_move(arm)
    plain = abs(amplitude(arm, motion, hertz))
    left = abs(amplitude(arm, fa.smoothed(motion, turns / hertz, window), hertz))
    assert left < 1e-5 * plain
    # Otherwise the transform of the window.
    x = 0.6  # radians in the window
    sinc = np.sinc(x)
    wanted = abs(sinc if window == "moving_average" else sinc / (1.0 - x**2))
    left = abs(amplitude(arm, fa.smoothed(motion, x / hertz, window), hertz))
    assert left / plain == pytest.approx(wanted, abs=1e-5)


def two_links():
    link = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    joints = [fa.Joint(hub_inertia=0.05), fa.Joint(mass=0.8, hub_inertia=0.01)]
    return fa.Arm(links=[fa.Link(length=length, **link) for length in (0.8, 0.6)], joints=joints)


@pytest.mark.thorough
def test_overdamped_modes_are_named():
    arm = two_links()
    motion = fa.joint_motion(arm, [0.2, 0.9], [0.8, 0.4], 0.6)
    gains = fa.JointPD([200.0, 60.0], [15.0, 3.0])
    ratios = fa.track_modes(arm, motion, gains, count=4, samples=49).damping_ratio.max(axis=0)
    over = int(np.flatnonzero(ratios >= 1.0)[0])
    text = (
        f"modes must be vibrations.*got mode {over + 1} with the damping ratio {ratios[over]:.3g}"
    )
    with pytest.raises(fa.InputError, match=text):
        fa.shaped(motion, arm, modes=over + 1, joints=gains)
    assert fa.shaped(motion, arm, modes=over, joints=gains).end_time > motion.end_time


@pytest.mark.filterwarnings("ignore:.*between the contacts:flexarm.FlexarmWarning")
def test_free_rotation_in_a_backlash_is_not_a_vibration():
    drive = {"rotor_inertia": 2e-5, "gear_ratio": 80.0, "stiffness": 900.0, "damping": 0.5}
    link = fa.Link(length=0.6, flexural_rigidity=20.0, mass_per_length=0.5)
    arm = fa.Arm(links=[link], joints=[fa.Joint(**drive, backlash=0.01)])
    motion = fa.joint_motion(arm, [0.0], [0.5], 0.8)
    with pytest.raises(fa.InputError, match="got mode 1 with the damping ratio"):
        fa.shaped(motion, arm, "zvdd")
