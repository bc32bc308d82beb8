"""The very same kernel sources over CasADi's symbolic scalars."""

import casadi
import numpy as np
import pytest

import flexarm as fa
from arm_states import parts, state_array, tip_loads
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import undecorated
from flexarm.kernels.composite_body import mass_matrix
from flexarm.kernels.layout import new_workspace
from flexarm.kernels.newton_euler import inverse_dynamics
from flexarm.kernels.observables import POSE_COLUMNS, energies, poses


@pytest.fixture(scope="module", autouse=True)
def _plain_results_of_numpy_functions():
    """``np.sin`` of a CasADi scalar is to be a CasADi scalar; newer versions want to be told so."""
    options = casadi.GlobalOptions
    if not hasattr(options, "setNumpyMode"):
        yield
        return
    before = options.getNumpyMode()
    options.setNumpyMode(-1)
    yield
    options.setNumpyMode(before)


@pytest.fixture(params=["linear", "second_order"])
def arm(request):
    return fa.Arm(
        links=[
            fa.Link(length=0.8, flexural_rigidity=20.0, mass_per_length=0.5, elements=1),
            fa.Link(
                length=0.6,
                flexural_rigidity=9.0,
                mass_per_length=0.4,
                rotary_inertia_per_length=1e-4,
                elements=1,
                damping=fa.ModalDamping(ratio=0.01),
            ),
        ],
        joints=[fa.Joint(hub_inertia=0.01, damping=0.1), fa.Joint(mass=0.3)],
        payload=fa.Payload(mass=0.2, inertia=0.001, offset=(0.05, -0.02)),
        gravity=(1.0, -9.0),
        theory=request.param,
    )


class Symbols:
    """Symbolic arguments of the kernels, and how to turn their results into functions."""

    def __init__(self, arm):
        self.arm = arm
        self.q, self.qd, self.qdd = (casadi.SX.sym(name, arm.dof) for name in ("q", "qd", "qdd"))
        self.torque = casadi.SX.sym("torque", arm.joints)
        self.force = casadi.SX.sym("force", 3)
        self.arguments = [self.q, self.qd, self.qdd, self.torque, self.force]

    def state(self):
        return state_array(self.arm, entries(self.q), entries(self.qd))

    def loads(self):
        return tip_loads(self.arm, entries(self.force))

    def work(self):
        return new_workspace(self.arm.assembly.constants, object)

    def values(self, results, *numbers):
        """Evaluate an object array of expressions."""
        flat = casadi.vertcat(*[casadi.SX(value) for value in np.ravel(results)])
        function = casadi.Function("kernel", self.arguments, [flat])
        return np.array(function(*numbers)).reshape(np.shape(results))


def entries(symbol):
    """The scalars of a CasADi vector, as an object array."""
    array = np.empty(symbol.numel(), dtype=object)
    array[:] = casadi.vertsplit(symbol)
    return array


def states(arm):
    rng = np.random.default_rng(7)
    for _ in range(3):
        q, qd, qdd = rng.normal(size=(3, arm.dof)) * [[0.03], [0.5], [2.0]]
        yield q, qd, qdd, rng.normal(size=arm.joints), rng.normal(size=3)


def test_forward_dynamics(arm):
    symbols = Symbols(arm)
    sizes, constants, _ = parts(arm)
    work = symbols.work()
    torque = arm.padded_torque(entries(symbols.torque))
    undecorated(forward_dynamics)(sizes, constants, symbols.state(), torque, symbols.loads(), work)
    for q, qd, qdd, tau, force in states(arm):
        found = symbols.values(arm.unpadded(work.acceleration), q, qd, qdd, tau, force)
        # The same operations in the same order, but for fused multiply-adds of the machine code.
        np.testing.assert_allclose(
            found, arm.forward_dynamics(q, qd, tau, force), rtol=1e-12, atol=1e-12
        )


def test_inverse_dynamics(arm):
    symbols = Symbols(arm)
    sizes, constants, _ = parts(arm)
    work = symbols.work()
    undecorated(inverse_dynamics)(
        sizes,
        constants,
        symbols.state(),
        arm.padded(entries(symbols.qdd)),
        symbols.loads(),
        work,
    )
    for q, qd, qdd, tau, force in states(arm):
        found = symbols.values(arm.unpadded(work.force), q, qd, qdd, tau, force)
        wanted = arm.inverse_dynamics(q, qd, qdd, force)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * abs(wanted).max())


def test_mass_matrix(arm):
    symbols = Symbols(arm)
    sizes, constants, _ = parts(arm)
    n, width = arm.assembly.bodies, 1 + arm.assembly.modes
    M = np.zeros((n, width, n, width), dtype=object)
    undecorated(mass_matrix)(sizes, constants, symbols.state(), symbols.work(), M)
    kept = arm.assembly.coordinates
    M = M.reshape(n * width, n * width)[np.ix_(kept, kept)]
    for q, *others in states(arm):
        found = symbols.values(M, q, *others)
        wanted = arm.mass_matrix(q)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * abs(wanted).max())


def test_poses_and_energies(arm):
    symbols = Symbols(arm)
    sizes, constants, _ = parts(arm)
    n = arm.assembly.bodies
    body_poses, tip = np.zeros((n, POSE_COLUMNS), dtype=object), np.zeros(6, dtype=object)
    energy = np.zeros(3, dtype=object)
    undecorated(poses)(sizes, constants, symbols.state(), body_poses, tip)
    for q, qd, *others in states(arm):
        found = symbols.values(tip, q, qd, *others)
        wanted = np.concatenate([arm.tip(q), arm.tip_velocity(q, qd)])
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14)
    undecorated(energies)(sizes, constants, symbols.state(), body_poses, tip, energy)
    for q, qd, *others in states(arm):
        found = symbols.values(energy, q, qd, *others)
        np.testing.assert_allclose(found, arm.energy(q, qd)[:3], rtol=1e-12)


def test_lagrange_equations_by_symbolic_differentiation(arm):
    """d/dt dT/dqd - dT/dq + dU/dq from the energies' expressions is the inverse dynamics."""
    symbols = Symbols(arm)
    sizes, constants, _ = parts(arm)
    n = arm.assembly.bodies
    body_poses, tip = np.zeros((n, POSE_COLUMNS), dtype=object), np.zeros(6, dtype=object)
    energy = np.zeros(3, dtype=object)
    undecorated(energies)(sizes, constants, symbols.state(), body_poses, tip, energy)
    kinetic, potential = energy[0], energy[1] + energy[2]
    momentum = casadi.gradient(kinetic, symbols.qd)
    rate = casadi.jtimes(momentum, symbols.q, symbols.qd)
    rate += casadi.jtimes(momentum, symbols.qd, symbols.qdd)
    force = rate - casadi.gradient(kinetic - potential, symbols.q)
    for q, qd, qdd, tau, tip_force in states(arm):
        found = symbols.values(entries(force), q, qd, qdd, tau, tip_force)
        wanted = arm.inverse_dynamics(q, qd, qdd) - arm.damping_matrix() @ qd
        # Energies are sums of a few hundred products.
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * abs(wanted).max())
