"""Modes: joint gains, complex modes, bent equilibria, spin, curves."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvals

import flexarm as fa
from arms import ROD, table_one_arm
from flexarm.linear.vibration.modal import lowest_frequency

DATA = Path(__file__).parents[2] / "data"
ROTATING = json.loads((DATA / "beam_reference.json").read_text(encoding="utf-8"))["rotating"]
ANGLES = [0.3, -0.5]
PROPORTIONAL, DERIVATIVE = [40.0, 10.0], [20.0, 3.0]


def beam(theory="second_order", **more):
    fields = {"flexural_rigidity": 1.0, "mass_per_length": 1.0, "elements": 12, **more}
    return fa.Arm(links=[fa.Link(length=1.0, **fields)], theory=theory)


def closed_loop(model, joint_index, proportional, derivative):
    """Return the state matrix of a linear model with feedback at its torque inputs."""
    n = len(model.states) // 2
    feedback = np.zeros((len(model.inputs), 2 * n))
    for row, place in enumerate(joint_index):
        feedback[row, place], feedback[row, n + place] = proportional[row], derivative[row]
    return model.A - model.B @ feedback


def each_pair(found):
    """Return eigenvalues, with the conjugates of oscillating ones."""
    return np.concatenate([found.eigenvalues, found.eigenvalues[found.eigenvalues.imag > 0].conj()])


class TestHeldByGains:
    def test_eigenvalues_equal_those_of_the_state_matrix(self):
        arm = table_one_arm()
        found = fa.modes(arm, ANGLES, list(zip(PROPORTIONAL, DERIVATIVE, strict=True)))
        model = fa.linearize(arm, arm.rest(ANGLES))
        all_of_them = eigvals(closed_loop(model, arm.joint_index, PROPORTIONAL, DERIVATIVE))
        for value in each_pair(found):
            # Rounding of A, whose norm is 1e6, beside eigenvalues of 4 and more.
            assert np.abs(all_of_them - value).min() < 1e-8 * max(abs(value), 1e2)
        oscillating = found.eigenvalues.imag > 0
        assert oscillating.sum() == 6  # two of eight modes are over-damped
        ratio = -found.eigenvalues.real / np.abs(found.eigenvalues)
        np.testing.assert_allclose(found.damping_ratio[oscillating], ratio[oscillating], rtol=1e-12)
        assert np.all(found.damping_ratio[~oscillating] > 1.0)

    def test_shapes_solve_the_quadratic_problem(self):
        arm = table_one_arm()
        found = fa.modes(arm, ANGLES, fa.JointPD(PROPORTIONAL, DERIVATIVE))
        q = arm.rest(ANGLES)
        M, K, D = arm.mass_matrix(q), arm.stiffness_matrix(q), arm.damping_matrix()
        place = arm.joint_index
        K[place, place] += PROPORTIONAL
        D[place, place] += DERIVATIVE
        for value, shape in zip(found.eigenvalues, found.complex_shapes, strict=True):
            left = (value**2 * M + value * D + K) @ shape
            assert np.abs(left).max() < 1e-9 * np.abs(K @ shape).max()

    def test_large_gains_lock_joints_and_zero_gains_free_them(self):
        arm = table_one_arm()
        tight = fa.modes(arm, ANGLES, [(1e9, 0.0), (1e9, 0.0)]).frequency_hz[:4]
        # The stiffness 105 N m^2 / 1 m over 1e9 N m/rad, in the square.
        np.testing.assert_allclose(tight, fa.modes(arm, ANGLES).frequency_hz[:4], rtol=1e-6)
        none = fa.modes(arm, ANGLES, [(0.0, 0.0), "free"])
        np.testing.assert_array_equal(none.frequency_hz, fa.modes(arm, ANGLES, "free").frequency_hz)

    def test_proportional_damping_keeps_the_shapes(self):
        """Kelvin-Voigt in every link: half the coefficient times the frequency, exactly."""
        damping = {"kind": "rayleigh", "mass_coefficient": 0.0, "stiffness_coefficient": 1e-4}
        arm = fa.Arm(links=[fa.Link(length=1.0, elements=2, damping=damping, **ROD)] * 2)
        found = fa.modes(arm, ANGLES)
        np.testing.assert_allclose(
            found.damping_ratio, 1e-4 * np.pi * found.frequency_hz, rtol=1e-9
        )
        np.testing.assert_allclose(np.abs(found.complex_shapes), np.abs(found.shapes), atol=1e-9)

    @pytest.mark.parametrize("theory", ["linear", "second_order"])
    def test_rigid_modes_are_exactly_zero_beside_coupled_damping(self, theory):
        damping = {"kind": "modal", "ratio": 0.02}
        link = fa.Link(length=1.0, elements=3, damping=damping, **ROD)
        arm = fa.Arm(links=[link] * 3, payload=fa.Payload(mass=0.4), theory=theory)
        found = fa.modes(arm, [0.3, -0.7, 1.2], "free")
        assert np.all(found.frequency_hz[:3] == 0.0)
        assert np.all(found.eigenvalues[:3] == 0.0)
        assert np.all(np.isnan(found.damping_ratio[:3]))
        assert np.all(found.damping_ratio[3:] > 0.001)

    def test_damped_joint_decays_as_its_mode(self):
        """With damping that is not proportional, against a free vibration of the nonlinear arm."""
        damper = fa.Joint(hub_inertia=0.05, damping=0.4, stiffness=5.0)
        arm = fa.Arm(links=[fa.Link(length=1.0, elements=1, **ROD)], joints=[damper])
        found = fa.modes(arm, joints="free")
        value, shape = found.eigenvalues[0], found.complex_shapes[0]
        assert 0.01 < found.damping_ratio[0] < 0.5
        start = 1e-4 * np.stack([shape.real, (value * shape).real])
        run = fa.simulate(arm, 1.0, initial=start[0], initial_rate=start[1], rtol=1e-10, atol=1e-14)
        promised = 1e-4 * np.real(np.exp(value * run.time.values[:, None]) * shape)
        # Nonlinear terms are smaller by the amplitude squared.
        np.testing.assert_allclose(run.q.values, promised, atol=1e-6 * np.abs(promised).max())


class TestBentAndSpinning:
    def test_about_an_equilibrium_with_its_loads(self):
        arm = beam()
        rest = fa.equilibrium(arm, tip_force=(2.0, 0.0))
        found = fa.modes(arm, rest)
        assert found.squared_frequency[0] == pytest.approx(rest.lowest_eigenvalue, rel=1e-8)
        again = fa.modes(arm, q=rest.q, tip_force=(2.0, 0.0))
        np.testing.assert_array_equal(again.frequency_hz, found.frequency_hz)
        assert found.frequency_hz[0] > 1.05 * fa.modes(arm).frequency_hz[0]

    def test_follower_load_causes_flutter(self):
        """Beck's column: frequencies meet at 20.05 EI/L^2, and damping is negative beyond."""
        arm = beam(segments=16, elements=16)
        for force, stable in ((19.9, True), (20.2, False)):
            load = fa.Load(1, (-force, 0.0), frame="link", station=1.0)
            growth = fa.modes(arm, loads=[load]).eigenvalues.real.max()
            assert (growth < 1e-6) == stable

    @pytest.mark.parametrize("case", ROTATING, ids=lambda case: f"gamma={case['gamma']}")
    def test_rotating_beam(self, case):
        found = fa.modes(beam(elements=24), spin=case["gamma"])
        lag = 2 * np.pi * found.frequency_hz[:3]
        np.testing.assert_allclose(lag, case["lag"][:3], rtol=1e-5)  # (beta h)^4 / 1440 of mode 3

    @pytest.mark.filterwarnings(
        "ignore::flexarm.LargeDeflectionWarning"
    )  # of the neglected tension
    def test_spin_softens_in_the_linear_theory(self):
        found = fa.modes(beam("linear"), spin=3.0).squared_frequency[0]
        assert found == pytest.approx(3.5160152685**2 - 9.0, rel=1e-4)  # of the element mesh
        beyond = fa.modes(beam("linear"), spin=4.0)
        assert beyond.frequency_hz[0] == 0.0
        assert beyond.eigenvalues[0].real == pytest.approx(np.sqrt(16 - 3.5160152685**2), rel=1e-4)

    def test_about_a_bent_spinning_arm(self):
        """Eigenvalues of the exact state matrix; Coriolis forces make the shapes complex."""
        arm = table_one_arm(theory="second_order")
        found = fa.modes(arm, [0.0, 1.0], spin=5.0)
        rates = np.zeros(arm.dof)
        rates[0] = 5.0
        forces = arm.inverse_dynamics(found.q, rates, np.zeros(arm.dof))
        bending = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        assert np.abs(forces[bending]).max() < 1e-8 * np.abs(forces).max()
        model = fa.linearize(arm, found.q, rates)
        both = np.concatenate([bending, arm.dof + bending])
        M = model.mass[np.ix_(bending, bending)]
        A = np.zeros((both.size, both.size))
        A[: bending.size, bending.size :] = np.eye(bending.size)
        A[bending.size :, : bending.size] = -np.linalg.solve(
            M, model.stiffness[np.ix_(bending, bending)]
        )
        A[bending.size :, bending.size :] = -np.linalg.solve(
            M, model.damping[np.ix_(bending, bending)]
        )
        expected = np.sort(eigvals(A).imag)[bending.size :]
        np.testing.assert_allclose(np.sort(found.eigenvalues.imag), expected, rtol=1e-7)
        assert np.abs(found.complex_shapes[:3].imag).max() > 1e-3

    def test_free_joints_remain_free_at_a_spin(self):
        found = fa.modes(beam(), joints="free", spin=2.0)
        assert found.frequency_hz[0] == 0.0
        assert found.frequency_hz[1] > 15.4 / (2 * np.pi)


class TestCurves:
    def test_rigid_mode_turns_every_point_about_the_base(self):
        arm = beam()
        found = fa.modes(arm, joints="free")
        moved = found.displacements(stations=11)[0, 0]
        turn = found.shapes[0, 0]
        np.testing.assert_allclose(moved[:, 1], turn * np.linspace(0, 1, 11), rtol=1e-9)
        np.testing.assert_allclose(moved[:, 0], 0.0, atol=1e-12)

    def test_displacements_are_derivatives_of_the_drawn_shape(self):
        arm = table_one_arm(theory="second_order", gravity=(0.0, -9.81))
        found = fa.modes(arm, fa.equilibrium(arm, ANGLES))
        step = 1e-7
        for shape, moved in zip(found.shapes, found.displacements(20), strict=True):
            ahead, behind = (arm.shape(found.q + sign * step * shape, 20) for sign in (1, -1))
            slope = (ahead - behind) / (2 * step)
            # Rounding of positions near one over the step.
            np.testing.assert_allclose(moved, slope, atol=1e-8)

    def test_curves_have_the_requested_amplitude(self):
        arm = table_one_arm()
        found = fa.modes(arm, ANGLES)
        away = found.curves(amplitude=0.05) - arm.shape(found.q)
        largest = np.linalg.norm(away, axis=-1).max(axis=(1, 2))
        np.testing.assert_allclose(largest, 0.05, rtol=1e-12)
        damped = found.displacements(damped=True)
        np.testing.assert_allclose(damped, found.displacements(), atol=1e-12)

    def test_damped_displacements_have_the_phases_of_the_complex_shapes(self):
        """Displacements are linear in the shape: those of its real and imaginary part."""
        found = fa.modes(table_one_arm(), ANGLES, joints=[(10.0, 3.0), (5.0, 2.0)])
        moved = found.displacements(20, damped=True)
        assert np.abs(moved.imag).max() > 0.01 * np.abs(moved.real).max()
        parts = [
            dataclasses.replace(found, shapes=part).displacements(20)
            for part in (found.complex_shapes.real, found.complex_shapes.imag)
        ]
        np.testing.assert_allclose(moved, parts[0] + 1j * parts[1], rtol=0, atol=1e-12)


def test_scale_of_an_arm_with_backlash_is_that_with_the_gear_at_its_end():
    """Within the gap nothing holds the link."""
    link = fa.Link(length=0.5, flexural_rigidity=20.0, mass_per_length=0.5, elements=1)

    def geared(gap):
        spring = {"stiffness": 30.0, "rotor_inertia": 1e-5, "gear_ratio": 50.0}
        return fa.Arm(links=[link], joints=[fa.Joint(**spring, backlash=gap)])

    assert lowest_frequency(geared(1e-3)) == lowest_frequency(geared(0.0))
    with pytest.raises(fa.InputError, match=r"sample_time must be at most 0\.0"):
        fa.ComputedTorque(geared(1e-3), 1.0, sample_time=1.0)
