"""Tables of loads, base accelerations and angles over time are interpolated exactly."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import flexarm as fa
from arms import unit_link
from flexarm.arm.actions import Environment
from flexarm.simulation.histories.loads import load_history

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
FINE = {"rtol": 1e-10, "atol": 1e-12}
#: Rounding of sums of numbers of size one.
ROUNDING = 1e-12


def rod(**fields):
    return fa.Arm(links=[fa.Link(length=0.6, elements=2, **ROD)], **fields)


def history(arm, *loads, base=None):
    return load_history(arm, Environment(loads, base), 1.0, 1e-9).factors


class TestFactors:
    def test_values_between_and_beyond_the_times(self):
        table = ([0.2, 0.4, 0.4, 0.8], [1.0, 2.0, -1.0, 3.0])
        found = history(unit_link(), fa.Load(1, (0.0, 1.0), factor=table))
        times = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 0.9, 1.0])
        exact = [1.0, 1.0, 1.0, 1.5, -1.0, 0.0, 1.0, 3.0, 3.0, 3.0]
        np.testing.assert_allclose(found.at(times)[:, 0], exact, atol=ROUNDING)
        before = np.nextafter(0.4, 0.0)
        assert found.at(np.array([before]))[0, 0] == pytest.approx(2.0, abs=1e-9)
        assert found.stops.tolist() == [0.2, 0.4, 0.8]

    def test_integrator_stops_at_bends_and_jumps_only(self):
        table = ([0.0, 0.25, 0.5, 0.5, 0.75], [0.0, 1.0, 2.0, 2.0, 3.0])
        assert history(unit_link(), fa.Load(1, (0.0, 1.0), factor=table)).stops.tolist() == [0.75]
        for still in (([0.3], [2.0]), ([0.3, 0.6], [2.0, 2.0])):
            found = history(unit_link(), fa.Load(1, (0.0, 1.0), factor=still))
            assert found.stops.size == 0
            assert found.at(np.array([0.0, 0.5, 1.0]))[:, 0].tolist() == [2.0, 2.0, 2.0]

    def test_table_that_begins_before_the_run(self):
        found = history(unit_link(), fa.Load(1, (0.0, 1.0), factor=([-1.0, 3.0], [0.0, 4.0])))
        np.testing.assert_allclose(
            found.at(np.array([0.0, 0.5, 1.0]))[:, 0], [1.0, 1.5, 2.0], atol=ROUNDING
        )

    def test_momentum_after_a_ramp_and_a_jump(self):
        """Moment over inertia, integrated by hand."""
        load = fa.Load(1, moment=2.0, factor=([0.1, 0.3, 0.3, 0.4], [0.0, 1.0, 3.0, 0.0]))
        result = fa.simulate(unit_link(), 0.6, loads=[load], rate=10)
        rates = result.joint_rate.values[:, 0]
        area = [0.0, 0.0, 0.025, 0.1, 0.25, 0.25, 0.25]  # of the factor, at tenths of a second
        # The right side is piecewise linear, so every method is exact.
        np.testing.assert_allclose(rates, 2.0 * np.array(area), rtol=0, atol=ROUNDING)

    def test_table_with_functions_and_constants(self):
        """Each load separately, and all of them together, on segments."""
        links = [fa.Link(length=1.0, elements=4, segments=4, **ROD)]
        arm = fa.Arm(links=links)
        kinds = [None, np.cos, ([0.0, 0.7], [1.0, 0.0]), lambda t: float(t > 0.35)]
        loads = [
            fa.Load(1, (0.0, 1.0 + k), spread=(0.1, 0.9), factor=kind)
            for k, kind in enumerate(kinds)
        ]
        loads.insert(2, fa.Load(1, (0.5, 0.0), factor=([0.0, 0.5, 1.0], [0.0, 1.0, 0.0])))
        t = np.linspace(0.0, 1.0, 77)
        found = history(arm, *loads).at(t)
        column = 0
        for load in loads:
            alone = np.ones((len(t), 1))
            if load.factor is not None:
                alone = history(arm, load, base=(1.0, 2.0)).at(t)
                np.testing.assert_array_equal(alone[:, -2:], [[1.0, 2.0]] * len(t))
            for _ in range(4 if load.spread else 1):
                # Columns are divided at each other's breaks, where cubics are shifted: rounding.
                np.testing.assert_allclose(found[:, column], alone[:, 0], rtol=0, atol=ROUNDING)
                column += 1
        assert column == found.shape[1] - 2

    def test_table_equals_the_function_of_the_same_values(self):
        t, f = [0.0, 0.1, 0.15, 0.3], [0.0, 1.0, 0.2, 0.0]
        runs = [
            fa.simulate(rod(), 0.5, loads=[fa.Load(1, (0.0, 1.0), factor=factor)], rate=100, **FINE)
            for factor in ((t, f), lambda x: float(np.interp(x, t, f)))
        ]
        # The function is interpolated to 1e-12 of its size; the link vibrates at 40 rad/s and more.
        np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-9)

    @pytest.mark.parametrize(
        ("factor", "message"),
        [
            (3.0, r"factor must be a function of time or a table \(times, values\), got 3"),
            ((1.0, 2.0), "factor must be a function of time or a table"),
            ((["a"], [1.0]), r"factor.times\[0\] must be a number"),
            (([0, 1], [1.0]), r"factor.values must have length 2"),
            (([0, 1], [[1.0], [2.0]]), r"factor.values\[0\] must be a number"),
            (([], []), r"factor.times is empty"),
            (([0, 2, 1], [1, 1, 1]), r"factor.times\[2\] must be at least 2 \(the previous time\)"),
            (([0, 1, 1, 1], [1, 1, 1, 1]), r"factor.times\[3\] must occur at most twice"),
            (([0, np.nan], [1, 1]), r"factor.times\[1\] must be a finite number"),
        ],
    )
    def test_wrong_tables_are_rejected(self, factor, message):
        with pytest.raises(fa.InputError, match=f"Load: {message}"):
            fa.Load(1, (0.0, 1.0), factor=factor)

    def test_failing_function_is_reported_by_its_name(self):
        with pytest.raises(fa.InputError, match=r"simulate: Load.factor\(.*\) must be"):
            fa.simulate(unit_link(), 0.1, loads=[fa.Load(1, (0.0, 1.0), factor=lambda t: "much")])
        with pytest.raises(fa.InputError, match=r"simulate: base_acceleration\(.*\)\[1\] must be"):
            fa.simulate(unit_link(), 0.1, base_acceleration=lambda t: (0.0, np.inf))


class TestBase:
    def test_table_equals_the_function_of_the_same_values(self):
        t, a = [0.0, 0.2, 0.2, 0.4], np.array([[0, 1], [3, 2], [-1, 0], [0, 0.5]], dtype=float)

        def function(x):
            row = [np.interp(x, t, column) for column in a.T]
            return row if x < 0.2 else [np.interp(x, t[2:], column[2:]) for column in a.T]

        runs = [
            fa.simulate(rod(), 0.5, base_acceleration=given, rate=100, **FINE)
            for given in ((t, a), function)
        ]
        np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-9)
        assert abs(runs[0].q).max() > 0.1

    @pytest.mark.parametrize("table", [([0, 1], [1.0, 2.0]), ([1, 0], [[0, 1], [0, 1]])])
    def test_wrong_tables_are_rejected(self, table):
        with pytest.raises(fa.InputError, match=r"simulate: base_acceleration\.(values|times)\["):
            fa.simulate(unit_link(), 0.1, base_acceleration=table)


class TestAngles:
    TIMES = np.array([0.1, 0.3, 0.4, 0.7])
    ANGLES = np.array([0.2, 0.5, 0.1, 0.3])

    def test_motion_from_rest_to_rest(self):
        given = fa.PrescribedAngle.table(self.TIMES, self.ANGLES)
        result = fa.simulate(rod(gravity=(0.0, -9.81)), 1.0, prescribed={1: given}, rate=10)
        angle, rate = result.joint_angle.values[:, 0], result.joint_rate.values[:, 0]
        # Accelerations are linear between the times, and every step ends at them: exact.
        np.testing.assert_allclose(angle[[1, 3, 4, 7]], self.ANGLES, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(angle[[0, 8, 9, 10]], [0.2, 0.3, 0.3, 0.3], atol=ROUNDING)
        np.testing.assert_allclose(rate[[0, 1, 7, 8, 10]], 0.0, atol=1e-10)
        spline = CubicSpline(self.TIMES, self.ANGLES, bc_type="clamped")
        t = result.time.values[1:8]
        np.testing.assert_allclose(rate[1:8], spline(t, 1), rtol=0, atol=1e-10)
        assert given.acceleration(0.2) == pytest.approx(float(spline(0.2, 2)), abs=ROUNDING)

    def test_free_ends_choose_the_rate(self):
        t = np.linspace(0.0, 1.0, 41)
        given = fa.PrescribedAngle.table(t, np.sin(3 * t), ends="free")
        result = fa.simulate(rod(), 1.0, prescribed={1: given}, rate=400)
        requested = np.sin(3 * result.time.values)
        # A spline's error: (3/384) h^4 |f''''| = 2.5e-7 within, four times as much beside the ends.
        np.testing.assert_allclose(result.joint_angle.values[:, 0], requested, rtol=0, atol=1e-6)
        assert result.joint_rate.values[0, 0] == pytest.approx(3.0, abs=1e-3)

    def test_free_ends_must_cover_the_run(self):
        given = fa.PrescribedAngle.table([0.0, 0.5, 1.0], [0.0, 0.1, 0.0], ends="free")
        fa.simulate(unit_link(), 1.0, prescribed={1: given}, rate=10)
        with pytest.raises(fa.InputError, match=r"cover the run from 0 to its end .* got 0 to 1\."):
            fa.simulate(unit_link(), 1.01, prescribed={1: given}, rate=10)
        late = fa.PrescribedAngle.table([0.1, 0.5, 1.0], [0.0, 0.1, 0.0], ends="free")
        with pytest.raises(fa.InputError, match=r"cover the run from 0 to .* got 0\.1 to 1"):
            fa.simulate(unit_link(), 1.0, prescribed={1: late}, rate=10)

    def test_constant_angle(self):
        given = fa.PrescribedAngle.hold(0.4)
        result = fa.simulate(rod(gravity=(0.0, -9.81)), 0.3, prescribed={1: given}, rate=10)
        np.testing.assert_array_equal(result.joint_angle.values[:, 0], 0.4)
        assert abs(result.torque.values).max() > 0.1

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (([0, 1], [1.0]), r"angles must be numbers of shape \(2,\)"),
            (([0], [1.0]), "times must be at least two"),
            (([0, 1, 1], [1.0, 2.0, 2.0]), "in increasing order"),
            (([0, 1], [1.0, 2.0], "loose"), "ends must be one of 'rest', 'free', got 'loose'"),
        ],
    )
    def test_wrong_tables_are_rejected(self, arguments, message):
        with pytest.raises(fa.InputError, match=message):
            fa.PrescribedAngle.table(*arguments)
        with pytest.raises(fa.InputError, match=r"hold: angle must be finite"):
            fa.PrescribedAngle.hold(np.nan)
