"""Arms as rigid bars on virtual joints: against the flexible arm, MuJoCo and Pinocchio."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import eigh
from typer.testing import CliRunner

import flexarm as fa
from flexarm.bridges.rigid_chain.export import _quadrature, coordinates, rigid_chain
from flexarm.cli.main import app

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.6}


def arm(**options):
    """Two links with damping, bodies at the joints, and a payload with an offset."""
    links = [
        fa.Link(length=1.2, **ROD, damping=fa.ModalDamping(ratio=0.01)),
        fa.Link(length=0.8, **ROD, damping=fa.RayleighDamping(stiffness_coefficient=1e-4)),
    ]
    joints = [
        fa.Joint(hub_inertia=0.02, damping=0.05),
        fa.Joint(hub_inertia=0.01, mass=0.5, housing_inertia=0.004, stiffness=3.0, rest_angle=0.2),
    ]
    payload = fa.Payload(mass=0.4, inertia=0.003, offset=(0.05, 0.02))
    return fa.Arm(links=links, joints=joints, payload=payload, gravity=(0.5, -9.81), **options)


def test_quadrature_of_a_taper():
    """Two nodes integrate the polynomials of degree 3 exactly, whatever the rigidity."""
    x, rigidity = np.array([0.0, 0.4, 1.0]), np.array([3.0, 2.0, 0.5])
    places, weights = _quadrature(x, rigidity, 2)
    for degree in range(4):
        exact = quad(lambda s, d=degree: s**d / np.interp(s, x, rigidity), 0, 1, points=[0.4])[0]
        assert weights @ places**degree == pytest.approx(exact, rel=1e-8)  # that of quad


@pytest.mark.parametrize(("count", "errors"), [(2, [1e-3, 0.02]), (4, [1e-5, 2e-4, 1e-3, 5e-3])])
def test_static_flexibility_is_exact_and_frequencies_converge(count, errors):
    rows = {row.name: row for row in rigid_chain(arm(), count).comparisons}
    assert abs(rows["tip deflection per force, m/N"].error) < 1e-12
    assert abs(rows["tip rotation per moment, rad/(N m)"].error) < 1e-12
    for k, limit in enumerate(errors, 1):
        assert abs(rows[f"frequency {k}, Hz"].error) < limit


@pytest.mark.parametrize("count", [2, 5])
def test_modal_damping_of_the_first_mode(count):
    link = fa.Link(length=1.2, **ROD, damping=fa.ModalDamping(ratio=[0.02, 0.05]))
    clamped = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)])
    chain = rigid_chain(clamped, count).arm
    rest = np.zeros(chain.dof)
    slow, shape = (
        part[..., 0] for part in eigh(chain.stiffness_matrix(rest), chain.mass_matrix(rest))
    )
    damped = shape @ np.diag([joint.damping for joint in chain.spec.joints[1:]]) @ shape
    assert damped / (2.0 * np.sqrt(slow)) == pytest.approx(0.02, rel=1e-9)


def test_sag_under_gravity():
    """The tip at rest, with given torques: the chain bends as the second-order theory does."""
    flexible = arm(theory="second_order")
    rest = fa.equilibrium(flexible, [0.3, -0.4])
    chain = rigid_chain(flexible, 6)
    angles = np.zeros(chain.arm.n_joints)
    driven = coordinates(chain.arm, chain.driven)
    angles[driven] = [0.3, -0.4]
    for _ in range(20):  # Newton's method on the bending, with the driven joints given
        q = chain.arm.rest(angles)
        free = np.setdiff1d(np.arange(chain.arm.dof), driven)
        force = chain.arm.bias_force(q, np.zeros_like(q))[free]
        angles[free] -= np.linalg.solve(chain.arm.stiffness_matrix(q)[np.ix_(free, free)], force)
    tip = chain.arm.tip(chain.arm.rest(angles))
    sag = np.abs(flexible.tip(flexible.rest([0.3, -0.4])) - flexible.tip(rest.q)).max()
    # The theory is of second order in the sag, a tenth of the length.
    np.testing.assert_allclose(tip, flexible.tip(rest.q), rtol=0, atol=0.01 * sag)


def test_the_file_states_the_errors(tmp_path):
    path = fa.export_mjcf(arm(), tmp_path / "arm.xml", virtual_joints=2)
    text = path.read_text()
    assert "frequency 2, Hz" in text
    assert "-1." in text.partition("frequency 2")[2].splitlines()[0]  # -1.2 %


def test_refused(tmp_path):
    spec = arm().spec
    joints = [spec.joints[0], fa.Joint(friction=fa.Friction(coulomb=1.0), rotor_inertia=1e-3)]
    with pytest.raises(fa.InputError) as caught:
        fa.export_mjcf(fa.Arm(spec.replace(joints=joints)), tmp_path / "arm.xml")
    assert [problem.name for problem in caught.value.problems] == [
        "joints[1].friction",
        "joints[1].rotor_inertia",
    ]
    with pytest.raises(fa.InputError, match=r"end in \.urdf"):
        fa.export_urdf(arm(), tmp_path / "arm.xml")
    with pytest.raises(fa.InputError, match="virtual_joints must be a whole number from 2"):
        fa.export_mjcf(arm(), tmp_path / "arm.xml", virtual_joints=1)
    massless = fa.Link(length=0.5, mass_per_length=0.0, flexible=False)
    tipped = fa.Arm(links=[massless], payload=fa.Payload(mass=1.0))
    with pytest.raises(fa.InputError, match="no inertia in link1_1"):
        fa.export_mjcf(tipped, tmp_path / "arm.xml")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("kind", "suffix"), [("mjcf", "xml"), ("urdf", "urdf")])
def test_command(kind, suffix, tmp_path):
    path = tmp_path / "boom.yaml"
    fa.save_arm(arm(), path)
    found = CliRunner().invoke(app, ["export", kind, str(path), "--virtual-joints", "3"])
    assert found.exit_code == 0, found.output
    assert "bending2_3" in (tmp_path / f"boom.{suffix}").read_text()


def fixed_at_joint_2():
    spec = arm().spec
    joints = [spec.joints[0], fa.Joint(fixed=True, rest_angle=0.7)]
    return fa.Arm(spec.replace(joints=joints))


def loaded(path):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: the file was not run")
    model = mujoco.MjModel.from_xml_path(str(path))
    return mujoco, model, mujoco.MjData(model)


def state(chain):
    rng = np.random.default_rng(2)
    return 0.3 * rng.normal(size=chain.arm.dof), rng.normal(size=chain.arm.dof)


def placed(flexible, path):
    """Return a file in MuJoCo and its chain, both in a random state with equal mass matrices."""
    mujoco, model, data = loaded(path)
    chain = rigid_chain(flexible, 4)
    q, qd = state(chain)
    data.qpos[:], data.qvel[:] = q, qd
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    for column, unit in enumerate(np.eye(model.nv)):
        mujoco.mj_mulM(model, data, M[column], unit)
    np.testing.assert_allclose(M, chain.arm.mass_matrix(q), rtol=0, atol=1e-12 * np.abs(M).max())
    return data, chain, q, qd


@pytest.mark.parametrize("fixed", [False, True])
def test_equations_in_mujoco(fixed, tmp_path):
    """Mass matrix, bias with gravity and Coriolis forces, springs and damping."""
    flexible = fixed_at_joint_2() if fixed else arm()
    data, chain, q, qd = placed(flexible, fa.export_mjcf(flexible, tmp_path / "arm.xml"))
    bias = data.qfrc_bias - data.qfrc_passive
    limit = 1e-11 * np.abs(bias).max()
    np.testing.assert_allclose(bias, chain.arm.bias_force(q, qd), rtol=0, atol=limit)
    np.testing.assert_allclose(data.sensor("tip").data[:2], chain.arm.tip(q)[:2], atol=1e-13)


def test_run_in_mujoco(tmp_path):
    """A swing of 1 s under torques, against the flexible arm with the second-order theory."""
    flexible = arm(theory="second_order")
    mujoco, model, data = loaded(fa.export_mjcf(flexible, tmp_path / "arm.xml", virtual_joints=6))
    torque = np.array([25.0, 8.0])
    run = fa.simulate(flexible, 0.5, torque=lambda t: torque, rate=100.0)
    data.ctrl[:] = torque
    steps = int(np.ceil(0.5 / model.opt.timestep))
    model.opt.timestep = 0.5 / steps
    for _ in range(steps):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()  # an unstable motion would start again
    mujoco.mj_forward(model, data)
    moved = np.linalg.norm(run.tip.values[-1] - run.tip.values[0])
    assert moved > 0.3
    error = np.linalg.norm(data.sensor("tip").data[:2] - run.tip.values[-1])
    bent = np.abs(run.link_tip_deflection.values).max()
    assert error < 0.02 * bent


@pytest.mark.parametrize("fixed", [False, True])
def test_urdf_in_mujoco(fixed, tmp_path):
    """MuJoCo reads URDF without the springs: masses and joints are those of the chain."""
    flexible = fixed_at_joint_2() if fixed else arm()
    placed(flexible, fa.export_urdf(flexible, tmp_path / "arm.urdf"))


def test_a_hub_radius_lengthens_the_first_bar():
    beam = {"flexural_rigidity": 30.0, "mass_per_length": 0.5}
    links = [
        fa.Link(length=0.8, hub_radius=0.1, **beam),
        fa.Link(length=0.6, hub_radius=0.2, **beam),
    ]
    flexible = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2)
    chain = rigid_chain(flexible, 6)
    assert chain.arm.tip(np.zeros(chain.arm.dof))[0] == pytest.approx(1.7)
    static = [row.error for row in chain.comparisons[:2]]
    assert np.abs(static).max() < 1e-12  # the quadrature of the flexibility is exact
    assert abs(chain.comparisons[2].error) < 2e-3  # six springs on each link


def test_urdf_in_pinocchio(tmp_path):
    pin = pytest.importorskip("pinocchio", reason="Pinocchio is not installed: URDF was not read")
    model = pin.buildModelFromUrdf(str(fa.export_urdf(arm(), tmp_path / "arm.urdf")))
    chain = rigid_chain(arm(), 4)
    q, _ = state(chain)
    # Continuous joints have a cosine and a sine.
    angles = np.stack([np.cos(q), np.sin(q)], axis=1).ravel()
    M = pin.crba(model, model.createData(), angles)
    M = np.triu(M) + np.triu(M, 1).T
    np.testing.assert_allclose(M, chain.arm.mass_matrix(q), rtol=0, atol=1e-12 * np.abs(M).max())
