"""Motions of the bent arm that presses on a surface: its tip position and its torques."""

import numpy as np
import pytest

import flexarm as fa

ROD = {"mass_per_length": 0.6, "flexural_rigidity": 105.0, "elements": 1}


def arm_of(**more):
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2, **more)


ARM = arm_of()
LINE = fa.line_motion(ARM, (1.5, 0.5), (1.5, 0.8), 2.0)


def wave(t):
    return 5.0 + 2.0 * np.sin(2.0 * t)


@pytest.mark.sampled("arm0")
@pytest.mark.parametrize("arm", [ARM, arm_of(gravity=(0.0, -9.81), payload=fa.Payload(mass=0.1))])
def test_bent_arm_is_on_the_path_in_static_balance(arm):
    found = fa.pressed_motion(arm, LINE, wave, (-2.0, 0.0), interval=0.25)
    for t in np.linspace(0.0, 2.0, 9):
        rest = fa.equilibrium(arm, found.joint_angle(t), tip_force=(-wave(t), 0.0))
        # Tolerance of the search for the path, and rounding of splines.
        np.testing.assert_allclose(arm.tip(rest.q)[:2], LINE.tip(t), atol=2e-9)
        np.testing.assert_allclose(found.holding_torque(t), rest.torque, atol=1e-7)
        rigid = arm.rigid()
        rigid_torque = rigid.inverse_dynamics(found.joint_angle(t), np.zeros(2), np.zeros(2))
        np.testing.assert_allclose(found.pressing_torque(t), rest.torque - rigid_torque, atol=1e-7)
    np.testing.assert_allclose(arm.tip(found.initial)[:2], LINE.tip(0.0), atol=2e-9)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # that is the case
def test_arm_with_large_bending_reaches_its_path():
    """The Jacobian of the rigid arm alone does not converge within the allowed corrections."""
    soft = {**ROD, "flexural_rigidity": 8.0}
    arm = fa.Arm(links=[fa.Link(length=1.4, **soft), fa.Link(length=1.0, **soft)])
    line = fa.line_motion(arm, (1.5, 0.5), (1.5, 0.8), 2.0)
    found = fa.pressed_motion(arm, line, 4.0, (-1.0, 0.0), interval=1.0)
    for t in (0.0, 2.0):
        rest = fa.equilibrium(arm, found.joint_angle(t), tip_force=(-4.0, 0.0))
        np.testing.assert_allclose(arm.tip(rest.q)[:2], line.tip(t), atol=1e-7)


@pytest.mark.thorough
def test_values_between_samples_are_as_accurate_as_their_splines():
    found = fa.pressed_motion(ARM, LINE, wave, (-1.0, 0.0), interval=0.05)
    off = []
    for t in (0.475, 0.925, 1.525):
        rest = fa.equilibrium(ARM, found.joint_angle(t), tip_force=(-wave(t), 0.0))
        off.append(np.hypot(*(ARM.tip(rest.q)[:2] - LINE.tip(t))))
    assert max(off) < 1e-6
    # The rates are derivatives of the angles.
    step = 1e-4
    for t in (0.5, 1.2):
        ahead, behind = found.joint_angle(t + step), found.joint_angle(t - step)
        rate = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(found.joint_rate(t), rate, atol=1e-6)
        change = (found.joint_rate(t + step) - found.joint_rate(t - step)) / (2 * step)
        np.testing.assert_allclose(found.joint_acceleration(t), change, atol=1e-5)


def test_rigid_arm_presses_with_the_transposed_jacobian():
    rigid = fa.Arm(
        links=[fa.Link(length=length, mass_per_length=0.6, flexible=False) for length in (1.4, 1.0)]
    )
    line = fa.line_motion(rigid, (1.5, 0.5), (1.5, 0.8), 2.0)
    found = fa.pressed_motion(rigid, line, 4.0, (-1.0, 0.0))
    t = 2.0
    a, b = np.cumsum(found.joint_angle(t))
    lever = np.array([1.4 * np.sin(a) + np.sin(b), np.sin(b)])  # -d x / d angle
    np.testing.assert_allclose(found.joint_angle(t), line.joint_angle(t), atol=1e-9)
    # The wall acts on the tip with -4 N along x, so the motors need 4 N times these levers.
    np.testing.assert_allclose(found.holding_torque(t), -4.0 * lever, atol=1e-8)


@pytest.mark.thorough
def test_friction_opposes_the_motion():
    smooth = fa.pressed_motion(ARM, LINE, 5.0, (-1.0, 0.0))
    rubbing = fa.pressed_motion(ARM, LINE, 5.0, (-1.0, 0.0), friction=0.3)
    t = 1.0
    rest = fa.equilibrium(ARM, rubbing.joint_angle(t), tip_force=(-5.0, -1.5))
    # Friction has its full size except for tanh at the fastest sliding: 1 - tanh(5).
    np.testing.assert_allclose(rubbing.holding_torque(t), rest.torque, atol=1e-3)
    assert abs(rubbing.holding_torque(t) - smooth.holding_torque(t)).max() > 1.0
    np.testing.assert_allclose(rubbing.holding_torque(0.0), smooth.holding_torque(0.0), atol=1e-6)


@pytest.mark.thorough
def test_values_for_many_times_and_after_the_end():
    found = fa.pressed_motion(ARM, LINE, wave, (-1.0, 0.0), duration=2.5)
    times = np.array([-1.0, 0.0, 0.7, 2.5, 9.0])
    for name, shape in {
        "joint_angle": (2,),
        "joint_rate": (2,),
        "joint_acceleration": (2,),
        "holding_torque": (2,),
        "pressing_torque": (2,),
        "contact_force": (),
        "normal": (2,),
        "tip": (2,),
    }.items():
        ask = getattr(found, name)
        many = ask(times)
        assert many.shape == (5, *shape)
        # Sums over many times at once have another order.
        np.testing.assert_allclose(many, [ask(float(t)) for t in times], rtol=1e-14, atol=1e-15)
    assert found.contact_force(9.0) == wave(2.5)
    np.testing.assert_array_equal(found.joint_rate(9.0), [0.0, 0.0])
    assert repr(found) == "<flexarm.PressedMotion: 2 joints, up to 2.5 s>"


def test_the_tip_may_approach_without_force():
    down = fa.line_motion(ARM, (1.2, 0.5), (1.5, 0.5), 1.0)

    def after(start):
        return lambda t: 8.0 * max(t - start, 0.0) ** 3

    found = fa.pressed_motion(ARM, down, after(0.9), (-1.0, 0.0), duration=1.5, interval=0.25)
    assert found.contact_force(1.5) > 0.0
    with pytest.raises(fa.InputError, match=r"^pressed_motion: normal is the direction of \d+% of"):
        fa.pressed_motion(ARM, down, after(0.1), (-1.0, 0.0), duration=1.5)


@pytest.mark.thorough
def test_normal_may_turn():
    def turning(t):
        return (-1.0, 0.1 * t)

    found = fa.pressed_motion(ARM, LINE, 5.0, turning)
    t = 2.0
    outward = np.array(turning(t)) / np.hypot(*turning(t))
    np.testing.assert_allclose(found.normal(t), outward)
    rest = fa.equilibrium(ARM, found.joint_angle(t), tip_force=5.0 * outward)
    np.testing.assert_allclose(found.holding_torque(t), rest.torque, atol=1e-7)


@pytest.mark.thorough_cases("change11-reach the path", "equilibrium")
@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"force": -1.0}, "force"),
        ({"force": np.nan}, "force"),
        ({"force": lambda t: 1.0 - t}, "force at t"),
        ({"normal": (0.0, 0.0)}, "normal"),
        ({"normal": (1.0, 0.0, 0.0)}, "normal"),
        ({"normal": lambda t: (0.0, 0.0)}, "normal at t"),
        ({"normal": (0.0, 1.0)}, "normal is the direction of 100% of the path"),
        ({"friction": -0.1}, "friction"),
        ({"interval": 0.0}, "interval"),
        ({"duration": -1.0}, "duration"),
        ({"motion": "a line"}, "motion"),
        ({"force": 1e4}, "reach the path|equilibrium"),
        ({"force": lambda t: 1.0 / 0.0}, "the force failed with ZeroDivisionError"),
        ({"normal": lambda: (0.0, 1.0)}, "the normal failed with TypeError"),
    ],
)
def test_wrong_arguments_are_rejected(change, word):
    given = {"motion": LINE, "force": 5.0, "normal": (-1.0, 0.0), **change}
    motion, force, normal = given.pop("motion"), given.pop("force"), given.pop("normal")
    with pytest.raises(fa.FlexarmError, match=word):
        fa.pressed_motion(ARM, motion, force, normal, **given)
