"""Equilibria: handbook deflections, holding torques, free joints, and arms without one."""

import numpy as np
import pytest

import flexarm as fa

L, EI, MU = 1.4, 105.0, 0.6
# Handbook numbers, to the rounding of sums over a few dozen coordinates.
EXACT = 1e-11


def cantilever(theory="linear", gravity=(0.0, 0.0), **link):
    fields = {"elements": 4, "flexural_rigidity": EI, "mass_per_length": MU, **link}
    return fa.Arm(links=[fa.Link(length=L, **fields)], gravity=gravity, theory=theory)


def at_tip(arm, result):
    """Return deflection and slope of a single link's tip."""
    return arm.nodal(result.q)[0][-1]


class TestClosedForms:
    """One linear link with a locked joint: exact at the nodes of any mesh."""

    @pytest.mark.parametrize("elements", [1, 4, 7])
    def test_force_and_moment_at_the_tip(self, elements):
        arm = cantilever(elements=elements)
        bent = at_tip(arm, fa.equilibrium(arm, tip_force=(0.0, 3.0)))
        np.testing.assert_allclose(bent, [3 * L**3 / (3 * EI), 3 * L**2 / (2 * EI)], rtol=EXACT)
        bent = at_tip(arm, fa.equilibrium(arm, tip_force=(0.0, 0.0, 3.0)))
        np.testing.assert_allclose(bent, [3 * L**2 / (2 * EI), 3 * L / EI], rtol=EXACT)

    @pytest.mark.parametrize("station", [0.7, 0.35])
    def test_force_and_moment_at_a_node(self, station):
        arm, a = cantilever(), station
        bent = at_tip(arm, fa.equilibrium(arm, loads=[fa.Load(1, (0.0, 3.0), station=a)]))
        exact = [3 * a**2 * (3 * L - a) / (6 * EI), 3 * a**2 / (2 * EI)]
        np.testing.assert_allclose(bent, exact, rtol=EXACT)
        bent = at_tip(arm, fa.equilibrium(arm, loads=[fa.Load(1, moment=3.0, station=a)]))
        np.testing.assert_allclose(bent, [3 * a * (2 * L - a) / (2 * EI), 3 * a / EI], rtol=EXACT)

    @pytest.mark.parametrize("station", [0.1, 0.52, 1.39])
    def test_force_at_any_station(self, station):
        """Exact at every node, also if the load is between two: a property of Hermite elements."""
        arm, a = cantilever(elements=3), station
        bent = arm.nodal(fa.equilibrium(arm, loads=[fa.Load(1, (0.0, 3.0), station=a)]).q)[0]
        x = np.arange(1, 4) * L / 3
        below = x < a
        deflection = np.where(below, x**2 * (3 * a - x), a**2 * (3 * x - a)) / (2 * EI)
        slope = np.where(below, 3 * x * (2 * a - x) / 2, 3 * a**2 / 2) / EI
        np.testing.assert_allclose(bent, np.stack([deflection, slope], axis=1), rtol=EXACT)

    @pytest.mark.parametrize("segments", [1, 4])
    def test_uniform_load(self, segments):
        arm = cantilever(segments=segments)
        w = 3.0 if segments == 1 else 1e-6  # segments are exact in the limit of small rotations
        load = fa.Load(1, (0.0, w), spread=(0.0, L))
        tip = arm.tip(fa.equilibrium(arm, loads=[load]).q)[1:] / w
        np.testing.assert_allclose(tip, [L**4 / (8 * EI), L**3 / (6 * EI)], rtol=1e-9)

    def test_distributed_load_on_the_outer_half(self):
        arm = cantilever()
        bent = at_tip(arm, fa.equilibrium(arm, loads=[fa.Load(1, (0, 3.0), spread=(L / 2, L))]))
        # The whole less the inner half: w L^4 / 8 EI less (w a^4 / 8 + w a^3 / 6 (L - a)) / EI.
        a = L / 2
        deflection = 3 * (L**4 / 8 - a**4 / 8 - a**3 / 6 * (L - a)) / EI
        np.testing.assert_allclose(bent, [deflection, 3 * (L**3 - a**3) / (6 * EI)], rtol=EXACT)

    def test_gravity_equals_a_uniform_load(self):
        heavy = cantilever(gravity=(0.0, -9.81))
        result = fa.equilibrium(heavy)
        w = -MU * 9.81
        exact = [w * L**4 / (8 * EI), w * L**3 / (6 * EI)]
        np.testing.assert_allclose(at_tip(heavy, result), exact, rtol=EXACT)
        assert result.torque == pytest.approx(-w * L**2 / 2, rel=EXACT)

    def test_loads_superpose(self):
        arm = cantilever()
        loads = [fa.Load(1, (0.0, 2.0), 0.4, station=0.3), fa.Load(1, (0, -5.0), spread=(0.2, 1.0))]
        single = [at_tip(arm, fa.equilibrium(arm, loads=[load])) for load in loads]
        both = at_tip(arm, fa.equilibrium(arm, loads=loads))
        np.testing.assert_allclose(both, sum(single), rtol=1e-9)

    def test_maxwells_reciprocity(self):
        arm = cantilever()
        x = np.array([0.35, 1.05])
        here, there = (fa.Load(1, (0.0, 1.0), station=s) for s in x)
        moved = [arm.nodal(fa.equilibrium(arm, loads=[load]).q)[0][:, 0] for load in (here, there)]
        assert moved[0][2] == pytest.approx(moved[1][0], rel=EXACT)


class TestTableOneArm:
    """The paper's arm held straight and horizontal, g = 9.81 m/s^2."""

    LENGTHS = (1.4142, 1.0)

    def arm(self, part=1.0):
        rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
        links = [
            fa.Link(length=length, elements=2 - i, **rod) for i, length in enumerate(self.LENGTHS)
        ]
        return fa.Arm(links=links, gravity=(0.0, -9.81 * part))

    def exact(self):
        """Return sag and slope of the elbow and sag of the tip, by superposition of handbook
        formulas."""
        w, (a, b) = 0.61732 * 9.81, self.LENGTHS
        force, moment = w * b, w * b * b / 2
        sag = (w * a**4 / 8 + force * a**3 / 3 + moment * a**2 / 2) / 105.0
        slope = (w * a**3 / 6 + force * a**2 / 2 + moment * a) / 105.0
        return np.array([sag, slope, sag + slope * b + w * b**4 / (8 * 105.0)])

    def test_sag_of_the_handbook(self):
        np.testing.assert_allclose(
            self.exact(), [0.1120489206, 0.1256440694, 0.2449024057], rtol=0, atol=6e-11
        )

    def test_linearised_about_straight_links(self):
        arm = self.arm()
        q, zero = arm.rest([0.0, 0.0]), np.zeros(arm.dof)
        elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        K = arm.stiffness_matrix(q)[np.ix_(elastic, elastic)]
        q[elastic] = -np.linalg.solve(K, arm.bias_force(q, zero)[elastic])
        first, second = arm.nodal(q)
        found = [*first[-1], first[-1, 0] + first[-1, 1] * self.LENGTHS[1] + second[-1, 0]]
        np.testing.assert_allclose(found, -self.exact(), rtol=EXACT)

    def test_equilibrium_approaches_it_for_small_loads(self):
        """The second link is at a tip that turns, so the formula is exact only for small loads."""
        missed = []
        for part in (1e-2, 1e-3):
            arm = self.arm(part)
            result = fa.equilibrium(arm)
            tip = -arm.tip(result.q)[1] / part
            missed.append(abs(tip - self.exact()[2]))
        assert missed[0] < 1e-5
        # The error grows with the square of the load.
        assert missed[0] / missed[1] == pytest.approx(100.0, rel=0.1)

    def test_full_load(self):
        arm = self.arm()
        result = fa.equilibrium(arm)
        assert result.stable
        assert arm.tip(result.q)[1] == pytest.approx(-self.exact()[2], rel=0.01)
        at_rest = np.zeros(arm.dof)
        qdd = arm.forward_dynamics(result.q, at_rest, result.torque)
        # Relative to accelerations of 1e4 while straight.
        assert abs(qdd).max() < 1e-6


class TestFreeJoints:
    def test_a_pendulum_hangs(self):
        arm = cantilever(gravity=(0.0, -9.81))
        result = fa.equilibrium(arm, [-1.2], torque=[0.0])
        assert arm.joint_angles(result.q)[0] == pytest.approx(-np.pi / 2, abs=1e-9)
        assert result.stable
        # m g L / 2 over m L^2 / 3, slightly less because of bending.
        assert result.lowest_eigenvalue == pytest.approx(1.5 * 9.81 / L, rel=0.01)

    def test_upright_pendulum_is_an_unstable_equilibrium(self):
        arm = cantilever(gravity=(0.0, -9.81))
        result = fa.equilibrium(arm, torque=[0.0], start=arm.rest([1.5]))
        assert arm.joint_angles(result.q)[0] == pytest.approx(np.pi / 2, abs=1e-9)
        assert not result.stable
        assert result.lowest_eigenvalue == pytest.approx(-1.5 * 9.81 / L, rel=0.01)

    @pytest.mark.parametrize("begin", [3.0, 1.5, 0.2, 0.0, -1.0])
    def test_unbalanced_pendulum_moves_to_the_hanging_equilibrium(self, begin):
        arm = cantilever(gravity=(0.0, -9.81))
        result = fa.equilibrium(arm, [begin], torque=[0.0])
        assert result.stable
        assert np.sin(arm.joint_angles(result.q)[0]) == pytest.approx(-1.0, abs=1e-9)
        assert abs(arm.joint_angles(result.q)[0] - begin) < np.pi + 1.6  # without additional turns

    @pytest.mark.parametrize("begin", [0.0, 0.3, 3.0])
    def test_falling_joint_comes_to_rest_at_its_stop(self, begin):
        stops = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=1e4)
        link = fa.Link(length=L, mass_per_length=MU, flexible=False)
        arm = fa.Arm(links=[link], joints=[fa.Joint(limits=stops)], gravity=(0.0, -9.81))
        angle = fa.equilibrium(arm, [begin], torque=[0.0]).q[0]
        weight = MU * L * 9.81 * L / 2
        assert 1e4 * (-0.5 - angle) == pytest.approx(weight * np.cos(angle), rel=1e-6)

    def test_torque_holds_a_rigid_pendulum_at_an_angle(self):
        arm = cantilever(gravity=(0.0, -9.81)).rigid()
        weight = MU * L * 9.81 * L / 2
        result = fa.equilibrium(arm, [-1.5], torque=[0.5 * weight])
        assert np.cos(result.q[0]) == pytest.approx(0.5, rel=1e-9)
        assert result.torque[0] == pytest.approx(0.5 * weight, rel=1e-12)

    def test_springs_share_a_torque(self):
        links = [fa.Link(length=1.0, mass_per_length=1.0, flexible=False)] * 2
        joints = [fa.Joint(stiffness=10.0, rest_angle=0.3), fa.Joint(stiffness=4.0)]
        arm = fa.Arm(links=links, joints=joints)
        result = fa.equilibrium(arm, torque=[2.0, -1.0])
        np.testing.assert_allclose(result.q, [0.5, -0.25], rtol=1e-12)
        held = fa.equilibrium(arm, [0.5, -0.25])
        np.testing.assert_allclose(held.torque, [2.0, -1.0], rtol=1e-12)
        assert held.stable
        assert held.lowest_eigenvalue == np.inf  # no coordinates remain free

    def test_stop_carries_an_arm_that_leans_on_it(self):
        stop = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=2e3, damping=0.2)
        link = fa.Link(length=1.0, mass_per_length=2.0, flexible=False)
        arm = fa.Arm(links=[link], joints=[fa.Joint(limits=stop)], gravity=(0.0, -9.81))
        result = fa.equilibrium(arm, [-0.51], torque=[0.0])
        beyond = -0.5 - result.q[0]
        assert 2e3 * beyond == pytest.approx(9.81 * np.cos(result.q[0]), rel=1e-9)

    def test_dry_friction_holds_nothing(self):
        """Regularised friction has no torque at rest, so the arm hangs down."""
        link = fa.Link(length=1.0, mass_per_length=2.0, flexible=False)
        sticky = fa.Joint(friction=fa.Friction(coulomb=5.0))
        arm = fa.Arm(links=[link], joints=[sticky], gravity=(0.0, -9.81))
        assert fa.equilibrium(arm, [-1.4], torque=[0.0]).q[0] == pytest.approx(-np.pi / 2)


class TestStart:
    def test_start_from_a_state_nearby(self):
        arm = cantilever("second_order", gravity=(0.0, -9.81), segments=4)
        found = fa.equilibrium(arm, [0.3])
        again = fa.equilibrium(arm, start=found.q + 1e-3 * (np.arange(arm.dof) > 0))
        np.testing.assert_allclose(again.q, found.q, rtol=0, atol=1e-10)
        np.testing.assert_allclose(again.torque, found.torque, rtol=1e-9)

    def test_search_from_far_away_may_fail(self):
        link = fa.Link(length=1.0, mass_per_length=2.0, flexible=False)
        arm = fa.Arm(links=[link], gravity=(0.0, -9.81))
        start = arm.rest([0.3])
        with pytest.raises(fa.EquilibriumError) as reported:
            fa.equilibrium(arm, start=start, torque=[30.0])
        np.testing.assert_array_equal(reported.value.q, start)


class TestNone:
    def test_torque_on_a_free_joint_has_no_equilibrium(self):
        arm = cantilever()
        with pytest.raises(fa.EquilibriumError) as reported:
            fa.equilibrium(arm, [0.4], torque=[1.0])
        error = reported.value
        assert error.load_fraction == 0.0
        np.testing.assert_array_equal(error.q, arm.rest([0.4]))
        assert str(error).startswith("no equilibrium found: ")
        assert isinstance(error, fa.FlexarmError)

    def test_loads_over_time_are_rejected(self):
        load = fa.Load(1, (0.0, 1.0), factor=np.sin)
        with pytest.raises(fa.InputError, match="factor must be constant in time"):
            fa.equilibrium(cantilever(), loads=[load])

    @pytest.mark.parametrize(
        ("fields", "message"),
        [
            ({"joint_angles": [1.0, 2.0]}, "equilibrium: joint_angles must have shape"),
            ({"torque": [np.nan]}, r"equilibrium: torque\[0\] must be finite"),
            ({"start": [0.0]}, "equilibrium: start must be numbers of shape"),
            (
                {"tip_force": (1.0, 2.0, 3.0, 4.0)},
                r"equilibrium: tip_force must be \(Fx, Fy\) .*loads=",
            ),
        ],
    )
    def test_wrong_input_is_rejected(self, fields, message):
        with pytest.raises(fa.InputError, match=message):
            fa.equilibrium(cantilever(), **fields)


@pytest.mark.sampled("6.0--0.1")
@pytest.mark.parametrize(("force", "side"), [(2.7, 1e-4), (2.7, 0.01), (3.5, 0.1), (6.0, -0.1)])
def test_column_bends_to_the_side_of_a_small_load(force, side):
    """Beyond Euler's load of 2.467 the straight branch is unstable, and the bent one is found."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=8, segments=8)
    arm = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)], theory="second_order")
    result = fa.equilibrium(arm, tip_force=(-force, side))
    assert result.stable
    assert np.sign(side) * arm.tip(result.q)[1] > 0.4
    # Without a side load the search finds only the straight column.
    assert not fa.equilibrium(arm, tip_force=(-force, 0.0)).stable


def test_a_joint_in_its_gap_leans_on_a_contact():
    """The search begins where no spring acts, with a singular stiffness, and warns of nothing."""
    rod = {"flexural_rigidity": 500.0, "mass_per_length": 0.5, "elements": 1}
    gap = fa.Joint(rotor_inertia=0.1, stiffness=400.0, backlash=0.1)
    heavy = fa.Arm(links=[fa.Link(length=0.8, **rod)], joints=[gap], gravity=(0.0, -9.81))
    rest = fa.equilibrium(heavy, [0.0])
    weight = 0.5 * 0.8 * 9.81 * 0.4  # N m, of the straight link
    twist = -0.05 - weight / 400.0
    assert rest.torque == pytest.approx([weight * np.cos(twist)], rel=1e-4)  # and little bending
    assert rest.stable


@pytest.mark.parametrize("stiffness", [10.0, 100.0, 1e3, 1e5])
def test_a_free_arm_falls_on_a_floor(stiffness):
    """The floor carries half of the weight of a straight link; steps cross it at first."""
    link = fa.Link(length=0.8, flexural_rigidity=500.0, mass_per_length=0.5)
    arm = fa.Arm(links=[link], joints=[fa.Joint()], gravity=(0.0, -9.81)).rigid()
    weight = 0.5 * 0.8 * 9.81
    floor = fa.Wall(point=[0.0, -0.3], normal=[0.0, 1.0])
    contact = fa.Contact(surface=floor, stiffness=stiffness * weight / 0.8)
    rest = fa.equilibrium(arm, [0.0], torque=[0.0], contacts=[contact])
    assert arm.tip(rest.q)[1] == pytest.approx(-0.3 - 0.4 / stiffness, abs=1e-9)
    assert rest.stable


def test_a_free_arm_without_load_stays_in_its_gap():
    """Rounding errors of the forces, 5e-30 N m, do not start a search."""
    gap = fa.Joint(rotor_inertia=1e-5, gear_ratio=50.0, stiffness=300.0, backlash=0.02)
    link = fa.Link(length=0.8, flexural_rigidity=500.0, mass_per_length=0.5)
    arm = fa.Arm(links=[link], joints=[gap])
    rest = fa.equilibrium(arm, [0.3], torque=[0.0])
    np.testing.assert_array_equal(rest.q, arm.rest([0.3]))
    assert not rest.stable
