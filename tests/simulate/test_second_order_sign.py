"""The mass matrix of the second-order theory is positive for any deflection and mesh, also under
sudden torques."""

import numpy as np
import pytest

import flexarm as fa

# Links bend further than their theory allows, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
START = [np.pi / 4, -np.pi / 2]


def torque(t):
    """A torque from the first instant on, which excites higher modes than a smooth one."""
    return [0.0, 3.0]


def table_one_arm(theory="second_order", **fields):
    links = [fa.Link(length=length, **{"elements": 8, **fields}, **ROD) for length in (1.4142, 1.0)]
    return fa.Arm(links=links, theory=theory)


def run(arm, duration=0.3):
    return fa.simulate(arm, duration, torque=torque, initial=arm.rest(START), rate=1000)


@pytest.mark.sampled("fields1", "fields3")
@pytest.mark.parametrize("fields", [{}, {"modes": 3}, {"segments": 4}, {"elements": 2}])
def test_meshes_agree_under_a_sudden_torque(fields):
    """With all modes of eight elements the run stopped at 0.031 s before kinetic energy was a sum
    of squares."""
    result = run(table_one_arm(**fields))
    assert result.time.values[-1] == pytest.approx(0.3)
    # All of them solve the same problem; a sudden torque excites modes that few modes omit.
    np.testing.assert_allclose(result.tip.values[-1], [2.1293, 0.7962], rtol=0, atol=5e-4)


def test_energy_is_conserved_after_a_sudden_torque():
    arm = table_one_arm()
    settings = {"rate": 500, "rtol": 1e-9, "atol": 1e-12}
    start = run(arm, 0.01)
    q, qd = start.q.values[-1], start.qd.values[-1]
    result = fa.simulate(arm, 0.05, initial=q, initial_rate=qd, **settings)
    strain = result.strain_energy.values
    total = result.kinetic_energy.values + strain
    assert strain[0] > 0.01 * total[0]
    np.testing.assert_allclose(total, total[0], rtol=1e-6)


@pytest.mark.thorough
def test_fine_mesh_agrees_with_a_coarse_one():
    """All 128 modes per link."""
    fine, coarse = (run(table_one_arm(elements=k), 0.002) for k in (64, 8))
    # Bending waves of the first instant are too fast on a coarse mesh: 1e-5 m.
    np.testing.assert_allclose(fine.tip.values, coarse.tip.values, rtol=0, atol=2e-5)


@pytest.mark.sampled("0.02-8", "1.0-8")
@pytest.mark.parametrize("elements", [8, 64])
@pytest.mark.parametrize("deflection", [0.02, 0.2, 1.0])
def test_mass_matrix_is_positive(elements, deflection):
    arm = table_one_arm(elements=elements)
    rng = np.random.default_rng(elements)
    for _ in range(8):
        q = arm.rest(rng.uniform(-3.0, 3.0, 2))
        for piece in arm.assembly.pieces:
            lowest = rng.normal(size=4)
            lowest *= deflection / np.abs(piece.shapes.P[:4] * lowest).sum()
            q[piece.modal][:4] = lowest
        mass = arm.mass_matrix(q)
        scale = np.sqrt(np.diag(mass))
        # Positive, except for the rounding of sums of up to 260 products.
        assert np.linalg.eigvalsh(mass / np.outer(scale, scale))[0] > -1e-13
        # By exact elimination: the acceleration of a joint under a unit torque.
        rest = np.zeros_like(q)
        before = arm.forward_dynamics(q, rest, [0.0, 0.0])
        for joint, at in enumerate(arm.joint_index):
            pushed = arm.forward_dynamics(q, rest, np.eye(2)[joint])
            assert pushed[at] > before[at]
