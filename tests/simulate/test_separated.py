"""The separation of rigid and elastic motion against full simulation, on the paper's motion."""

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm
from plausible_arms import plausible_spec


def paper_line(arm, duration, **fields):
    return fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=duration, **fields)


def deflection_error(duration, **fields):
    """Return the largest error of the link tips' deflection, and the largest deflection, m."""
    arm = table_one_arm()
    line = paper_line(arm, duration)
    full = fa.simulate(arm, duration, torque=fa.rigid_torque(arm, line))
    parts = fa.simulate_separated(arm, line, **fields)
    error = np.abs((parts - full).link_tip_deflection.values).max()
    return error, np.abs(full.link_tip_deflection.values).max()


# Durations: half the paper's, the paper's, twice as long. The measured parts are 0.102, 0.027 and
# 0.008: the linear model omits terms quadratic in the deflection, which is about 1 / T^2.
@pytest.mark.sampled("1.0-0.11")
@pytest.mark.parametrize(("duration", "share"), [(1.0, 0.11), (2.0, 0.03), (4.0, 0.009)])
def test_error_on_the_papers_motion(duration, share):
    error, largest = deflection_error(duration)
    assert 0.5 * share < error / largest < share


@pytest.mark.thorough
def test_error_is_quadratic_in_the_deflection():
    """Twenty times as stiff as the paper's arm, and ten times."""
    shares, largest = [], []
    for rigidity in (2000.0, 1000.0):
        arm = table_one_arm(rigidity)
        line = paper_line(arm, 1.0)
        full = fa.simulate(arm, 1.0, torque=fa.rigid_torque(arm, line))
        parts = fa.simulate_separated(arm, line, rtol=1e-5)
        shares.append(np.abs((parts - full).q.values).max())
        largest.append(np.abs(full.link_tip_deflection.values).max())
    order = np.log(shares[1] / shares[0]) / np.log(largest[1] / largest[0])
    assert 1.7 < order < 2.5  # two, except for the phase of the vibration


def test_quasi_static_estimate_of_a_slow_motion():
    """It omits the vibration that the start excites: a tenth of the deflection."""
    error, largest = deflection_error(4.0, method="quasi_static")
    assert error < 0.04 * largest


@pytest.mark.thorough
def test_small_deviations_at_rest():
    """The error is quadratic in the deviation."""
    arm = table_one_arm(gravity=(0.0, 0.0))
    line = paper_line(arm, 1.0, start_time=10.0)
    errors = []
    for size in (1e-3, 1e-4):
        away = size * np.array([0.3, 0.1, 0.0, 0.0, 0.0, -0.5, 0.1, 0.0])
        start = arm.rest(line.joint_angle(0.0)) + away
        full = fa.simulate(arm, 0.3, initial=start, rtol=1e-11, atol=1e-13)
        parts = fa.simulate_separated(arm, line, 0.3, initial_deviation=away, rtol=1e-7)
        errors.append(np.abs((parts - full).q.values).max())
    assert errors[1] < 0.02 * errors[0]  # a hundredth, and a factor of two for rounding


def test_locked_joints_equal_prescribed_ones():
    arm = table_one_arm(rigidity=2000.0)
    line = paper_line(arm, 1.0, profile="trapezoidal")
    full = fa.simulate(
        arm, 1.2, prescribed={1: line, 2: line}, initial=arm.rest(line.joint_angle(0))
    )
    parts = fa.simulate_separated(arm, line, 1.2, joints="locked", rtol=1e-4)
    np.testing.assert_allclose(parts.joint_angle, full.joint_angle, atol=1e-9)
    for name, share in (("link_tip_deflection", 0.02), ("torque", 0.02)):
        # Spin and deflection together have second order here: 1 % of each.
        wanted = full[name].values
        assert np.abs(parts[name].values - wanted).max() < share * np.abs(wanted).max()


@pytest.mark.thorough
def test_added_torque_acts_as_in_the_full_model():
    arm = table_one_arm(rigidity=2000.0)
    line = paper_line(arm, 1.0)
    rigid = fa.rigid_torque(arm, line)

    def added(t):
        return np.array([0.2, -0.1]) * np.sin(20.0 * t)

    full = fa.simulate(
        arm, 1.0, torque=lambda t: rigid(t) + added(t), initial=arm.rest(line.joint_angle(0))
    )
    parts = fa.simulate_separated(arm, line, added_torque=added, rtol=1e-4)
    # The runs approximate the function with tolerances of their own: 1e-7 N m apart.
    np.testing.assert_allclose(parts.torque, full.torque, atol=1e-6)
    without = fa.simulate(arm, 1.0, torque=rigid)
    effect = np.abs((full - without).q.values).max()
    assert np.abs((parts - full).q.values).max() < 0.05 * effect


def test_result_can_be_cited():
    arm = table_one_arm()
    parts = fa.simulate_separated(arm, paper_line(arm, 1.0), rate=100.0)
    assert "HairerWanner1996" in fa.citation(parts)


def test_separation_is_saved_with_its_suffix(tmp_path):
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=0.5)])
    model = fa.linearize_along(arm, fa.joint_motion(arm, [0.0], [0.5], 1.0))
    with pytest.raises(fa.InputError, match=r"path must end in \.npz"):
        model.save(tmp_path / "model.mat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("method", ["dynamic", "quasi_static"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_excessive_bending_gives_a_warning(method, theory):
    """Deviations are linear for any arm, so the limit is a tenth, as in simulate."""
    arm = table_one_arm(theory=theory)
    with pytest.warns(fa.LargeDeflectionWarning, match="of its length of 1.4") as caught:
        result = fa.simulate_separated(arm, paper_line(arm, 0.7), method=method)
    assert caught[0].filename == __file__
    assert result.attrs["warning"] == str(caught[0].message)
    assert "linear deviations misplace the tip by about" in result.attrs["warning"]
    bent = np.abs(result.link_tip_deflection.values).max(axis=0) / [1.4142, 1.0]
    assert bent.max() > 0.1


def test_small_bending_gives_no_warning():
    arm = table_one_arm()
    assert fa.simulate_separated(arm, paper_line(arm, 2.0)).attrs["warning"] == ""


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_half_a_millimetre_converges():
    """The mass of a joint is 1e-17 kg m^2, and the modes have mass 1 in their coordinates."""
    arm = fa.Arm(plausible_spec(np.random.default_rng(0)))
    start, end = [0.1, 0.6, -0.6], [0.14, 0.46, -0.74]
    period = 1.0 / fa.modes(arm, start).frequency_hz.min()
    motion = fa.joint_motion(arm, start, end, 6.0 * period)
    steps = [
        fa.simulate_separated(arm, motion, rtol=rtol).tip.values[:, :2] for rtol in (1e-3, 1e-4)
    ]
    moved = np.abs(steps[1] - motion.tip(np.linspace(0.0, motion.end_time, len(steps[1])))).max()
    assert np.abs(steps[1] - steps[0]).max() < 1e-3 * moved
