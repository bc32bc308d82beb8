"""Joint references under which the tip of a flexible arm reaches its goal, and their tracking."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from arms import ROD, laboratory_arm
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import Scenario, load_scenario
from flexarm.model.checks import checked_arguments


def line(flexible, duration=1.0, profile="quintic"):
    start = 0.3 * duration
    return fa.line_motion(flexible, (2.0, 1.0), (1.0, 2.0), duration, profile, start_time=start)


@pytest.fixture(scope="module")
def inverse():
    return fa.tip_inversion(laboratory_arm(), line(laboratory_arm()))


def away(run, motion):
    return np.hypot(*(run.tip.values - motion.tip(run.time.values)).T)


@pytest.mark.thorough
def test_reference_of_the_inversion_is_its_joint_motion(inverse):
    run = fa.simulate(
        inverse.arm, inverse.end, torque=inverse.torque, initial=inverse.initial, rate=500.0
    )
    reference = inverse.reference
    t = run.time.values
    moving = t <= inverse.motion.end_time
    # A spline through samples of a run with smaller tolerance.
    np.testing.assert_allclose(
        run.joint_angle[moving], reference.joint_angle(t[moving]), rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(
        run.joint_rate[moving], reference.joint_rate(t[moving]), rtol=0, atol=1e-4
    )
    # After the motion the remaining bending is led to rest.
    np.testing.assert_allclose(run.joint_angle, reference.joint_angle(t), rtol=0, atol=1e-3)
    rigid = inverse.motion.joint_angle(t)
    assert abs(run.joint_angle.values - rigid).max() > 0.01  # different from the rigid joint angles
    np.testing.assert_array_equal(reference.tip(t), inverse.motion.tip(t))
    np.testing.assert_array_equal(reference.torque(0.7), inverse.torque(0.7))
    assert reference.start_time == inverse.start
    assert reference.end_time == pytest.approx(inverse.end)
    final = inverse.arm.joint_angles(inverse.final)
    np.testing.assert_allclose(reference.joint_angle(9.0), final, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_prescribed_joints_of_the_inversion_bring_the_tip_to_the_line(inverse):
    """Prescribed joints replace the torques: the tip follows its path."""
    moved = dict.fromkeys((1, 2), inverse.reference)
    run = fa.simulate(inverse.arm, 2.0, prescribed=moved, initial=inverse.initial, rate=500.0)
    missed = away(run, inverse.motion)
    assert missed[run.time.values <= inverse.motion.end_time].max() < 5e-5
    assert missed.max() < 1e-3  # undamped links vibrate by their remaining bending
    assert inverse.rigid_tip_error > 5e-3


@pytest.mark.thorough
def test_model_based_control_is_better_than_joint_pd_on_the_papers_line(inverse):
    """The tip error is 20 times smaller, the vibration a second after the end 50 times."""
    gains = {"proportional": [40.0, 10.0], "derivative": [20.0, 3.0]}
    plain = fa.JointPD(**gains)
    best = fa.ComputedTorque(inverse.arm, 1.0, feedforward=inverse.torque)
    errors, swings = [], []
    for controller, reference in ((plain, inverse.motion), (best, inverse.reference)):
        run = fa.simulate(inverse.arm, 4.0, controller=controller, reference=reference)
        t = run.time.values
        moving = (t >= inverse.motion.start_time) & (t <= inverse.motion.end_time)
        errors.append(np.sqrt(np.mean(away(run, inverse.motion)[moving] ** 2)))
        late = run.tip.values[t > 3.0]
        swings.append(np.hypot(*(late - late.mean(axis=0)).T).max())
    assert errors[1] < errors[0] / 20.0
    assert swings[1] < swings[0] / 50.0
    # The rest is the error of the zero-order hold: 1 ms is second order in time.
    assert errors[1] < 2e-4


@pytest.mark.thorough
def test_quasi_static_error_falls_with_the_fourth_power_of_speed():
    """(T_1 / T)^4 for a smooth motion, where rigid torques have the square; order 2 the sixth."""
    flexible = laboratory_arm()
    errors = {"rigid": [], "quasi-static": [], "order 2": []}
    close = {"integrator": "dormand_prince_8", "rtol": 1e-9}
    for duration in (4.0, 8.0):
        # The quintic's jerk jumps, and its excitation has the third power, so the motion is
        # smoothed.
        motion = fa.smoothed(line(flexible, 0.6 * duration), 0.4 * duration)
        static = fa.quasi_static_reference(flexible, motion)
        second = fa.quasi_static_reference(flexible, motion, order=2)
        for name, reference in zip(errors, (motion, static, second), strict=True):
            moved = dict.fromkeys((1, 2), reference)
            # The errors of order 2 are below those of a default run.
            run = fa.simulate(flexible, 1.3 * duration, prescribed=moved, rate=100.0, **close)
            errors[name].append(away(run, motion).max())
    order = {name: np.log2(before / after) for name, (before, after) in errors.items()}
    assert order["rigid"] == pytest.approx(2.0, abs=0.3)
    assert order["quasi-static"] == pytest.approx(4.0, abs=0.5)
    assert order["order 2"] > 5.5  # what is left are the jumps of high derivatives of the motion
    assert errors["order 2"][0] < errors["quasi-static"][0] / 20.0
    assert errors["order 2"][1] < errors["quasi-static"][1] / 80.0


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_order_2_warns_of_motions_that_are_too_fast_for_it():
    """In 0.6 s, two thirds of the slowest period, the tip error is larger than with order 1."""
    flexible = laboratory_arm()
    with pytest.warns(fa.AccuracyWarning, match="too fast for order 2"):
        fa.quasi_static_reference(flexible, line(flexible, 0.6), order=2)


def test_a_reference_of_a_reference_bends_by_the_outer_motion():
    """Its rates are those of its joints; the bent ones may be those of an arm with other modes."""
    flexible, other = laboratory_arm(), fa.Arm(links=[fa.Link(length=1.2, elements=1, **ROD)] * 2)
    inner = fa.quasi_static_reference(other, fa.joint_motion(other, [0.2, 0.5], [0.4, 0.7], 1.0))
    outer = fa.quasi_static_reference(flexible, inner)
    assert outer.coordinates(np.array([0.5]))[0].shape == (1, flexible.dof)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_quasi_static_end_is_the_equilibrium_with_the_tip_at_its_goal(theory):
    heavy = laboratory_arm(gravity=(0.0, -1.62), theory=theory)
    motion = line(heavy)
    static = fa.quasi_static_reference(heavy, motion)
    np.testing.assert_allclose(heavy.tip(static.initial)[:2], [2.0, 1.0], rtol=0, atol=1e-10)
    rest = fa.equilibrium(heavy, static.joint_angle(0.0))
    np.testing.assert_allclose(static.initial, rest.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(static.torque(0.0), rest.torque, rtol=0, atol=1e-9)
    last = static.coordinates(np.array([5.0]))[0][0]
    np.testing.assert_allclose(heavy.tip(last)[:2], [1.0, 2.0], rtol=0, atol=1e-10)


def heavy_arm(gravity=9.81):
    rod = {"flexural_rigidity": 900.0, "mass_per_length": 0.6, "elements": 2}
    damping = fa.ModalDamping(ratio=0.01)
    gauges = [fa.Gauge(station=0.02, distance=0.005)]
    links = [fa.Link(length=k, damping=damping, gauges=gauges, **rod) for k in (0.9, 0.7)]
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05, mass=0.5)]
    payload = fa.Payload(mass=0.4)
    return fa.Arm(links=links, joints=joints, payload=payload, gravity=(0.0, -gravity))


def test_order_0_bends_by_gravity_alone():
    """The arm at rest has its tip on the path at each instant, whatever the accelerations are."""
    arm = heavy_arm()
    motion = fa.joint_motion(arm, [0.2, 0.6], [0.8, 0.1], 0.3, start_time=0.2)
    static = fa.quasi_static_reference(arm, motion, order=0, smoothing=1e-4)
    for t in (0.0, 0.29, 0.35, 0.44, 1.0):
        tip = arm.tip(fa.equilibrium(arm, static.joint_angle(t)).q)[:2]
        np.testing.assert_allclose(tip, motion.tip(t), rtol=0, atol=1e-7)
    light = heavy_arm(gravity=0.0)
    same = fa.quasi_static_reference(light, motion, order=0)
    np.testing.assert_allclose(same.joint_angle(0.35), motion.joint_angle(0.35), rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore:the tip rests:flexarm.AccuracyWarning")  # rigid angles
def test_lqg_compensates_the_bending_by_inertia_once():
    """Under gravity the rigid reference keeps the sag, and order 1 bends the links twice."""
    arm = heavy_arm()
    motion = fa.joint_motion(arm, [0.2, 0.6], [0.8, 0.1], 1.2, start_time=0.6)
    law = fa.LQG(arm, [0.5, 0.35], schedule=[[0.2, 0.5, 0.8], [0.1, 0.35, 0.6]])
    static, inertia = (fa.quasi_static_reference(arm, motion, order=k) for k in (0, 1))
    most = []
    for reference in (static, inertia, motion):
        start = {} if reference is motion else {"initial": reference.initial}
        run = fa.simulate(arm, 2.5, controller=law, reference=reference, rate=200.0, **start)
        most.append(away(run, motion).max())
    assert most[0] < 0.25 * most[1] < most[2]
    scenario = {
        "arm": arm.spec,
        "motion": {
            "kind": "joint",
            "start": [0.2, 0.6],
            "end": [0.8, 0.1],
            "duration": 1.2,
            "start_time": 0.6,
        },
        "drive": {
            "kind": "lqg",
            "posture": [0.5, 0.35],
            "schedule": [[0.2, 0.5, 0.8], [0.1, 0.35, 0.6]],
        },
        "run": {"duration": 2.5, "rate": 200.0},
    }
    run = prepare(checked_arguments(Scenario, **scenario)).run(progress=False)
    assert run.attrs["reference_kind"] == "static"
    assert away(run, motion).max() == pytest.approx(most[0], rel=0.1)


def test_a_run_reports_a_law_whose_tip_keeps_the_sag():
    """At rest on rigid angles: in one run, in a table and in a batch; with its length in mm."""
    arm, goal = heavy_arm(), [0.5, 0.4]
    motion = fa.joint_motion(arm, [0.5, 0.35], goal, 0.4)
    static = fa.quasi_static_reference(arm, motion, order=0)
    law = fa.LQG(arm, goal)
    sag = 1e3 * np.hypot(*(arm.tip(fa.equilibrium(arm, goal).q)[:2] - motion.tip(1.0)))
    options = {"rate": 100.0, "initial": static.initial}
    with pytest.warns(fa.AccuracyWarning, match=f"rests {sag:.3g} mm .* LQG keeps the sag") as kept:
        run = fa.simulate(arm, 2.0, controller=law, reference=motion, **options)
    assert run.attrs["warning"] == str(kept[0].message)
    with pytest.warns(fa.FlexarmWarning, match="the tip rests"):
        batch = fa.simulate_batch(
            arm, 2.0, controller=law, reference=[motion, static], progress=False, **options
        )
    assert batch["warning"].values.tolist() == [run.attrs["warning"], ""]
    table = fa.compare(arm, {"LQG": law}, 2.0, {"rigid": motion, "static": static}, rate=100.0)
    assert table["warning"].values.ravel().tolist() == [run.attrs["warning"], ""]
    light = heavy_arm(gravity=0.0)
    gains = fa.JointPD([400.0, 100.0], [10.0, 0.4], feedforward=fa.rigid_torque(arm, motion))
    silent = (  # the bent reference, gains on joint angles, a run without rest, no gravity
        (arm, 2.0, law, static),
        (arm, 4.0, gains, motion),
        (arm, 0.405, law, motion),
        (light, 2.0, fa.LQG(light, goal), motion),
    )
    options["rate"] = 1000.0
    for simulated, duration, controller, reference in silent:
        run = fa.simulate(
            simulated, duration, controller=controller, reference=reference, **options
        )
        assert run.attrs["warning"] == ""


@pytest.mark.parametrize("kind", ["lqg", "composite"])
@pytest.mark.parametrize(
    ("gravity", "reference", "followed"),
    [(9.81, None, "static"), (9.81, "rigid", "rigid"), (0.0, None, "rigid")],
)
def test_files_follow_the_sagging_arm_by_default_under_gravity_only(
    kind, gravity, reference, followed
):
    motion = {"kind": "joint", "start": [0.2, 0.6], "end": [0.8, 0.1], "duration": 1.2}
    scenario = checked_arguments(
        Scenario,
        arm=heavy_arm(gravity).spec,
        motion=motion,
        drive={"kind": kind, "posture": [0.5, 0.35], "reference": reference},
        run={"duration": 2.0},
    )
    assert prepare(scenario).followed.kind == followed


def test_long_motion_without_breaks_is_followed_at_every_turn():
    """The bending turns with the gravity that the links see; 161 instants missed by 0.03 mm."""
    heavy = laboratory_arm(gravity=(0.0, -1.62))
    motion = fa.circle_motion(heavy, (1.4, 1.0), (1.7, 1.0), 40.0 * np.pi, 200.0)
    times = np.linspace(0.0, 200.0, 199)
    reference = fa.quasi_static_reference(heavy, motion)
    q, qd, _ = reference.coordinates(times)
    tips = np.array([heavy.tip(each)[:2] for each in q])
    # The average over a quarter of a period moves the tip by 1e-7 m at this speed.
    np.testing.assert_allclose(tips, motion.tip(times), rtol=0, atol=1e-6)
    # Rates and angles have tables of their own; differences err by 1e-7 / 6 of the jerk.
    inner, step = slice(1, -1), 1e-3
    ahead, behind = (reference.coordinates(times[inner] + s)[0] for s in (step, -step))
    np.testing.assert_allclose((ahead - behind) / (2.0 * step), qd[inner], rtol=0, atol=1e-6)


@pytest.mark.thorough
def test_one_link_and_three():
    """The tip is in the direction of the rigid one; redundant joints follow the rigid motion."""
    one = fa.Arm(links=[fa.Link(length=1.0, elements=2, **ROD)], joints=[fa.Joint(hub_inertia=0.1)])
    turn = fa.joint_motion(one, [0.2], [0.8], 1.5, start_time=0.2)
    three = fa.Arm(links=[fa.Link(length=0.7, elements=1, **ROD)] * 3)
    path = fa.joint_motion(three, [0.2, 0.5, 0.6], [0.6, 0.9, 0.3], 1.5, start_time=0.2)
    for flexible, motion in ((one, turn), (three, path)):
        static = fa.quasi_static_reference(flexible, motion)
        errors = []
        for reference in (motion, static):
            moved = {int(number): reference for number in flexible.joint_numbers}
            run = fa.simulate(flexible, 2.0, prescribed=moved, rate=100.0)
            errors.append(away(run, motion).max())
        assert errors[1] < 0.2 * errors[0]


def test_excessive_bending_is_reported():
    soft = laboratory_arm(gravity=(0.0, -2000.0), theory="second_order")
    with pytest.raises(fa.SimulationError, match="bend too far"):
        fa.quasi_static_reference(soft, line(soft))


def test_a_straight_arm_is_named_as_the_reason():
    """However slow the motion is: the second joint passes zero, where bent links do not reach."""
    arm = laboratory_arm(gravity=(0.0, -9.81))
    for duration in (1.0, 100.0):
        through = fa.joint_motion(arm, [0.2, 0.6], [0.9, -0.3], duration)
        with pytest.raises(fa.SimulationError, match=r"nearly straight.* Avoid this"):
            fa.quasi_static_reference(arm, through, order=0)


def test_a_file_warns_if_its_drive_keeps_the_sag(tmp_path):
    """A linear drive under gravity follows the static reference, unless the file says rigid."""
    text = """
flexarm: 1
arm:
  gravity: [0, -9.81]
  links: [{length: 0.8, flexural_rigidity: 60, mass_per_length: 0.5, modes: 1},
          {length: 0.6, flexural_rigidity: 60, mass_per_length: 0.4, modes: 1}]
motion: {kind: joint, start: [0.2, 0.3], end: [0.4, END], duration: 0.5}
drive: {kind: lqg, posture: [0.3, 0.2]REFERENCE}
run: {duration: 0.1, rate: 100}
"""
    path = tmp_path / "s.yaml"
    for end, reference, kind in (
        ("-0.1", "", "rigid: "),
        ("-0.1", ", reference: rigid", "rigid"),
        ("0.25", "", "static"),
    ):
        path.write_text(text.replace("END", end).replace("REFERENCE", reference))
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            run = fa.run_scenario(path)
        assert run.attrs["reference_kind"].startswith(kind)
        kept = [w for w in warned if "the drive keeps the sag of the links" in str(w.message)]
        assert len(kept) == (kind == "rigid: "), [str(w.message) for w in warned]


@pytest.mark.parametrize("drive", ["joint_pd, ", "joint_pid, integral: 3, "])
@pytest.mark.parametrize(
    ("gravity", "end", "reference", "kind"),
    [(-9.81, -0.1, "", "rigid: "), (0.0, -0.1, "", "rigid: "), (-9.81, 0.25, "", "quasi_static"),
     (-9.81, -0.1, ", reference: rigid", "rigid")],
)  # fmt: skip
def test_gains_on_joints_warn_where_the_default_reference_is_rigid_under_gravity(
    tmp_path, drive, gravity, end, reference, kind
):
    """Joint 2 passes zero, where the bent reference is singular."""
    path = tmp_path / "s.yaml"
    path.write_text(f"""
flexarm: 1
arm:
  gravity: [0, {gravity}]
  links: [{{length: 0.8, flexural_rigidity: 60, mass_per_length: 0.5, modes: 1}},
          {{length: 0.6, flexural_rigidity: 60, mass_per_length: 0.4, modes: 1}}]
motion: {{kind: joint, start: [0.2, 0.3], end: [0.4, {end}], duration: 0.5}}
drive: {{kind: {drive}proportional: 20, derivative: 1{reference}}}
run: {{duration: 0.1, rate: 100}}
""")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        prepared = prepare(load_scenario(path))
    assert prepared.followed.kind.startswith(kind)
    kept = [w for w in warned if "the drive keeps the sag of the links" in str(w.message)]
    assert len(kept) == (kind == "rigid: " and gravity != 0.0)


def test_scenarios_with_every_controller_run(tmp_path):
    text = """
flexarm: 1
arm:
  gravity: [0, -1.62]
  links:
    - {length: 0.8, flexural_rigidity: 60, mass_per_length: 0.5, flexible: true, elements: 1,
       gauges: [{station: 0, distance: 0.005}]}
    - {length: 0.6, flexural_rigidity: 60, mass_per_length: 0.4, elements: 1,
       gauges: [{station: 0, distance: 0.005}]}
  joints: [{hub_inertia: 0.1}, {hub_inertia: 0.1, housing_inertia: 0.05}]
motion: {kind: joint, start: [0.2, 0.3], end: [0.4, 0.1], duration: 0.5}
drive: DRIVE
run: {duration: 0.1, rate: 100}
"""
    gains = "proportional: 20, derivative: [2, 1]"
    direct = {
        f"kind: joint_pid, {gains}, integral: 3, gravity: sag, torque_limit: 9, reference: rigid": (
            lambda a, f: fa.JointPID(20.0, [2.0, 1.0], 3.0, arm=a, sag=True, torque_limit=9.0)
        ),
        f"kind: joint_pid, {gains}, feedforward: rigid_inverse_dynamics": lambda a, f: fa.JointPID(
            20.0, [2.0, 1.0], feedforward=f
        ),
        "kind: computed_torque, frequency_hz: 0.5, damping_ratio: 0.7, reference: rigid": (
            lambda a, f: fa.ComputedTorque(a, 0.5, 0.7)
        ),
        "kind: computed_torque, frequency_hz: 0.5, reference: rigid, feedforward: none": (
            lambda a, f: fa.ComputedTorque(a, 0.5)
        ),
        "kind: computed_torque, frequency_hz: 0.5, feedforward: rigid_inverse_dynamics": (
            lambda a, f: fa.ComputedTorque(a, 0.5, feedforward=f)
        ),
        f"kind: strain_feedback, {gains}, strain: [30, 9], strain_rate: 0.1, reference: rigid": (
            lambda a, f: fa.StrainFeedback(20.0, [2.0, 1.0], [30.0, 9.0], 0.1, feedforward=f)
        ),
    }
    path = tmp_path / "s.yaml"
    for drive, make in direct.items():
        path.write_text(text.replace("DRIVE", "{" + drive + "}"))
        found = fa.run_scenario(path)
        scenario = fa.load_scenario(path)
        model = fa.Arm(scenario.arm)
        motion = fa.joint_motion(model, [0.2, 0.3], [0.4, 0.1], 0.5)
        controller = make(model, fa.rigid_torque(model, motion))
        wanted = fa.simulate(model, 0.1, controller=controller, reference=motion, rate=100.0)
        np.testing.assert_array_equal(found.q.values, wanted.q.values)


@pytest.mark.parametrize(
    ("drive", "more", "words"),
    [
        ("{kind: computed_torque, frequency_hz: [1, 2, 3]}", "", "length 2, one value for each"),
        ("{kind: computed_torque, frequency_hz: 0}", "", "frequency_hz"),
        (
            "{kind: computed_torque, frequency_hz: 1}",
            "initial: {equilibrium: true, balance: true}",
            "initial.balance cannot be combined with a drive",
        ),
        (
            "{kind: joint_pid, proportional: 1, derivative: 1, gravity: rigid, feedforward: RIGID}",
            "",
            "gravity cannot be combined with feedforward",
        ),
        (
            "{kind: strain_feedback, proportional: 1, derivative: 1, strain: 1}",
            "",
            "arm has no gauges",
        ),
    ],
)
def test_wrong_scenarios_are_rejected(drive, more, words, tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(
        f"""
flexarm: 1
arm:
  links:
    - {{length: 0.8, flexural_rigidity: 60, mass_per_length: 0.5}}
    - {{length: 0.6, flexural_rigidity: 60, mass_per_length: 0.4}}
motion: {{kind: joint, start: [0.2, 0.3], end: [0.4, 0.1], duration: 0.5}}
drive: {drive.replace("RIGID", "rigid_inverse_dynamics")}
{more}
run: {{duration: 0.1}}
"""
    )
    with pytest.raises(fa.InputError, match=words):
        fa.run_scenario(path)
