"""Instants of changes: samples, readings and events there, and several changes at once.

One rigid link with inertia about the joint: the rates after a change are quotients of inertias.
"""

import numpy as np
import pytest

import flexarm as fa
from arms import INERTIA, LENGTH, MASS, changing_link, changing_links, moving, with_payload
from flexarm.integrate import INTEGRATORS

# Rates of the arm with flexible links bend it further than the linear theory allows.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

HEAVY = fa.Change("payload.mass", at=0.05, to=1.2)
AFTER_HEAVY = INERTIA / (INERTIA + LENGTH**2)


def eccentric(mass=MASS, inertia=0.01, offset=0.1):
    link = fa.Link(length=LENGTH, flexible=False, mass_per_length=0.3)
    payload = fa.Payload(mass=mass, inertia=inertia, offset=(offset, 0.0))
    return fa.Arm(links=[link], joints=[fa.Joint()], payload=payload)


def inertia_of(arm):
    return float(arm.mass_matrix(arm.rest([0.0]))[0, 0])


def rate_after(*changes, arm=None):
    """Return the rate after changes of a link that turns freely at 1 rad/s, and the run."""
    arm = arm or eccentric()
    run = fa.simulate(arm, 0.1, initial_rate=[1.0], changes=changes, progress=False)
    total = (run.kinetic_energy + run.strain_energy + run.gravity_energy).values
    # No torque acts, so that only changes alter the energy.
    assert total[-1] - total[0] == pytest.approx(
        run.change_energy.values.sum(), rel=1e-9, abs=1e-12
    )
    return run.joint_rate.values[-1, 0], run


class TestSamplesAndReadings:
    # For these k the product k * 0.001 is not the number k / 1000.
    @pytest.mark.parametrize("k", [9, 13, 18, 26])
    def test_a_reading_at_the_time_of_a_change_is_before_it(self, k):
        plant = fa.Plant(changing_link(), 0.001, changes=[HEAVY.replace(at=k / 1000)])
        plant.reset(initial_rate=[1.0])
        rates = [plant.step([0.0])["joint_rate"][0] for _ in range(k + 1)]
        np.testing.assert_allclose(rates, [1.0] * k + [AFTER_HEAVY], rtol=1e-12)

    def test_a_sample_at_the_time_of_a_change_is_before_it(self):
        """0.1 * 3 is above 0.3 by rounding, 0.29999999999999993 below."""
        for at in (0.1 * 3, 0.3, 0.29999999999999993):
            change = HEAVY.replace(at=at)
            run = fa.simulate(changing_link(), 0.4, initial_rate=[1.0], changes=[change], rate=10.0)
            wanted = [1.0] * 4 + [AFTER_HEAVY]
            np.testing.assert_allclose(run.joint_rate.values[:, 0], wanted, rtol=1e-12)
            assert run.change_time.values.tolist() == [at]

    @pytest.mark.parametrize("integrator", INTEGRATORS)
    def test_the_first_sample_is_before_a_change_at_the_start(self, integrator):
        options = {"initial_rate": [1.0], "rate": 100.0, "integrator": integrator}
        run = fa.simulate(changing_link(), 0.05, changes=[HEAVY.replace(at=0.0)], **options)
        np.testing.assert_allclose(
            run.joint_rate.values[:, 0], [1.0] + [AFTER_HEAVY] * 5, rtol=1e-12
        )
        kinetic = run.kinetic_energy.values
        assert kinetic[0] == pytest.approx(0.5 * INERTIA, rel=1e-12)
        assert kinetic[-1] - kinetic[0] == pytest.approx(run.change_energy.item(), rel=1e-12)


class TestSeveralAtOneTime:
    """Added and moved inertia: M+ qd+ = M- qd-, with M- after inertia that is removed."""

    @pytest.mark.parametrize("order", [1, -1])
    def test_mass_with_a_velocity_and_the_offset(self, order):
        mass = fa.Change("payload.mass", at=0.05, to=1.0, velocity=(0.3, 1.5))
        offset = fa.Change("payload.offset[0]", at=0.05, to=0.5)
        rate, run = rate_after(*[mass, offset][::order])
        lever, angle = LENGTH + 0.5, 0.05
        tangential = -0.3 * np.sin(angle) + 1.5 * np.cos(angle)
        wanted = inertia_of(eccentric()) + (1.0 - MASS) * lever * tangential
        assert rate == pytest.approx(wanted / inertia_of(eccentric(1.0, offset=0.5)), rel=1e-9)
        assert run.change_path.values.tolist() == [c.path for c in [mass, offset][::order]]

    @pytest.mark.parametrize("order", [1, -1])
    def test_mass_is_added_and_inertia_removed(self, order):
        changes = [
            fa.Change("payload.mass", at=0.05, to=1.0),
            fa.Change("payload.inertia", at=0.05, to=0.005),
        ][::order]
        rate, _ = rate_after(*changes)
        wanted = inertia_of(eccentric(inertia=0.005)) / inertia_of(eccentric(1.0, 0.005))
        assert rate == pytest.approx(wanted, rel=1e-12)

    def test_the_last_of_one_number_counts(self):
        up, down = HEAVY, HEAVY.replace(to=MASS)
        rate, run = rate_after(up, down, arm=changing_link())
        assert rate == 1.0
        assert run.change_energy.values.tolist() == [0.0, 0.0]
        rate, _ = rate_after(down, up, arm=changing_link())
        assert rate == pytest.approx(AFTER_HEAVY, rel=1e-12)

    @pytest.mark.parametrize("order", [1, -1])
    def test_numbers_that_are_possible_only_together(self, order):
        # The static level cannot be below the Coulomb level, so that one order alone is possible.
        def rubbing(coulomb, static):
            friction = fa.Friction(coulomb=coulomb, static=static, stribeck_rate=0.5)
            link = fa.Link(length=LENGTH, flexible=False, mass_per_length=0.3)
            return fa.Arm(links=[link], joints=[fa.Joint(friction=friction)])

        pair = [
            fa.Change("joints[0].friction.coulomb", to=0.01),
            fa.Change("joints[0].friction.static", to=0.02),
        ][::order]
        options = {"initial_rate": [1.0], "progress": False}
        run = fa.simulate(rubbing(0.05, 0.08), 0.1, changes=pair, **options)
        wanted = fa.simulate(rubbing(0.01, 0.02), 0.1, **options)
        np.testing.assert_allclose(run.q.values, wanted.q.values, rtol=0, atol=1e-12)

    @pytest.mark.parametrize("order", [1, -1])
    def test_numbers_that_are_not_possible_together(self, order):
        friction = fa.Friction(coulomb=0.05, static=0.08, stribeck_rate=0.5)
        link = fa.Link(length=LENGTH, flexible=False, mass_per_length=0.3)
        arm = fa.Arm(links=[link], joints=[fa.Joint(friction=friction)])
        pair = [
            fa.Change("joints[0].friction.coulomb", at=0.05, to=0.03),
            fa.Change("joints[0].friction.static", at=0.05, to=0.02),
        ][::order]
        with pytest.raises(fa.InputError, match="static must be at least coulomb"):
            fa.simulate(arm, 0.1, changes=pair)


class TestMovedInertia:
    """A payload that the arm itself moves: its angular momentum remains."""

    @pytest.mark.parametrize("offset", [0.5, -0.5])
    def test_outward_and_inward(self, offset):
        rate, run = rate_after(fa.Change("payload.offset[0]", at=0.05, to=offset))
        wanted = inertia_of(eccentric()) / inertia_of(eccentric(offset=offset))
        assert rate == pytest.approx(wanted, rel=1e-12)
        assert (rate > 1.0) == (offset < 0.1)
        assert (run.change_energy.item() > 0.0) == (offset < 0.1)

    def test_there_and_back_restores_the_rate(self):
        course = fa.Change("payload.offset[0]", to=([0.0, 0.04, 0.08], [0.1, 0.6, 0.1]))
        rate, _ = rate_after(course)
        assert rate == pytest.approx(1.0, rel=1e-12)

    def test_generalised_momentum_of_a_flexible_arm(self):
        arm = changing_links((0.1, 0.05))
        q, qd = moving(arm)
        change = fa.Change("payload.offset[1]", to=-0.1)
        # After 1e-15 s the forces of the bent links, below 1e5 N, have no effect.
        run = fa.simulate(
            arm, 1e-15, initial=q, initial_rate=qd, changes=[change], rate=1e15, progress=False
        )
        moved = fa.Arm(with_payload(arm, offset=(0.1, -0.1)))
        wanted = arm.mass_matrix(q) @ qd
        found = moved.mass_matrix(q) @ run.qd.values[1]
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
        assert abs(run.qd.values[1] - qd).max() > 1e-2


class TestEventsInTheJump:
    def slow(self, **options):
        return fa.Event(lambda t, q, qd: qd[0] - 0.5, name="slow", **options)

    @pytest.mark.parametrize("at", [0.0, 0.05, 0.0503])
    def test_a_terminal_event_ends_the_run(self, at):
        change = HEAVY.replace(at=at)
        options = {"initial_rate": [1.0], "changes": [change], "events": [self.slow(terminal=True)]}
        run = fa.simulate(changing_link(), 0.1, **options)
        assert run.ended_by == "slow"
        assert run.event_time.values.tolist() == [at]
        assert run.event_direction.values.tolist() == [-1]
        np.testing.assert_allclose(run.event_qd.values, [[AFTER_HEAVY]], rtol=1e-12)
        assert run.time.values[-1] == at
        assert run.time.values.size == np.unique(run.time.values).size
        assert run.joint_rate.values[-1, 0] == pytest.approx(AFTER_HEAVY, rel=1e-12)
        after = 0.5 * (INERTIA + LENGTH**2) * AFTER_HEAVY**2
        assert run.kinetic_energy.values[-1] == pytest.approx(after, rel=1e-9)

    def test_direction_is_that_of_the_jump(self):
        events = [self.slow(direction=1)]
        run = fa.simulate(changing_link(), 0.1, initial_rate=[1.0], changes=[HEAVY], events=events)
        assert run.event_time.size == 0

    def test_a_change_waits_for_an_event_in_the_jump(self):
        brake = fa.Change("joints[0].damping", at="slow", to=1.0)
        run = fa.simulate(
            changing_link(), 0.1, initial_rate=[1.0], changes=[HEAVY, brake], events=[self.slow()]
        )
        assert run.change_time.values.tolist() == [0.05, 0.05]
        wanted = AFTER_HEAVY * np.exp(-0.05 / (INERTIA + LENGTH**2))
        assert run.joint_rate.values[-1, 0] == pytest.approx(wanted, rel=1e-6)
