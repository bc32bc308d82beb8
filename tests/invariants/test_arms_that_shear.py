"""Arms of Timoshenko links: the kernels do not depend on the beam theory, so the same laws hold."""

import numpy as np
import pytest
from scipy.integrate import simpson

import flexarm as fa
from arm_states import complex_energies, exact_derivative, modal_parts

CONSTANTS = {
    "length": 0.8,
    "flexural_rigidity": 60.0,
    "mass_per_length": 1.5,
    "rotary_inertia_per_length": 4e-3,
    "shear_rigidity": 2000.0,
    "element": "timoshenko",
}
TABLE = fa.SectionTable(
    x=[0.0, 0.25, 0.6],
    flexural_rigidity=[50.0, 20.0, 8.0],
    mass_per_length=[1.0, 0.8, 0.3],
    rotary_inertia_per_length=[3e-3, 1e-3, 5e-4],
    shear_rigidity=[900.0, 500.0, 300.0],
)
BAR = {"kind": "rectangle", "width": 0.02, "height": 0.08}


def arm_of(theory, gravity=(0.0, 0.0)):
    """Return a chain of the three kinds of link descriptions, with a payload beside the tip."""
    links = [
        fa.Link(**CONSTANTS, elements=2),
        fa.Link(length=0.6, table=TABLE, element="timoshenko", elements=3, modes=4),
        fa.Link(length=0.4, material="aluminium", section=BAR, element="timoshenko", elements=1),
    ]
    joints = [fa.Joint(hub_inertia=0.02, mass=0.3, housing_inertia=0.01)] * 3
    payload = fa.Payload(mass=0.2, inertia=0.002, offset=(0.05, 0.02))
    return fa.Arm(links=links, joints=joints, payload=payload, theory=theory, gravity=gravity)


def state_of(arm, seed):
    """Draw joint angles and rates, and links bent by some hundredths of their length."""
    rng = np.random.default_rng(seed)
    q, qd = rng.normal(size=(2, arm.dof))
    elastic = modal_parts(arm)
    stiffness = np.sqrt(np.concatenate([piece.w2 for piece in arm.assembly.links]))
    q[elastic], qd[elastic] = 0.3 * q[elastic] / stiffness, 0.3 * qd[elastic]
    return q, qd, rng.normal(size=arm.n_joints)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("seed", range(4))
class TestDynamics:
    def test_inverse_of_forward_is_the_torque_without_modal_forces(self, theory, seed):
        arm = arm_of(theory, (0.0, -9.81))
        q, qd, torque = state_of(arm, seed)
        qdd = arm.forward_dynamics(q, qd, torque)
        wanted = np.zeros(arm.dof)
        wanted[arm.joint_index] = torque
        M = arm.mass_matrix(q)
        scale = np.sqrt(np.diag(M))
        size = np.linalg.norm((abs(M) @ abs(qdd)) / scale)
        missed = np.linalg.norm((arm.inverse_dynamics(q, qd, qdd) - wanted) / scale)
        assert missed < 1e-11 * size  # rounding of the inertia forces

    def test_forward_dynamics_solves_the_equations_of_motion(self, theory, seed):
        arm = arm_of(theory, (0.0, -9.81))
        q, qd, torque = state_of(arm, seed)
        force = -arm.bias_force(q, qd)
        force[arm.joint_index] += torque
        M = arm.mass_matrix(q)
        scale = np.sqrt(np.diag(M))
        dense = np.linalg.solve(M / np.outer(scale, scale), force / scale)
        found = scale * arm.forward_dynamics(q, qd, torque)
        assert np.linalg.norm(found - dense) < 1e-10 * np.linalg.norm(dense)

    def test_power_of_the_motors_is_the_rate_of_energy(self, theory, seed):
        arm = arm_of(theory, (2.0, -9.81))
        q, qd, torque = state_of(arm, seed)
        qdd = arm.forward_dynamics(q, qd, torque)
        rate = exact_derivative(
            lambda state: complex_energies(arm, state), np.stack([q, qd]), np.stack([qd, qdd])
        )
        power = torque @ qd[arm.joint_index]
        assert rate.sum() == pytest.approx(power, abs=1e-11 * np.abs(rate).sum())


def test_kinetic_energy_is_that_of_moving_points_and_rotating_sections():
    """Links alone, in the linear theory: points of the axis by `shape`, over a short time."""
    links = [fa.Link(**CONSTANTS, elements=2), fa.Link(**CONSTANTS, elements=1)]
    arm = fa.Arm(links=links)
    q, qd, _ = state_of(arm, 7)
    step, stations = 1e-5, 401
    ahead, behind = (arm.shape(q + s * step * qd, stations) for s in (1, -1))
    speed = np.sum(((ahead - behind) / (2 * step)) ** 2, axis=-1)
    x, energy, root = np.linspace(0.0, 0.8, stations), 0.0, 0.0
    for piece, squared in zip(arm.assembly.pieces, speed, strict=True):
        root += qd[arm.joint_index[piece.link]]
        turning = root + piece.shapes.rotation(x) @ qd[piece.modal]
        energy += simpson(1.5 * squared + 4e-3 * turning**2, x=x) / 2
        root += piece.shapes.dP @ qd[piece.modal]
    # The difference quotient has an error of step^2, Simpson's rule one of the fourth power of
    # 1/200.
    assert arm.energy(q, qd).kinetic == pytest.approx(energy, rel=1e-7)


@pytest.mark.parametrize("elements", [1, 4])
def test_tip_force_on_a_locked_arm(elements):
    """The tip moves by P L^3/3EI + P L/kGA, and its section turns by P L^2/2EI."""
    link = fa.Link(**CONSTANTS, elements=elements, gauges=[fa.Gauge(station=0.0, distance=0.01)])
    arm = fa.Arm(links=[link])
    zero, load = np.zeros(arm.dof), 3.0
    force = -arm.inverse_dynamics(zero, zero, zero, (0.0, load))
    elastic = modal_parts(arm)
    q = np.zeros(arm.dof)
    stiffness = arm.stiffness_matrix(zero)[np.ix_(elastic, elastic)]
    q[elastic] = np.linalg.solve(stiffness, force[elastic])
    deflection = load * (0.8**3 / (3 * 60.0) + 0.8 / 2000.0)
    np.testing.assert_allclose(arm.tip(q), [0.8, deflection, load * 0.8**2 / 120.0], rtol=1e-11)
    np.testing.assert_allclose(arm.nodal(q)[0][-1], arm.tip(q)[1:], rtol=1e-11)
    np.testing.assert_allclose(arm.strain(q), [-0.01 * load * 0.8 / 60.0], rtol=1e-11)


def test_two_locked_links_and_two_segments_equal_one_link():
    """A joint and a rigid connection transmit the rotation of sections."""
    one = fa.Link(**CONSTANTS, elements=8)
    half = one.replace(length=0.4, elements=4)
    whole = fa.modes(fa.Arm(links=[one])).squared_frequency
    for links in ([half, half], [one.replace(segments=2)]):
        found = fa.modes(fa.Arm(links=links)).squared_frequency[:3]
        # The interior shapes at the cut take the acceleration of one neighbour only.
        np.testing.assert_allclose(found, whole[:3], rtol=3e-3)


def test_segments_of_a_table_equal_the_whole_link():
    link = fa.Link(length=0.6, table=TABLE, element="timoshenko", elements=6)
    whole = fa.modes(fa.Arm(links=[link])).squared_frequency
    found = fa.modes(fa.Arm(links=[link.replace(segments=3)])).squared_frequency
    # The interior shapes at the cuts take the acceleration of one neighbour only; a table that is
    # cut in the wrong place changes the first frequency by some percent.
    np.testing.assert_allclose(found[:2], whole[:2], rtol=4e-3)


def test_shear_lowers_every_frequency():
    """Mesh and inertia are the same, and shear adds flexibility."""
    stiff = fa.Link(**{**CONSTANTS, "shear_rigidity": 1e15}, elements=6)
    soft = fa.Link(**CONSTANTS, elements=6)
    locked = [fa.modes(fa.Arm(links=[link])).frequency_hz for link in (soft, stiff)]
    assert np.all(locked[0] < locked[1])
    bending = fa.Link(
        **{**CONSTANTS, "shear_rigidity": None, "element": "euler_bernoulli"}, elements=6
    )
    plain = fa.modes(fa.Arm(links=[bending])).frequency_hz
    np.testing.assert_allclose(locked[1], plain, rtol=1e-9)  # shear parameters of 5e-11


def test_rigid_model_of_an_arm_that_shears():
    arm = arm_of("linear")
    rigid_counterpart = arm.rigid()
    assert rigid_counterpart.dof == 3
    M, rigid = (
        arm.mass_matrix(arm.rest([0.3, 1.0, -0.4])),
        rigid_counterpart.mass_matrix([0.3, 1.0, -0.4]),
    )
    joints = np.ix_(arm.joint_index, arm.joint_index)
    np.testing.assert_allclose(M[joints], rigid, rtol=1e-12)
