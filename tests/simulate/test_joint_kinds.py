"""Fixed joints, geared rotors and elastic joints, against closed forms."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.results import columns
from flexarm.view.plot.histories import signals_figure

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
LENGTH, INERTIA = 0.8, 0.5 * 0.8**3 / 3  # of a rigid bar of 0.5 kg/m about its end
ROTOR, GEAR, SPRING = 2e-5, 80.0, 300.0


def bar(**joint):
    link = fa.Link(length=LENGTH, mass_per_length=0.5, flexible=False)
    return fa.Arm(links=[link], joints=[fa.Joint(**joint)])


def test_rotor_inertia_is_multiplied_by_the_square_of_the_gear_ratio():
    arm = bar(rotor_inertia=ROTOR, gear_ratio=GEAR)
    acceleration = arm.forward_dynamics([0.3], [1.0], [2.0])
    assert acceleration[0] == pytest.approx(2.0 / (INERTIA + GEAR**2 * ROTOR), rel=1e-13)


def test_rotor_on_a_moving_link():
    """The second joint is locked without a torque: the reaction of its rotor acts on the first."""
    bars = [fa.Link(length=LENGTH, mass_per_length=0.5, flexible=False)] * 2
    joints = [fa.Joint(), fa.Joint(rotor_inertia=ROTOR, gear_ratio=GEAR)]
    arm = fa.Arm(links=bars, joints=joints)
    M, bare = arm.mass_matrix([0.1, 0.4]), fa.Arm(links=bars).mass_matrix([0.1, 0.4])
    expected = ROTOR * np.array([[1.0, GEAR], [GEAR, GEAR**2]])
    np.testing.assert_allclose(M - bare, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("joints", "inverse_inertia"),
    [("locked", 1 / INERTIA), ("free", 1 / INERTIA + 1 / (GEAR**2 * ROTOR))],
)
def test_frequency_of_an_elastic_joint(joints, inverse_inertia):
    arm = bar(rotor_inertia=ROTOR, gear_ratio=GEAR, stiffness=SPRING)
    assert (arm.dof, arm.n_joints) == (2, 1)
    found = fa.modes(arm, joints=joints).frequency_hz[-1]
    assert found == pytest.approx(np.sqrt(SPRING * inverse_inertia) / (2 * np.pi), rel=1e-12)


def test_elastic_joint_equals_two_inertias_on_a_spring():
    """The torque acts for a while: motor and link against the exact solution of two masses."""
    arm = bar(rotor_inertia=ROTOR, gear_ratio=GEAR, stiffness=SPRING)
    motor = GEAR**2 * ROTOR
    result = fa.simulate(arm, 0.3, torque=lambda t: [3.0], rtol=1e-10, atol=1e-12)
    t = result.time.values
    omega = np.sqrt(SPRING * (1 / INERTIA + 1 / motor))
    twist = -(3.0 / motor) / omega**2 * (1 - np.cos(omega * t))  # the link lags behind
    both = 3.0 / (motor + INERTIA) * t**2 / 2  # mean, weighted with the inertias
    angle = both - INERTIA / (motor + INERTIA) * twist
    np.testing.assert_allclose(result.joint_twist.values[:, 0], twist, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.joint_angle.values[:, 0], angle, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.link_angle.values[:, 0], angle + twist, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.joint_moment.values[:, 0], -SPRING * twist, rtol=0, atol=1e-6)


def test_stiff_joint_approaches_a_rigid_one():
    """Errors are proportional to the compliance."""
    links = [fa.Link(length=1.0, elements=2, **ROD), fa.Link(length=0.7, elements=1, **ROD)]
    geared = {"rotor_inertia": ROTOR, "gear_ratio": GEAR}
    rigid = fa.modes(fa.Arm(links=links, joints=[fa.Joint(**geared)] * 2), [0.2, 0.9], "free")
    gaps = []
    for stiffness in (1e5, 1e6, 1e7):
        joint = fa.Joint(stiffness=stiffness, **geared)
        found = fa.modes(fa.Arm(links=links, joints=[joint] * 2), [0.2, 0.9], "free")
        gaps.append(rigid.frequency_hz[2] / found.frequency_hz[2] - 1.0)
    assert gaps[0] > 0.0
    np.testing.assert_allclose(np.divide(gaps[:-1], gaps[1:]), 10.0, rtol=0.1)


def test_rigid_model_has_stiff_gears():
    arm = bar(rotor_inertia=ROTOR, gear_ratio=GEAR, stiffness=SPRING, damping=0.1)
    rigid_counterpart = arm.rigid()
    assert (rigid_counterpart.dof, rigid_counterpart.n_joints) == (1, 1)
    assert rigid_counterpart.mass_matrix([0.0])[0, 0] == pytest.approx(
        INERTIA + GEAR**2 * ROTOR, rel=1e-13
    )


def test_prescribed_motor_drives_the_link_through_its_spring():
    arm = bar(rotor_inertia=ROTOR, gear_ratio=GEAR, stiffness=SPRING)
    natural, slow = np.sqrt(SPRING / INERTIA), 10.0
    motor = fa.PrescribedAngle(
        lambda t: 0.1 * (1 - np.cos(slow * t)),
        lambda t: 0.1 * slow * np.sin(slow * t),
        lambda t: 0.1 * slow**2 * np.cos(slow * t),
    )
    result = fa.simulate(arm, 0.5, prescribed={1: motor}, rtol=1e-10, atol=1e-12)
    t = result.time.values
    # The link obeys x'' + n^2 x = n^2 motor: the steady response minus the natural vibration.
    gain = natural**2 / (natural**2 - slow**2)
    link = 0.1 * (1 - gain * np.cos(slow * t) + (gain - 1) * np.cos(natural * t))
    np.testing.assert_allclose(result.link_angle.values[:, 0], link, rtol=0, atol=1e-8)
    requested = 0.1 * slow**2 * np.cos(slow * t)
    torque = GEAR**2 * ROTOR * requested - SPRING * result.joint_twist.values[:, 0]
    np.testing.assert_allclose(result.torque.values[:, 0], torque, rtol=0, atol=1e-6)


def knee(**fixed):
    """Return three links, the middle joint rigid at an angle."""
    links = [
        fa.Link(length=1.0, elements=2, **ROD),
        fa.Link(length=0.6, elements=2, **ROD),
        fa.Link(length=0.5, elements=1, **ROD),
    ]
    joint = fa.Joint(fixed=True, rest_angle=0.7, mass=0.3, hub_inertia=0.01) if fixed else None
    return links, joint


@pytest.mark.sampled("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_fixed_joint_equals_a_prescribed_constant_angle(theory):
    links, joint = knee(fixed=True)
    arm = fa.Arm(links=links, joints=[fa.Joint(), joint, fa.Joint()], theory=theory)
    assert (arm.n_links, arm.n_joints, arm.joint_numbers.tolist()) == (3, 2, [1, 3])
    turning = joint.replace(fixed=False, rest_angle=0.0)
    free = fa.Arm(links=links, joints=[fa.Joint(), turning, fa.Joint()], theory=theory)
    hold = fa.PrescribedAngle(lambda t: 0.7, lambda t: 0.0, lambda t: 0.0)
    run = {"rtol": 1e-10, "atol": 1e-12, "rate": 100.0}
    found = fa.simulate(arm, 0.5, torque=lambda t: [2.0 - 4 * t, 0.3], **run)
    held = fa.simulate(
        free, 0.5, torque=lambda t: [2.0 - 4 * t, 0.0, 0.3], prescribed={2: hold}, **run
    )
    for name in ("tip", "link_tip_deflection", "link_angle", "joint_force", "kinetic_energy"):
        np.testing.assert_allclose(found[name], held[name], rtol=0, atol=2e-7, err_msg=name)
    np.testing.assert_allclose(
        found.joint_moment.sel(link=2), held.torque.sel(joint=2), rtol=0, atol=1e-6
    )
    assert found.joint.values.tolist() == [1, 3]
    assert found.coordinate.values[0] == "joint_1"
    assert "joint_2" not in found.coordinate.values


def test_clamped_beam_has_no_joint_coordinates():
    """Simulation, equilibrium and modes work without a motor."""
    beam = fa.Link(length=1.0, elements=8, **ROD)
    arm = fa.Arm(links=[beam], joints=[fa.Joint(fixed=True, rest_angle=0.5)])
    assert (arm.n_joints, arm.dof) == (0, 16)
    exact = 3.5160152685 * np.sqrt(105.0 / 0.61732) / (2 * np.pi)
    # A mesh of 8 elements: (beta h)^4 / 1440 = 2.1e-6.
    assert fa.modes(arm).frequency_hz[0] == pytest.approx(exact, rel=3e-6)
    bent = fa.equilibrium(arm, loads=[fa.Load(1, force=(0.0, 2.0), frame="link")])
    assert arm.nodal(bent.q)[0][-1, 0] == pytest.approx(2.0 / (3 * 105.0), rel=1e-9)
    result = fa.simulate(arm, 1.0, initial=bent.q, rtol=1e-9, atol=1e-12)
    assert result.torque.shape == (1001, 0)
    total = result.kinetic_energy + result.strain_energy
    # The method damps the release's excitation of modes that it barely resolves.
    np.testing.assert_allclose(total, total[0], rtol=1e-5)
    np.testing.assert_allclose(arm.tip(arm.rest([])), [np.cos(0.5), np.sin(0.5), 0.5], rtol=1e-15)


def test_motions_include_rigidly_joined_links():
    links, joint = knee(fixed=True)
    base = fa.Joint(fixed=True, rest_angle=1.1)
    arm = fa.Arm(links=[links[1], *links], joints=[base, fa.Joint(), joint, fa.Joint()])
    start = arm.tip(arm.rest([0.3, -1.8]))[:2]
    end = start + np.array([0.1, 0.1])
    motion = fa.line_motion(arm, start, end, 1.0)
    for t in (0.0, 0.3, 1.0):
        on_line = arm.tip(arm.rest(motion.joint_angle(t)))[:2]
        np.testing.assert_allclose(on_line, motion.tip(t), rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.tip(1.0), end, rtol=0, atol=1e-12)
    turning = fa.joint_motion(arm, [0.0, 0.0], [0.5, 1.0], 1.0)
    at_end = arm.tip(arm.rest([0.5, 1.0]))[:2]
    np.testing.assert_allclose(turning.tip(1.0), at_end, rtol=0, atol=1e-14)


SCENARIO = """\
flexarm: 1
arm:
  links:
    - {length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.6}
    - {length: 0.6, flexural_rigidity: 105.0, mass_per_length: 0.6}
    - {length: 0.5, flexural_rigidity: 105.0, mass_per_length: 0.6}
  joints:
    - {rotor_inertia: 1.0e-4, gear_ratio: 50, stiffness: 500}
    - {fixed: true, rest_angle: 0.7}
    - {}
motion: {kind: joint, start: [0.0, 0.2], end: [0.3, 0.5], duration: 2.0}
drive: {kind: rigid_inverse_dynamics}
run: {duration: 2.0, rate: 100}
"""


def test_scenario_counts_the_joints_that_turn(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(SCENARIO + "prescribed: [{kind: motion, joint: 3}]\n")
    result = fa.run_scenario(path)
    requested = [0.2, 0.5]
    ends = result.joint_angle.sel(joint=3).values[[0, -1]]
    np.testing.assert_allclose(ends, requested, rtol=0, atol=1e-7)


def test_tables_and_plots_keep_the_numbers_of_joints(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(SCENARIO)
    result = fa.run_scenario(path)
    names = columns(result)
    assert "joint_angle_3 [rad]" in names
    assert "joint_angle_2 [rad]" not in names
    legends = [axes.get_legend() for axes in signals_figure(result).axes]
    stated = {text.get_text() for legend in legends if legend for text in legend.get_texts()}
    assert "joint 3" in stated
    assert "joint 2" not in stated


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("end: [0.3, 0.5]", "end: [0.3, 0.0, 0.5]", "motion.end must have length"),
        (
            "run:",
            "prescribed: [{kind: hold, joint: 2}]\nrun:",
            "must be the number of a joint that",
        ),
    ],
)
def test_scenario_rejects_values_for_fixed_joints(tmp_path, old, new, message):
    path = tmp_path / "arm.yaml"
    path.write_text(SCENARIO.replace(old, new))
    with pytest.raises(fa.ModelError, match=message):
        fa.run_scenario(path)
