"""Arms that change during a run: momentum at the change, closed forms, functions of time.

Momentum comes from the oracle, which shares no formula with the package; the motions of one
coordinate have closed forms.
"""

import numpy as np
import pytest
from scipy.special import airy

import flexarm as fa
from arms import INERTIA, LENGTH, MASS, changing_link, changing_links, moving, with_payload
from oracles.lagrangian import LagrangianOracle

pytestmark = [
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    # The links have no damping, so that a delay makes their fastest vibrations unstable.
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]


def at_start(arm, *changes, **options):
    """Return the state before changes at time zero, the rates after them and the run.

    The rates are those 1e-15 s later, when forces have changed them by less than 1e-9.
    """
    q, qd = moving(arm)
    options |= {"rate": 1e15, "progress": False}
    run = fa.simulate(arm, 1e-15, initial=q, initial_rate=qd, changes=changes, **options)
    np.testing.assert_array_equal(run.qd.values[0], qd)
    return q, qd, run.qd.values[-1], run


def momentum(spec, arm, q, qd):
    """Return the generalised momentum in the nodal coordinates of the oracle, and its rates."""
    oracle = LagrangianOracle(spec)
    values, rates = (oracle.coordinates(arm.joint_angles(v), arm.nodal(v)) for v in (q, qd))
    return oracle.mass_matrix(values) @ rates


class TestMomentum:
    def test_a_rigid_link_picks_up_a_mass_at_rest_and_drops_it(self):
        changes = [
            fa.Change("payload.mass", at=0.5, to=MASS + 1.0),
            fa.Change("payload.mass", at=0.8, to=MASS),
        ]
        run = fa.simulate(changing_link(), 1.0, initial_rate=[0.5], changes=changes, rate=100.0)
        after = 0.5 * INERTIA / (INERTIA + LENGTH**2)
        rates = run.joint_rate.values[:, 0]
        np.testing.assert_allclose(rates[:51], 0.5, rtol=1e-12)  # the sample at 0.5 s is before
        np.testing.assert_allclose(rates[51:], after, rtol=1e-12)
        before, mean = 0.5 * INERTIA * 0.5**2, 0.5 * (INERTIA + LENGTH**2) * after**2
        dropped = -0.5 * LENGTH**2 * after**2
        np.testing.assert_allclose(run.change_energy, [mean - before, dropped], rtol=1e-12)
        assert run.change_time.values.tolist() == [0.5, 0.8]
        assert run.change_path.values.tolist() == ["payload.mass"] * 2
        assert run.change_from.values.tolist() == [MASS, MASS + 1.0]
        assert run.change_to.values.tolist() == [MASS + 1.0, MASS]
        np.testing.assert_allclose(
            run.kinetic_energy.values[[50, 51, 100]], [before, mean, mean + dropped], rtol=1e-12
        )

    def test_a_moving_mass_brings_its_momentum(self):
        change = fa.Change("payload.mass", to=MASS + 1.0, velocity=(5.0, 3.0))
        run = fa.simulate(changing_link(), 0.1, initial_rate=[0.5], changes=[change], rate=100.0)
        wanted = (INERTIA * 0.5 + LENGTH * 3.0) / (INERTIA + LENGTH**2)  # vx is along the link
        np.testing.assert_allclose(run.joint_rate.values[1:, 0], wanted, rtol=1e-12)

    @pytest.mark.sampled("offset1-linear", "offset0-second_order")
    @pytest.mark.parametrize("theory", ["linear", "second_order"])
    @pytest.mark.parametrize("offset", [(0.0, 0.0), (0.1, 0.05)])
    def test_momentum_of_a_flexible_arm_is_that_of_the_oracle(self, theory, offset):
        arm = changing_links(offset, theory=theory)
        for path, number in (("mass", 0.7), ("inertia", 0.05)):
            spec = with_payload(arm, **{path: number})
            q, qd, rates, _ = at_start(arm, fa.Change(f"payload.{path}", to=number))
            before = momentum(arm.spec, arm, q, qd)
            after = momentum(spec, arm, q, rates)
            np.testing.assert_allclose(after, before, rtol=0, atol=1e-11 * abs(before).max())
            assert abs(rates - qd).max() > 1e-2

    @pytest.mark.parametrize("offset", [(0.0, 0.0), (0.1, 0.05)])
    def test_a_mass_that_moves_with_the_payload_changes_no_rate(self, offset):
        arm = changing_links(offset)
        q, qd = moving(arm)

        def centre(t):
            x, y, angle = arm.tip(q + t * qd)
            c, s = np.cos(angle), np.sin(angle)
            return np.array([x + c * offset[0] - s * offset[1], y + s * offset[0] + c * offset[1]])

        velocity = (centre(1e-6) - centre(-1e-6)) / 2e-6
        change = fa.Change("payload.mass", to=0.7, velocity=velocity)
        _, _, rates, _ = at_start(arm, change)
        # The error of the difference quotient, magnified by light modes.
        np.testing.assert_allclose(rates, qd, rtol=0, atol=1e-7)

    def test_a_dropped_mass_changes_no_rate(self):
        q, qd, rates, run = at_start(changing_links(), fa.Change("payload.mass", to=0.0))
        np.testing.assert_allclose(rates, qd, rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.q.values[-1], q, rtol=0, atol=1e-14)

    def test_prescribed_joints_keep_their_rates(self):
        arm = changing_links()
        turn = fa.joint_motion(arm, [0.4, 0.0], [1.2, 0.0], 1.0)
        change = fa.Change("payload.mass", at=0.2, to=1.0)
        q = arm.rest([0.4, 0.9])
        run = fa.simulate(arm, 0.4, prescribed={1: turn}, initial=q, changes=[change], rate=1000.0)
        wanted = turn.joint_rate(run.time.values)[:, 0]
        np.testing.assert_allclose(run.joint_rate.values[:, 0], wanted, rtol=0, atol=1e-9)
        jump = run.qd.values[201] - run.qd.values[200]
        assert abs(jump[0]) < 1e-2 < abs(jump[1])


def test_a_rigidity_step_multiplies_the_strain_energy():
    arm = changing_links()
    change = fa.Change("links[0].flexural_rigidity", at=0.2, factor=0.5)
    q, qd = moving(arm)
    run = fa.simulate(arm, 0.4, initial=q, initial_rate=qd, changes=[change], rate=1000.0)
    step = fa.simulate(arm, 0.2, initial=q, initial_rate=qd, rate=1000.0)
    soft = fa.varied(arm, flexural_rigidity_factor=[0.5, 1.0])
    at = step.q.values[-1], step.qd.values[-1]
    lost = soft.energy(*at).strain - arm.energy(*at).strain
    assert lost < -1e-4
    # The same state of both runs, to the tolerance of the run.
    np.testing.assert_allclose(run.change_energy.values, [lost], rtol=1e-6)
    total = run.kinetic_energy + run.strain_energy + run.gravity_energy
    for part in (total[:201], total[201:]):
        np.testing.assert_allclose(part, part[0], rtol=1e-6)
    np.testing.assert_allclose(total[201] - total[200], lost, rtol=1e-4)
    rest = fa.simulate(soft, 0.2, initial=at[0], initial_rate=at[1], rate=1000.0)
    np.testing.assert_allclose(run.q.values[201:], rest.q.values[1:], rtol=0, atol=1e-6)
    for name in ("strain", "joint_force", "tip"):
        own = run[name].values[201:]
        np.testing.assert_allclose(own, rest[name].values[1:], rtol=0, atol=1e-4 * abs(own).max())


class TestFunctionsOfTime:
    """A rigid link on a spring whose stiffness fades: theta'' + (a - b t) theta = 0."""

    STIFFNESS, RATE = 40.0, 10.0  # N m/rad, and N m/rad per second

    def angle(self, t):
        """Return the solution from rest at 0.3 rad, with Airy functions of -(a - b t) / b^(2/3)."""
        a, b = self.STIFFNESS / INERTIA, self.RATE / INERTIA
        z = -(a - b * np.append(0.0, t)) / b ** (2.0 / 3.0)
        ai, slope_a, bi, slope_b = airy(z)
        c = np.linalg.solve([[ai[0], bi[0]], [slope_a[0], slope_b[0]]], [0.3, 0.0])
        return (c[0] * ai + c[1] * bi)[1:]

    def run(self, course, interval):
        change = fa.Change("joints[0].stiffness", **course, interval=interval)
        arm = changing_link(stiffness=self.STIFFNESS)
        return fa.simulate(arm, 3.0, initial=[0.3], changes=[change], rate=50.0, rtol=1e-10)

    @pytest.mark.sampled("course0")
    @pytest.mark.parametrize(
        "course",
        [
            {"to": lambda t: 40.0 - 10.0 * t},
            {"factor": ([0.0, 3.0], [1.0, 0.25])},
            {"factor": {"times": [0.0, 1.0, 3.0], "values": [1.0, 0.75, 0.25]}},
        ],
    )
    def test_error_falls_with_the_square_of_the_interval(self, course):
        errors = []
        for interval in (0.1, 0.05):
            run = self.run(course, interval)
            errors.append(abs(run.joint_angle.values[:, 0] - self.angle(run.time.values)).max())
        assert errors[1] < 2e-4
        assert 3.5 < errors[0] / errors[1] < 4.5

    @pytest.mark.thorough
    def test_default_interval(self):
        change = fa.Change("joints[0].stiffness", to=lambda t: 40.0 - 10.0 * t)
        run = self.run({"to": change.to}, change.interval)
        error = abs(run.joint_angle.values[:, 0] - self.angle(run.time.values)).max()
        assert error < 1e-5, "rad, as the how-to page states"
        assert run.change_path.size == 1
        assert run.change_to.item() == pytest.approx(10.0, abs=0.06)

    @pytest.mark.thorough
    def test_friction_that_grows(self):
        arm = changing_link(friction=fa.Friction(coulomb=0.0, viscous=0.1))
        change = fa.Change("joints[0].friction.viscous", to=lambda t: 0.1 + 0.4 * t)
        run = fa.simulate(arm, 2.0, initial_rate=[1.0], changes=[change], rate=50.0)
        t = run.time.values
        wanted = np.exp(-(0.1 * t + 0.2 * t**2) / INERTIA)
        # Midpoints integrate the linear coefficient exactly at the ends of the intervals.
        np.testing.assert_allclose(run.joint_rate.values[:, 0], wanted, rtol=1e-6)

    @pytest.mark.thorough
    def test_mass_that_is_added_steadily_at_rest(self):
        """Rain into a bucket: the angular momentum of a free link remains."""
        change = fa.Change("payload.mass", to=lambda t: MASS + 0.5 * t)
        run = fa.simulate(changing_link(), 2.0, initial_rate=[1.0], changes=[change], rate=50.0)
        t = run.time.values[1:]
        # A sample at the end of an interval has the mass of its middle.
        wanted = INERTIA / (INERTIA + 0.5 * LENGTH**2 * (t - 0.005))
        np.testing.assert_allclose(run.joint_rate.values[1:, 0], wanted, rtol=1e-9)

    def test_jump_of_a_table_is_a_change_at_a_time(self):
        table = fa.Change("payload.mass", to=([0.0, 0.5, 0.5, 1.0], [MASS, MASS, 1.2, 1.2]))
        step = fa.Change("payload.mass", at=0.5, to=1.2)
        runs = [
            fa.simulate(changing_link(), 1.0, initial_rate=[0.5], changes=[change], rate=100.0)
            for change in (table, step)
        ]
        np.testing.assert_array_equal(*(run.q.values for run in runs))
