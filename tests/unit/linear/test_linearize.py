"""Linear models against finite differences, nonlinear runs and python-control."""

import sys

import control
import numpy as np
import pytest
from scipy.linalg import expm

import flexarm as fa

GRAVITY = (1.0, -9.0)
SENSORS = [
    fa.Sensor("position", 1, 0.6),
    fa.Sensor("velocity", 1, 0.6, name="speed"),
    fa.Sensor("acceleration", 1, 0.6),
    fa.Sensor("acceleration", 2, frame="link"),
]
CHANNELS = ["joint_angle", "joint_rate", "tip", "tip_velocity", "link_tip_deflection", "strain"]
ACTING = [fa.Load(2, (0.5, 1.0), spread=(0.1, 0.6))]
PUSH = fa.Load(1, (1.0, -2.0), 0.3, station=0.6, frame="link")


def two_links(theory="second_order", gravity=GRAVITY, coulomb=0.2):
    return fa.Arm(
        links=[
            fa.Link(
                length=1.0,
                flexural_rigidity=30.0,
                mass_per_length=1.0,
                segments=2,
                elements=2,
                damping={"kind": "rayleigh", "stiffness_coefficient": 1e-3},
                gauges=[fa.Gauge(station=0.1, distance=0.005)],
            ),
            fa.Link(length=0.7, flexural_rigidity=20.0, mass_per_length=1.0, elements=1),
        ],
        joints=[
            fa.Joint(
                hub_inertia=0.1,
                damping=0.2,
                friction=fa.Friction(viscous=0.1, coulomb=coulomb, smoothing_rate=0.01),
            ),
            fa.Joint(hub_inertia=0.05, mass=0.3, stiffness=2.0),
        ],
        payload=fa.Payload(mass=0.2, offset=(0.02, 0.03)),
        gravity=gravity,
        theory=theory,
    )


def moving(arm):
    """Return a general state: bent, in motion, not in equilibrium."""
    rng = np.random.default_rng(5)
    q, qd = arm.rest([0.4, 0.3]), rng.normal(size=arm.dof)
    for piece in arm.assembly.pieces:
        size = np.sqrt(piece.shapes.w2)
        q[piece.modal] = 0.1 * rng.normal(size=size.size) / size
        qd[piece.modal] *= 0.3
    return q, qd


class TestFiniteDifferences:
    """About a moving, bent state under torques, loads and a base acceleration."""

    TORQUE, FORCE, BASE = np.array([1.0, -0.5]), np.array([0.3, -0.2]), np.array([0.5, 0.7])

    def model(self, arm, q, qd, change=None, **inputs):
        """Linearise; ``change`` is added to the loads:

        (torque, tip force, base acceleration, push).
        """
        torque, force, base, push = (0.0, 0.0, 0.0, 0.0) if change is None else change
        scaled = fa.Load(1, push * np.array([1.0, -2.0]), push * 0.3, station=0.6, frame="link")
        return fa.linearize(
            arm,
            q,
            qd,
            self.TORQUE + torque,
            inputs=["torque", "tip_force", "base_acceleration", ("push", PUSH)],
            outputs=[*CHANNELS, "torque", *SENSORS],
            tip_force=self.FORCE + force,
            loads=[*ACTING, scaled],
            base_acceleration=self.BASE + base,
        )

    def steps(self, arm):
        """Return the step of each state and input; truncation falls by the square, rounding
        rises."""
        stiffness = np.ones(arm.dof)
        for piece in arm.assembly.pieces:
            stiffness[piece.modal] = np.sqrt(piece.shapes.w2)
        return 3e-6 * np.concatenate([1.0 / stiffness, np.ones(arm.dof)])

    @pytest.mark.sampled("second_order")
    @pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # of the axial loads
    @pytest.mark.parametrize("theory", ["linear", "second_order"])
    def test_state_matrices_equal_differences(self, theory):
        arm = two_links(theory)
        q, qd = moving(arm)
        model = self.model(arm, q, qd)
        x = np.concatenate([q, qd])
        for k, step in enumerate(self.steps(arm)):
            unit = step * np.eye(x.size)[k]
            ahead, behind = (self.model(arm, *np.split(x + sign * unit, 2)) for sign in (1.0, -1.0))
            slope = (ahead.drift - behind.drift) / (2 * step)
            # Accelerations near 1e4, their rounding 1e-12 over the step; the friction's curvature.
            scale = np.abs(model.A[:, k]).max()
            np.testing.assert_allclose(model.A[:, k], slope, rtol=0, atol=3e-6 * (1.0 + scale))
            slope = (ahead.output - behind.output) / (2 * step)
            scale = np.abs(model.C[:, k]).max()
            np.testing.assert_allclose(model.C[:, k], slope, rtol=0, atol=3e-6 * (1.0 + scale))

    def test_input_matrices_equal_differences(self):
        """Everything is affine in the inputs, so differences are exact except for rounding."""
        arm = two_links()
        q, qd = moving(arm)
        model = self.model(arm, q, qd)
        unit, none = np.eye(2), np.zeros(2)
        changes = [
            *((u, none, none, 0.0) for u in unit),
            *((none, u, none, 0.0) for u in unit),
            *((none, none, u, 0.0) for u in unit),
            (none, none, none, 1.0),
        ]
        for k, change in enumerate(changes):
            moved = self.model(arm, q, qd, change)
            atol = 1e-11 * np.abs(model.drift).max()
            np.testing.assert_allclose(model.B[:, k], moved.drift - model.drift, rtol=0, atol=atol)
            atol = 1e-11 * np.abs(model.output).max()
            slope = moved.output - model.output
            np.testing.assert_allclose(model.D[:, k], slope, rtol=0, atol=atol)

    def test_derivatives_include_the_same_loads(self):
        arm = two_links()
        q, qd = moving(arm)
        model = self.model(arm, q, qd)
        found = arm.derivatives(q, qd, self.TORQUE, self.FORCE, ACTING, self.BASE)
        n = arm.dof
        np.testing.assert_allclose(found.q, model.A[n:, :n], rtol=1e-12)
        np.testing.assert_allclose(found.qd, model.A[n:, n:], rtol=1e-12)
        np.testing.assert_allclose(found.torque, model.B[n:, :2], rtol=1e-12)
        bare = arm.derivatives(q, qd, self.TORQUE)
        assert np.abs(bare.q - found.q).max() > 1e-3

    def test_second_order_form(self):
        """M, D and K agree with A, also about a motion."""
        arm = two_links()
        model = self.model(arm, *moving(arm))
        n = arm.dof
        for block, matrix in ((model.A[n:, :n], model.stiffness), (model.A[n:, n:], model.damping)):
            error = np.abs(model.mass @ block + matrix).max()
            assert error < 1e-12 * np.abs(model.mass).max() * np.abs(block).max() * n


def test_sensors_equal_the_motion_of_their_points():
    """Against differences in time of the drawn shape, along the motion that starts at the state."""
    arm = two_links()
    q, qd = moving(arm)
    model = fa.linearize(arm, q, qd, [1.0, -0.5], outputs=[*SENSORS, "tip"])
    qdd = model.drift[arm.dof :]
    h = 1e-5

    def point(t, link, place):
        return arm.shape(q + t * qd + t * t * qdd / 2, 11)[link, place]

    at, ahead, behind = (point(t, 0, 6) for t in (0.0, h, -h))
    np.testing.assert_allclose(model.output[:2], at, rtol=1e-12)
    np.testing.assert_allclose(model.output[2:4], (ahead - behind) / (2 * h), rtol=1e-7)
    # Rounding of positions near one over h squared: 1e-6, beside accelerations of 1e2.
    second = (ahead - 2 * at + behind) / h**2
    np.testing.assert_allclose(model.output[4:6], second, atol=2e-5 * np.abs(second).max())
    at, ahead, behind = (point(t, 1, 10) for t in (0.0, h, -h))
    angle = arm.tip(q)[2] - arm.nodal(q)[1][-1, 1]  # of the link's root tangent
    felt = (ahead - 2 * at + behind) / h**2 - GRAVITY
    turned = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]] @ felt
    np.testing.assert_allclose(model.output[6:8], turned, atol=2e-5 * np.abs(second).max())
    np.testing.assert_allclose(model.output[8:], arm.tip(q)[:2], rtol=1e-12)


def test_error_against_a_nonlinear_run_is_quadratic_in_the_perturbation():
    # Without dry friction, which is linear only for rates far below its smoothing rate.
    arm = two_links(gravity=(0.0, -9.81), coulomb=0.0)
    rest = fa.equilibrium(arm, [-1.2, 0.3])
    model = fa.linearize(arm, rest, outputs=["tip", "strain"])
    assert np.abs(model.drift).max() < 1e-7
    # Along the slow motions, because fast modes would be below the run's tolerance.
    direction = np.zeros(2 * arm.dof)
    direction[arm.joint_index] = 1.0, -0.7
    missed = []
    for size in (1e-2, 1e-3):
        run = fa.simulate(
            arm,
            0.3,
            initial=rest.q + size * direction[: arm.dof],
            torque=lambda t: rest.torque,
            rtol=1e-11,
            atol=1e-13,
        )
        x = expm(0.3 * model.A) @ (size * direction)
        seen = np.concatenate([run.tip.values[-1], run.strain.values[-1]])
        missed.append(np.abs(seen - model.output - model.C @ x).max() / np.abs(model.C @ x).max())
    # Relative errors: proportional to the perturbation, the next order 1e-2 of it.
    assert missed[0] < 0.05
    assert missed[0] / missed[1] == pytest.approx(10.0, rel=0.1)


class TestPythonControl:
    def test_response_equals_a_nonlinear_simulation(self):
        """The torque is so small that nonlinear terms are below the compared digits."""
        arm = two_links("linear", gravity=(0.0, 0.0))
        rest = arm.rest([0.3, -0.5])
        model = fa.linearize(
            fa.Arm(arm.spec),
            fa.equilibrium(arm, [0.3, -0.5]),
            outputs=["joint_angle", "tip", "strain"],
        )
        time = np.arange(501) / 1000.0
        torque = 1e-6 * np.stack([np.sin(8 * time), np.cos(5 * time) - 1.0], axis=1)
        held = fa.equilibrium(arm, [0.3, -0.5]).torque
        run = fa.simulate(
            arm,
            0.5,
            torque=held + torque,
            torque_interpolation="linear",
            initial=rest,
            rtol=1e-12,
            atol=1e-17,
        )
        answer = control.forced_response(model.to_control(), time, torque.T)
        seen = np.hstack([run.joint_angle, run.tip, run.strain]) - model.output
        scale = np.abs(answer.outputs).max(axis=1)
        # Differences of positions near one lose 1e-16 beside 1e-7: 1e-9; the torque squared, 1e-6.
        error = np.abs(seen.T - answer.outputs).max(axis=1) / scale
        assert error.max() < 1e-6

    def test_names_are_exported(self):
        arm = two_links()
        model = fa.linearize(arm, inputs=["torque", "tip_moment"], outputs=["tip", *SENSORS])
        system = model.to_control()
        assert system.input_labels == ["torque[1]", "torque[2]", "tip_moment"]
        assert system.output_labels[:4] == ["tip[x]", "tip[y]", *SENSORS[0].labels()]
        assert system.output_labels[4:6] == ["speed[x]", "speed[y]"]
        assert system.state_labels == list(model.states)
        assert model.states[:3] == ("joint_angle[1]", "mode[1,1]", "mode[1,2]")
        assert model.states[arm.dof] == "joint_rate[1]"
        np.testing.assert_array_equal(system.A, model.A)

    def test_without_python_control_the_error_names_the_package(self, monkeypatch):
        model = fa.linearize(two_links())
        monkeypatch.setitem(sys.modules, "control", None)
        with pytest.raises(fa.InputError, match="pip install 'flexarm\\[control\\]'"):
            model.to_control()

    def test_poles_are_the_modes(self):
        arm = two_links(gravity=(0.0, 0.0)).spec
        bare = fa.Arm(links=[link.replace(damping=None) for link in arm.links])
        model = fa.linearize(bare, bare.rest([0.2, 0.9]))
        hertz = fa.modes(bare, [0.2, 0.9], joints="free").frequency_hz
        ours = np.sort(np.abs(model.poles.imag))[::2] / (2 * np.pi)
        # Rigid modes: rounding of A, whose norm is 1e7, in the square root.
        np.testing.assert_allclose(ours, hertz, rtol=1e-8, atol=1e-2)


class TestOperatingPoint:
    def test_equilibrium_gives_its_torque_and_loads(self):
        arm = two_links()
        rest = fa.equilibrium(arm, [0.4, -0.2], tip_force=(0.0, -1.0), loads=ACTING)
        model = fa.linearize(arm, rest)
        np.testing.assert_array_equal(model.torque, rest.torque)
        assert np.abs(model.drift).max() < 1e-7  # relative to accelerations of 1e3
        given = fa.linearize(arm, rest.q, torque=rest.torque, tip_force=(0, -1.0), loads=ACTING)
        np.testing.assert_allclose(given.A, model.A, rtol=1e-12)

    def test_equilibrium_is_found_by_default(self):
        arm = two_links(gravity=(0.0, -9.81))
        held = fa.linearize(arm)
        np.testing.assert_allclose(held.q, fa.equilibrium(arm).q)
        free = fa.linearize(arm, torque=[0.0, 0.0])
        np.testing.assert_allclose(free.q, fa.equilibrium(arm, torque=[0.0, 0.0]).q)
        assert np.abs(free.drift).max() < 1e-6

    def test_without_a_torque_the_joints_are_held(self):
        arm = two_links()
        model = fa.linearize(arm, arm.rest([0.3, 0.1]))
        q, zero = arm.rest([0.3, 0.1]), np.zeros(arm.dof)
        holding = arm.inverse_dynamics(q, zero, zero)[arm.joint_index]
        np.testing.assert_allclose(model.torque, holding, rtol=1e-12)

    def test_elastic_and_fixed_joints(self):
        link = fa.Link(length=1.0, flexural_rigidity=5.0, mass_per_length=1.0, elements=1)
        elastic = fa.Joint(stiffness=50.0, rotor_inertia=1e-3, gear_ratio=20.0)
        arm = fa.Arm(links=[link] * 3, joints=[elastic, fa.Joint(fixed=True), fa.Joint()])
        model = fa.linearize(arm, arm.rest([0.1, 0.2]), outputs=["joint_twist", "joint_angle"])
        assert model.states[:2] == ("joint_angle[1]", "joint_twist[1]")
        assert model.inputs == ("torque[1]", "torque[3]")
        assert model.C[0, 1] == 1.0
        assert model.C[2, 0] == 1.0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"inputs": ["torqe"]}, "inputs must be a Load or one of 'torque'"),
        ({"inputs": [3]}, "inputs must be names"),
        ({"inputs": [fa.Load(1, (0, 0))]}, "must have a nonzero force or moment"),
        ({"outputs": ["speed"]}, "outputs must be a Sensor or one of 17 names, got 'speed'"),
        ({"outputs": ["tip", "tip"]}, "outputs must have different names"),
        ({"outputs": [fa.Sensor("position", 1, name="a.b")]}, "names without dots"),
        ({"outputs": [fa.Sensor("position", 3)]}, "be the number of a link"),
        ({"qd": [1.0]}, "qd must be numbers of shape"),
        ({"base_acceleration": (1.0, 0.0)}, "base_acceleration is not supported"),
    ],
)
def test_wrong_input_is_rejected(fields, message):
    with pytest.raises(fa.InputError, match=message):
        fa.linearize(two_links(), **fields)


def test_wrong_sensors_and_duplicate_loads_are_rejected():
    with pytest.raises(fa.InputError, match="kind must be one of"):
        fa.Sensor("speed", 1)
    with pytest.raises(fa.InputError, match="frame must be world, except for accelerations"):
        fa.Sensor("position", 1, frame="link")
    arm = two_links()
    with pytest.raises(fa.InputError, match="cannot be combined with an equilibrium"):
        fa.linearize(arm, fa.equilibrium(arm), loads=ACTING)
    bare = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
    with pytest.raises(fa.InputError, match="has no gauges"):
        fa.linearize(bare, outputs="strain")
