"""Arms with branches, sliding joints and bases that move: equal arms, closed forms, momentum.

Two arms on a fixed base do not act on each other: a tree of both gives the numbers of each alone.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.linalg import expm

import flexarm as fa


def _link(**changes):
    fields = {"length": 1.0, "flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    return fa.Link(**(fields | changes))


UPPER, FORE, OTHER = _link(), _link(length=0.8, segments=2), _link(length=0.9, hub_radius=0.1)
JOINTS = (
    fa.Joint(rotor_inertia=1e-4, gear_ratio=20.0, damping=0.1),
    fa.Joint(mass=0.2, housing_inertia=1e-3, stiffness=4.0),
    fa.Joint(hub_inertia=0.01, rotor_inertia=1e-3, gear_ratio=5.0, stiffness=30.0),
)
PAYLOAD = fa.Payload(mass=0.3, inertia=0.01, offset=(0.1, 0.05))
GRAVITY = (0.5, -9.81)


def _pair(theory="linear"):
    """Return a tree of two arms on one base, and both arms alone."""
    common = {"gravity": GRAVITY, "theory": theory}
    other = OTHER.replace(parent=0)
    tree = fa.Arm(links=[UPPER, FORE, other], joints=JOINTS, payload=PAYLOAD, **common)
    first = fa.Arm(links=[UPPER, FORE], joints=JOINTS[:2], **common)
    second = fa.Arm(links=[OTHER], joints=JOINTS[2:], payload=PAYLOAD, **common)
    return tree, first, second


def _state(arm, seed=0, modal=0.003):
    """Return random q, qd and joint torques of an arm."""
    rng = np.random.default_rng(seed)
    size = np.ones(arm.dof)
    for piece in arm.assembly.pieces:
        size[piece.modal] = modal / np.sqrt(1.0 + np.arange(piece.shapes.w2.size)) ** 3
    return (
        rng.normal(size=arm.dof) * size,
        rng.normal(size=arm.dof) * size,
        rng.normal(size=arm.n_joints),
    )


def _close(value, expected, within=1e-11):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=within * scale)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_two_arms_on_a_fixed_base_are_two_arms(theory):
    tree, first, second = _pair(theory)
    q, qd, torque = _state(tree)
    n, m = first.dof, first.n_joints
    parts = [(first, q[:n], qd[:n], torque[:m]), (second, q[n:], qd[n:], torque[m:])]
    loads = [fa.Load(link=2, force=(1.0, 2.0), station=0.5), fa.Load(link=3, force=(0.0, 1.0))]
    of_parts = [[loads[0]], [fa.Load(link=1, force=(0.0, 1.0))]]
    qdd = tree.forward_dynamics(q, qd, torque, loads=loads)
    alone = [a.forward_dynamics(*s, loads=f) for (a, *s), f in zip(parts, of_parts, strict=True)]
    _close(qdd, np.concatenate(alone))
    acting = {"loads": loads}
    for name, arguments in (("joint_reactions", {}), ("section_forces", {"stations": 5})):
        values = getattr(tree, name)(q, qd, qdd, **acting, **arguments)
        expected = [
            getattr(a, name)(s[0], s[1], x, loads=f, **arguments)
            for (a, *s), x, f in zip(parts, alone, of_parts, strict=True)
        ]
        _close(values, np.concatenate(expected))
    _close(tree.shape(q), np.concatenate([first.shape(q[:n]), second.shape(q[n:])]))
    _close(tree.tip_velocity(q, qd), second.tip_velocity(q[n:], qd[n:]))
    mass = tree.mass_matrix(q)
    assert not mass[:n, n:].any()
    _close(mass[:n, :n], first.mass_matrix(q[:n]))
    energies = tree.energy(q, qd), first.energy(q[:n], qd[:n]), second.energy(q[n:], qd[n:])
    _close(energies[0], np.add(energies[1], energies[2]))
    frequencies = np.concatenate([fa.modes(a, q=s[0]).squared_frequency for a, *s in parts])
    _close(fa.modes(tree, q=q).squared_frequency, np.sort(frequencies), 1e-10)
    by_state = tree.derivatives(q, qd, torque)
    _close(by_state.q[:n, :n], first.derivatives(q[:n], qd[:n], torque[:m]).q)


def test_linear_models_of_two_arms_are_those_of_each():
    tree, first, _ = _pair()
    q, *_ = _state(tree, modal=0.0)
    n = first.dof
    whole, part = fa.linearize(tree, q=q), fa.linearize(first, q=q[:n])
    _close(whole.A[tree.dof : tree.dof + n, :n], part.A[n:, :n])
    _close(whole.B[tree.dof : tree.dof + n, : first.n_joints], part.B[n:, : first.n_joints])


def test_runs_of_two_arms_are_those_of_each():
    # A fixed step gives both the same steps, so that only rounding is left.
    tree, first, second = _pair()
    options = {"integrator": "rk4", "step": 2e-4, "rate": 200.0}
    wall = {"surface": fa.Wall(point=(0.0, -0.05), normal=(0.0, 1.0)), "stiffness": 500.0}
    run = fa.simulate(tree, 0.15, contacts=[fa.Contact(link=2, **wall)], stations=3, **options)
    alone = fa.simulate(first, 0.15, contacts=[fa.Contact(**wall)], stations=3, **options)
    other = fa.simulate(second, 0.15, **options)
    assert alone.contact_force.values.max() > 1.0
    for name in (
        "joint_angle",
        "link_rate",
        "link_tip_deflection",
        "bending_moment",
        "joint_force",
    ):
        _close(run[name].values[:, :2], alone[name].values, 1e-9)
    _close(run.contact_force.values, alone.contact_force.values, 1e-9)
    _close(run.tip.values, other.tip.values, 1e-9)
    _close(run.q.values[:, first.dof :], other.q.values, 1e-9)


def test_equilibria_of_two_arms_are_those_of_each():
    tree, first, second = _pair()
    angles = np.array([-1.3, 0.4, -1.0])
    state = fa.equilibrium(tree, angles)
    parts = fa.equilibrium(first, angles[:2]), fa.equilibrium(second, angles[2:])
    _close(state.torque, np.concatenate([part.torque for part in parts]), 1e-9)
    assert state.lowest_eigenvalue == pytest.approx(
        min(part.lowest_eigenvalue for part in parts), rel=1e-9
    )


def test_a_mounting_angle_shifts_the_joint_angle():
    mounted = [j.replace(mounting_angle=a) for j, a in zip(JOINTS[:2], (0.3, -0.7), strict=True)]
    springs = [JOINTS[0], JOINTS[1].replace(rest_angle=-0.7)]
    turned = fa.Arm(links=[UPPER, FORE], joints=mounted, payload=PAYLOAD, gravity=GRAVITY)
    plain = fa.Arm(links=[UPPER, FORE], joints=springs, payload=PAYLOAD, gravity=GRAVITY)
    q, qd, torque = _state(turned)
    shifted = q.copy()
    shifted[turned.joint_index] += 0.3, -0.7
    qdd = plain.forward_dynamics(shifted, qd, torque)
    _close(turned.forward_dynamics(q, qd, torque), qdd)
    _close(turned.section_forces(q, qd, qdd), plain.section_forces(shifted, qd, qdd))
    _close(turned.joint_reactions(q, qd, qdd), plain.joint_reactions(shifted, qd, qdd))
    _close(fa.modes(turned, q=q).squared_frequency, fa.modes(plain, q=shifted).squared_frequency)
    starts = {"integrator": "rk4", "step": 2e-4, "rate": 100.0}
    runs = [
        fa.simulate(arm, 0.1, initial=start, **starts)
        for arm, start in ((turned, turned.rest([0.0, 0.0])), (plain, plain.rest([0.3, -0.7])))
    ]
    _close(runs[0].tip.values, runs[1].tip.values)


def _on_rail(**changes):
    """Return an arm whose first joint is on a carriage that slides along x."""
    carriage = _link(length=0.2, flexible=False)
    joints = [fa.Joint(kind="prismatic"), fa.Joint(), fa.Joint()]
    links = [carriage, UPPER.replace(parent_station=0.0), FORE]
    return fa.Arm(links=links, joints=joints, payload=PAYLOAD, gravity=GRAVITY, **changes)


def test_a_prescribed_slide_is_an_acceleration_of_the_base():
    rail = _on_rail()
    fixed = fa.Arm(links=[UPPER, FORE], payload=PAYLOAD, gravity=GRAVITY)
    size, rate = 0.05, 15.0
    moved = fa.PrescribedAngle(
        lambda t: size * (1.0 - np.cos(rate * t)),
        lambda t: size * rate * np.sin(rate * t),
        lambda t: size * rate**2 * np.cos(rate * t),
    )
    options = {"rtol": 1e-9, "rate": 100.0}
    run = fa.simulate(rail, 0.3, prescribed={1: moved}, **options)
    still = fa.simulate(
        fixed, 0.3, base_acceleration=lambda t: (size * rate**2 * np.cos(rate * t), 0.0), **options
    )
    # The tolerance of both runs decides: 1e-9 of the reach in each step.
    _close(run.joint_angle.values[:, 1:], still.joint_angle.values, 1e-6)
    _close(run.joint_force.values[:, 1:], still.joint_force.values, 1e-5)
    place = size * (1.0 - np.cos(rate * run.time.values))
    _close(run.tip.values[:, 0] - place, still.tip.values[:, 0], 1e-6)
    assert run.joint_angle.attrs["units"] == "rad or m"
    assert run.torque.attrs["units"] == "N m or N"


def test_a_rigid_cart_with_a_pendulum_has_the_accelerations_of_the_closed_form():
    cart, rod, length, gravity = 2.0, 0.5, 1.0, 9.81
    arm = fa.Arm(
        base=fa.Base(mass=cart, free=("x",)),
        links=[_link(flexible=False)],
        gravity=(0.0, -gravity),
    )
    (x, angle), (v, rate) = (0.3, 0.7), (0.5, -2.0)
    torque, half, inertia = 1.3, 0.5 * length, rod * length**2 / 3.0
    mass = [
        [cart + rod, -rod * half * np.sin(angle)],
        [-rod * half * np.sin(angle), inertia],
    ]
    force = [
        rod * half * np.cos(angle) * rate**2,
        torque - rod * gravity * half * np.cos(angle),
    ]
    qdd = arm.forward_dynamics([x, angle], [v, rate], [torque])
    np.testing.assert_allclose(qdd, np.linalg.solve(mass, force), rtol=1e-13)
    np.testing.assert_allclose(arm.mass_matrix([x, angle]), mass, rtol=1e-13)
    # The force of the joint on the rod is the mass of the rod times its acceleration less gravity.
    centre = qdd[0] - half * (np.sin(angle) * qdd[1] + np.cos(angle) * rate**2)
    reaction = arm.joint_reactions([x, angle], [v, rate], qdd)[0]
    assert reaction[0] == pytest.approx(rod * centre, rel=1e-12)
    assert reaction[2] == pytest.approx(torque, rel=1e-12)


def _flyer(**changes):
    base = fa.Base(mass=5.0, inertia=0.8, centre=(0.1, -0.05), free=("x", "y", "angle"))
    joints = [
        fa.Joint(offset=(0.4, 0.1), rotor_inertia=2e-4, gear_ratio=30.0),
        fa.Joint(),
        fa.Joint(offset=(-0.4, 0.2), mounting_angle=2.5),
    ]
    links = [UPPER, _link(length=0.8), _link(length=0.9, parent=0)]
    return fa.Arm(
        **({"base": base, "links": links, "joints": joints, "payload": PAYLOAD} | changes)
    )


def _momentum(arm, q, qd):
    """Return linear momentum (2,) and angular momentum about the origin of the world."""
    px, py, about = (arm.mass_matrix(q) @ qd)[:3]
    return np.array([px, py, about + q[0] * py - q[1] * px])


def test_a_free_flyer_keeps_its_momentum():
    arm = _flyer()
    rate = arm.rest([0.5, -0.3, 0.2], base=[0.1, -0.2, 0.3])
    run = fa.simulate(
        arm,
        1.0,
        initial=arm.rest([0.3, 0.4, -0.5], base=[1.0, 2.0, 0.5]),
        initial_rate=rate,
        torque=lambda t: np.array([0.4, -0.2, 0.3]) * np.sin(6.0 * t),
        rate=100.0,
    )
    q, qd = run.q.values, run.qd.values
    momenta = np.array([_momentum(arm, *state) for state in zip(q, qd, strict=True)])
    # Only the errors of steps, 1e-7 of the reach, change the momentum.
    _close(momenta, np.broadcast_to(momenta[0], momenta.shape), 1e-5)
    assert np.ptp(run.base_position.values[:, 2]) > 0.05  # the torques turn the base
    assert list(run.coordinate.values[:4]) == ["base_x", "base_y", "base_angle", "joint_1"]
    np.testing.assert_array_equal(run.base_position.values, q[:, :3])
    np.testing.assert_array_equal(run.base_velocity.values, qd[:, :3])


def test_locked_joints_and_stiff_links_make_the_flyer_one_body():
    arm = _flyer(payload=fa.Payload()).rigid()
    q = arm.rest([0.3, 0.4, -0.5], base=[1.0, 2.0, 0.5])
    mass = arm.mass_matrix(q)
    total = 5.0 + 0.5 * (1.0 + 0.8 + 0.9)
    np.testing.assert_allclose(mass[:2, :2], total * np.eye(2), rtol=1e-13)
    still = np.zeros(arm.dof)
    # Gravity is felt by the whole mass, wherever it is.
    heavy = _flyer(payload=fa.Payload(), gravity=(0.0, -2.0)).rigid()
    force = heavy.inverse_dynamics(q, still, still)
    np.testing.assert_allclose(force[:2], [0.0, 2.0 * total], rtol=0.0, atol=1e-12 * total)
    np.testing.assert_allclose(
        heavy.forward_dynamics(q, still, [0.0] * 3)[:3], [0.0, -2.0, 0.0], atol=1e-12
    )


def _gantry(**changes):
    links = [
        _link(length=0.4, flexible=False, mass_per_length=2.0),
        _link(length=0.3, flexible=False),
        _link(length=0.8),
    ]
    joints = [
        fa.Joint(kind="prismatic"),
        fa.Joint(kind="prismatic", axis=(0.0, 1.0)),
        fa.Joint(fixed=True, mounting_angle=-0.5 * np.pi),
    ]
    return fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.3), **changes)


def test_a_gantry_is_a_double_integrator_with_a_beam():
    arm = _gantry()
    total, moved = 0.8 + 0.15 + 0.4 + 0.3, 0.15 + 0.4 + 0.3
    rigid = arm.rigid()
    np.testing.assert_allclose(
        rigid.forward_dynamics([0.2, 0.1], [1.0, 2.0], [3.0, 4.0]),
        [3.0 / total, 4.0 / moved],
        rtol=1e-12,
    )
    # The hanging beam with both slides locked is a clamped beam with a mass at its tip.
    beam = fa.Arm(links=[_link(length=0.8)], payload=fa.Payload(mass=0.3))
    _close(fa.modes(arm).squared_frequency, fa.modes(beam).squared_frequency, 1e-10)
    # A force at the first slide moves the centre of mass of all, however the beam bends.
    run = fa.simulate(arm, 0.2, torque=lambda t: [1.0, 0.0], rate=100.0, rtol=1e-9)
    momentum = [
        (arm.mass_matrix(q) @ qd)[0] for q, qd in zip(run.q.values, run.qd.values, strict=True)
    ]
    np.testing.assert_allclose(momentum, run.time.values, rtol=0.0, atol=1e-8)
    assert run.joint_angle.attrs["units"] == "m"
    assert run.torque.attrs["units"] == "N"


def test_a_controller_moves_the_slides_of_a_gantry():
    arm = _gantry()
    motion = fa.joint_motion(arm, [0.0, 0.0], [20.0, 0.5], 4.0)  # 20 m are not degrees
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law = fa.JointPD(200.0, 40.0)
        run = fa.simulate(arm, 5.0, controller=law, reference=motion, rate=50.0)
    np.testing.assert_allclose(run.joint_angle.values[-1], [20.0, 0.5], atol=0.05)
    np.testing.assert_allclose(motion.tip(4.0), arm.tip(arm.rest([20.0, 0.5]))[:2], rtol=1e-12)


def test_a_branch_at_a_station_acts_like_its_joint_forces():
    stem = _link(flexible=False)
    branch = _link(length=0.6, parent=1, parent_station=0.4)
    joints = [fa.Joint(), fa.Joint(offset=(0.05, -0.08), mounting_angle=0.6)]
    tree = fa.Arm(links=[stem, branch], joints=joints, gravity=GRAVITY)
    alone = fa.Arm(links=[stem], gravity=GRAVITY)
    q, qd, torque = _state(tree)
    qdd = tree.forward_dynamics(q, qd, torque)
    fx, fy, moment = -tree.joint_reactions(q, qd, qdd)[1]
    x, y = tree.shape(q, 2)[1, 0] - 0.4 * np.array([np.cos(q[0]), np.sin(q[0])])
    load = fa.Load(link=1, force=(fx, fy), moment=moment + x * fy - y * fx, station=0.4)
    rigid = slice(0, 1)
    forces = alone.inverse_dynamics(q[rigid], qd[rigid], qdd[rigid], loads=[load])
    np.testing.assert_allclose(forces, torque[:1], rtol=1e-10)
    sections = alone.section_forces(q[rigid], qd[rigid], qdd[rigid], 6, loads=[load])
    _close(tree.section_forces(q, qd, qdd, 6)[0], sections[0])


def test_a_branch_at_the_root_loads_the_joint_and_not_the_link():
    links = [UPPER, _link(length=0.6, parent=1, parent_station=0.0)]
    joints = [fa.Joint(), fa.Joint(fixed=True, rest_angle=2.0)]
    tree = fa.Arm(links=links, joints=joints, gravity=GRAVITY)
    q, qd, torque = _state(tree)
    qdd = tree.forward_dynamics(q, qd, torque)
    whole, branch = tree.joint_reactions(q, qd, qdd)
    assert whole[2] == pytest.approx(torque[0], rel=1e-9)
    axial, across, moment = -tree.section_forces(q, qd, qdd)[0, 0]
    cosine, sine = np.cos(q[0]), np.sin(q[0])
    stem = [cosine * axial - sine * across, sine * axial + cosine * across, moment]
    _close(whole, branch + stem)


def test_batches_of_mechanisms_equal_single_runs():
    arms = [_flyer(), _flyer(payload=fa.Payload(mass=0.5, offset=(0.1, 0.0)))]
    starts = np.stack([arms[0].rest([0.3, 0.4, k], base=[0.0, 0.0, 0.1 * k]) for k in range(4)])
    channels = "joint_angle", "base_position", "tip"
    batch = fa.simulate_batch(
        [arms[k % 2] for k in range(4)], 0.1, initial=starts, rate=50.0, channels=channels
    )
    for k in range(4):
        run = fa.simulate(arms[k % 2], 0.1, initial=starts[k], rate=50.0)
        for name in channels:
            np.testing.assert_array_equal(batch[name].values[k], run[name].values)


def test_arms_of_one_size_with_other_trees_share_a_batch():
    # Equal numbers of bodies and modes, but other parents and slides.
    links = [UPPER, _link(), _link()]
    chain = fa.Arm(links=links, gravity=GRAVITY)
    fork = fa.Arm(links=[*links[:2], links[2].replace(parent=1)], gravity=GRAVITY)
    slide = fa.Arm(
        links=links, joints=[fa.Joint(), fa.Joint(kind="prismatic"), fa.Joint()], gravity=GRAVITY
    )
    arms = [chain, fork, slide, fork]
    batch = fa.simulate_batch(arms, 0.1, rate=50.0)
    for k, arm in enumerate(arms):
        run = fa.simulate(arm, 0.1, rate=50.0)
        np.testing.assert_array_equal(batch.tip.values[k], run.tip.values)


def test_derivatives_of_a_run_of_a_flyer_are_those_of_differences():
    path, step = "links[0].flexural_rigidity", 1e-3
    options = {"initial": _flyer().rest([0.3, 0.4, -0.5]), "rtol": 1e-10, "rate": 20.0}
    options["initial_rate"] = _flyer().rest([1.0, -2.0, 1.0])
    exact = fa.sensitivities(_flyer(), 0.2, [path], **options)
    runs = [
        fa.simulate(
            _flyer(
                links=[UPPER.replace(flexural_rigidity=20.0 + k * step), *_flyer().spec.links[1:]]
            ),
            0.2,
            **options,
        )
        for k in (-1.0, 1.0)
    ]
    difference = (runs[1].tip.values - runs[0].tip.values) / (2.0 * step)
    name = next(
        n for n in exact.data_vars if (n.startswith("tip") and n.endswith("tip")) or n == "d_tip"
    )
    _close(exact[name].values.reshape(difference.shape), difference, 1e-4)


def test_equilibria_with_a_base_that_moves():
    spring = fa.Base(
        mass=2.0, inertia=0.1, free=("x", "y", "angle"), stiffness=(300.0, 200.0, 500.0)
    )
    arm = fa.Arm(base=spring, links=[UPPER], gravity=(0.0, -9.81))
    state = fa.equilibrium(arm, [-0.5 * np.pi])
    assert state.stable
    assert state.q[1] == pytest.approx(-2.5 * 9.81 / 200.0, rel=1e-9)
    # Nothing holds a cart along its rail, and nothing pushes it.
    cart = fa.Arm(base=fa.Base(mass=2.0, free=("x",)), links=[UPPER], gravity=(0.0, -9.81))
    state = fa.equilibrium(cart, torque=[0.0])
    assert state.q[0] == 0.0
    assert np.cos(state.q[1]) == pytest.approx(0.0, abs=1e-9)
    free = fa.Arm(base=fa.Base(mass=2.0, free=("x", "y")), links=[UPPER], gravity=(0.0, -9.81))
    with pytest.raises(fa.EquilibriumError, match="no spring holds y of the base"):
        fa.equilibrium(free, [-0.5 * np.pi])


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.0, 1.0), (0.6, 0.8)])
@pytest.mark.parametrize("integrator", ["auto", "rk4"])
def test_a_slide_with_a_spring_behind_its_motor_is_two_masses(axis, integrator):
    # Behind the spring, the motor alone has inertia: rotor_inertia gear_ratio^2 = 0.4 kg.
    stiffness, damping, force, motor, load = 80.0, 4.0, 5.0, 0.4, 0.48
    slide = fa.Joint(
        kind="prismatic", axis=axis, stiffness=stiffness, damping=damping,
        rotor_inertia=1e-5, gear_ratio=200.0,
    )  # fmt: skip
    link = fa.Link(length=0.8, mass_per_length=load / 0.8, flexible=False)
    run = fa.simulate(
        fa.Arm(links=[link], joints=[slide]), 0.5, initial=[0.1, 0.02], torque=lambda _: [force],
        integrator=integrator, progress=False,
    )  # fmt: skip
    spring = np.array([[0.0, 0.0], [0.0, 1.0]])  # the second coordinate is the spring's
    mass = np.array([[motor + load, load], [load, load]])
    matrix = np.zeros((5, 5))  # of q, qd and one
    matrix[:2, 2:4] = np.eye(2)
    matrix[2:4, :2] = -np.linalg.solve(mass, stiffness * spring)
    matrix[2:4, 2:4] = -np.linalg.solve(mass, damping * spring)
    matrix[2:4, 4] = np.linalg.solve(mass, [force, 0.0])
    exact = expm(0.5 * matrix) @ [0.1, 0.02, 0.0, 0.0, 1.0]
    # A hundred thousandth of the motion is the default accuracy.
    np.testing.assert_allclose(run["q"].values[-1], exact[:2], atol=1e-5)
