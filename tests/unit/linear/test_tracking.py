"""Modes tracked along postures: lines that cross keep their identity."""

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm


class TestPostures:
    def test_every_line_has_modes_of_its_posture(self):
        arm = table_one_arm()
        postures = np.stack([np.zeros(25), np.linspace(-3.0, 3.0, 25)], axis=1)
        tracks = fa.track_modes(arm, postures, count=4)
        for angles, found in zip(postures, tracks.frequency_hz, strict=True):
            known = fa.modes(arm, angles).frequency_hz
            assert all(np.abs(known - value).min() < 1e-12 * value for value in found)
            assert len(set(found)) == 4  # no mode twice
        np.testing.assert_array_equal(tracks.parameter, np.arange(25))

    def test_motion_gives_the_times(self):
        arm = table_one_arm()
        motion = fa.joint_motion(arm, [0.0, 0.5], [1.0, 2.0], 2.0)
        tracks = fa.track_modes(arm, motion, count=3, samples=11)
        np.testing.assert_allclose(tracks.parameter, np.linspace(0.0, 2.0, 11))
        assert (tracks.parameter_name, tracks.parameter_unit) == ("time", "s")
        last = fa.modes(arm, motion.joint_angle(2.0)).frequency_hz[:3]
        np.testing.assert_allclose(np.sort(tracks.frequency_hz[-1]), last, rtol=1e-12)

    @pytest.mark.parametrize("joints", ["locked", "free"])
    def test_coarse_steps_find_the_lines_of_fine_ones(self, joints):
        """With free joints shapes change so much that lines would swap without additional
        postures."""
        arm = table_one_arm()
        path = np.stack([np.zeros(61), np.linspace(-3.0, 3.0, 61)], axis=1)
        fine = fa.track_modes(arm, path, joints).frequency_hz
        coarse = fa.track_modes(arm, path[::12], joints).frequency_hz
        np.testing.assert_allclose(coarse, fine[::12], rtol=1e-9)

    def test_tracking_about_sagging_equilibria(self):
        arm = table_one_arm(gravity=(0.0, -9.81), theory="second_order")
        tracks = fa.track_modes(arm, [[0.0, 0.2], [0.1, 0.2]], count=2, sag=True)
        expected = fa.modes(arm, fa.equilibrium(arm, [0.1, 0.2])).frequency_hz[:2]
        np.testing.assert_allclose(tracks.frequency_hz[1], expected, rtol=1e-12)
        straight = fa.track_modes(arm, [[0.0, 0.2], [0.1, 0.2]], count=2).frequency_hz
        assert np.abs(straight / tracks.frequency_hz - 1.0).max() > 1e-4

    def test_rigid_modes_have_no_lines(self):
        tracks = fa.track_modes(table_one_arm(), [[0.0, 0.3], [0.0, 0.4]], "free", count=3)
        assert np.all(tracks.frequency_hz > 1.0)

    def test_arm_with_a_single_mode(self):
        """A rod on a spring: sqrt(k / I), the same in every posture."""
        link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
        arm = fa.Arm(links=[link], joints=[fa.Joint(stiffness=5.0)])
        tracks = fa.track_modes(arm, [[0.0], [0.5]], "free")
        np.testing.assert_allclose(
            tracks.frequency_hz, np.sqrt(5.0) / (2.0 * np.pi) * np.ones((2, 1)), rtol=1e-12
        )

    def test_arm_without_modes(self):
        link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
        with pytest.raises(fa.InputError, match="has no mode of vibration"):
            fa.track_modes(fa.Arm(links=[link]), [[0.0], [0.5]], "free")

    @pytest.mark.parametrize(
        ("along", "count", "message"),
        [
            ([0.0, 1.0], 2, "along must be numbers of shape"),
            ([[0.0, 1.0]], 0, "count must be a whole number from 1"),
        ],
    )
    def test_wrong_input_is_rejected(self, along, count, message):
        with pytest.raises(fa.InputError, match=message):
            fa.track_modes(table_one_arm(), along, count=count)


class TestCampbell:
    def test_pendulum_mode_crosses_the_bending_lines(self):
        """The stub's line rises from below; each line keeps its own shape through the crossing."""
        fast = np.linspace(0.0, 40.0, 9)
        beam = fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=1.0, elements=3)
        stub = fa.Link(length=0.05, mass_per_length=0.01, flexible=False)
        arm = fa.Arm(
            links=[beam, stub],
            joints=[fa.Joint(), fa.Joint(stiffness=1e-4)],
            theory="second_order",
        )
        tracks = fa.campbell(arm, fast, joints=["locked", "free"], count=2)
        hertz = tracks.frequency_hz
        turning = np.abs(tracks.shapes[:, :, arm.joint_index[1]]) ** 2
        # The line that starts as the stub's swing ends above the other, still with that shape.
        assert hertz[0, 0] < hertz[0, 1]
        assert hertz[-1, 0] > hertz[-1, 1]
        assert np.all(turning[:, 0] > turning[:, 1])

    def test_lines_of_a_rotating_beam_rise(self):
        arm = fa.Arm(
            links=[fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=6)],
            theory="second_order",
        )
        tracks = fa.campbell(arm, [0.0, 1.0, 2.0], count=3)
        assert np.all(np.diff(tracks.frequency_hz, axis=0) > 0.0)
        assert tracks.parameter_unit == "rad/s"
        with pytest.raises(
            fa.InputError, match="spin must be one or more numbers in increasing order"
        ):
            fa.campbell(arm, [1.0, 0.0])
