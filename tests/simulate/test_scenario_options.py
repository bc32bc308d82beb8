"""Options of a scenario besides motion and drive have the effect of the same calls in Python."""

from importlib import import_module

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import load_scenario

ARM = """\
flexarm: 1
arm:
  gravity: [0, -9.81]
  links:
    - {length: 1.2, flexural_rigidity: 1000.0, mass_per_length: 0.6, elements: 2}
    - {length: 1.0, flexural_rigidity: 1000.0, mass_per_length: 0.6, elements: 1}
  joints:
    - {hub_inertia: 0.5, damping: 0.1}
    - {hub_inertia: 0.2, housing_inertia: 0.05, mass: 0.3, stiffness: 2.0, rest_angle: 0.1}
run: {duration: 0.4, rate: 100, rtol: 1.0e-9, atol: 1.0e-11}
"""
FINE = {"duration": 0.4, "rate": 100, "rtol": 1e-9, "atol": 1e-11}
MOTION = "motion: {kind: joint, start: [0.3, -0.5], end: [0.6, -0.2], duration: 0.4}\n"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "run.yaml"
        path.write_text(ARM + text)
        return path

    return write


@pytest.fixture
def run(write):
    return lambda text: fa.run_scenario(write(text))


@pytest.fixture
def arm(write):
    return fa.load_arm(write(""))


def test_loads_and_base(run, arm):
    found = run(
        "loads:\n"
        "  - {link: 1, force: [0, -3], moment: 0.2, station: 0.7}\n"
        "  - {link: 2, force: [0, 4], spread: [0.2, 1.0], frame: link,\n"
        "     factor: {times: [0.1, 0.1, 0.3], values: [0, 1, 0]}}\n"
        "base_acceleration: {times: [0, 0.2], values: [[0, 0], [1, 2]]}\n"
    )
    table = ([0.1, 0.1, 0.3], [0, 1, 0])
    loads = [
        fa.Load(1, (0.0, -3.0), 0.2, station=0.7),
        fa.Load(2, (0.0, 4.0), spread=(0.2, 1.0), frame="link", factor=table),
    ]
    base = ([0, 0.2], [[0, 0], [1, 2]])
    wanted = fa.simulate(arm, loads=loads, base_acceleration=base, **FINE)
    np.testing.assert_array_equal(found.q, wanted.q)
    still = run("base_acceleration: [1, 2]\n")
    np.testing.assert_array_equal(still.q, fa.simulate(arm, base_acceleration=(1, 2), **FINE).q)


def test_prescribed_joints(run, arm):
    found = run(
        MOTION
        + "prescribed:\n"
        + "  - {joint: 1, kind: table, times: [0, 0.1, 0.3], angles: [0.1, 0.15, 0.1]}\n"
        + "  - {joint: 2, kind: motion}\n"
    )
    table = fa.PrescribedAngle.table([0, 0.1, 0.3], [0.1, 0.15, 0.1])
    motion = fa.joint_motion(arm, [0.3, -0.5], [0.6, -0.2], 0.4)
    start = arm.rest([0.1, -0.5])
    wanted = fa.simulate(arm, prescribed={1: table, 2: motion}, initial=start, **FINE)
    np.testing.assert_array_equal(found.q, wanted.q)
    assert found.joint_angle.values[0].tolist() == [0.1, -0.5]
    free = run(
        "prescribed: [{joint: 2, kind: table, ends: free, times: [0, 0.4], angles: [0.5, 0.6]}]\n"
    )
    # Both ends are free: a straight line.
    line = 0.5 + 0.25 * free.time
    np.testing.assert_allclose(free.joint_angle.sel(joint=2), line, rtol=0, atol=1e-12)


def test_constant_joint_stays_at_its_initial_angle(run):
    found = run("initial: {joint_angle: [0.4, -0.3]}\nprescribed: [{joint: 2, kind: hold}]\n")
    np.testing.assert_array_equal(found.joint_angle.sel(joint=2), -0.3)
    assert np.ptp(found.joint_angle.values[:, 0]) > 0.01
    by_motion = run(MOTION + "prescribed: [{joint: 1, kind: hold}]\n")
    np.testing.assert_array_equal(by_motion.joint_angle.sel(joint=1), 0.3)


#: Loads of `TestEquilibrium.LOADS` at time zero.
ACTING = {"loads": [fa.Load(1, (2.0, -6.0))], "base_acceleration": (0.5, 1.0)}


class TestEquilibrium:
    #: A load from minus infinity, one that starts later, and a base that accelerates upwards.
    LOADS = (
        "loads:\n"
        "  - {link: 1, force: [1, -3], factor: {times: [0, 0, 9], values: [7, 2, 2]}}\n"
        "  - {link: 2, moment: 5, factor: {times: [0.35, 0.35], values: [0, 1]}}\n"
        "base_acceleration: {times: [0, 9], values: [[0.5, 1], [0.5, 1]]}\n"
    )

    def test_start_is_the_equilibrium_under_loads_at_time_zero(self, run, arm):
        found = run(self.LOADS + "initial: {joint_angle: [0.3, -0.5], equilibrium: true}\n")
        wanted = fa.equilibrium(arm, [0.3, -0.5], **ACTING)
        np.testing.assert_array_equal(found.q[0], wanted.q)
        np.testing.assert_array_equal(found.torque, 0.0)  # without a drive that holds it
        assert abs(found.link_tip_deflection.values[0]).min() > 5e-4
        plain = fa.equilibrium(arm, [0.3, -0.5])
        assert abs(wanted.q - plain.q).max() > 1e-3

    def test_base_acceleration_acts_as_gravity(self, arm):
        lifted = fa.equilibrium(arm, [0.3, -0.5], base_acceleration=(0.5, 1.0))
        heavy = fa.Arm(arm.spec.replace(gravity=(-0.5, -10.81)))
        wanted = fa.equilibrium(heavy, [0.3, -0.5])
        np.testing.assert_array_equal(lifted.q, wanted.q)
        np.testing.assert_array_equal(lifted.torque, wanted.torque)
        with pytest.raises(fa.InputError, match="equilibrium: base_acceleration must be"):
            fa.equilibrium(arm, base_acceleration=9.81)

    @pytest.mark.thorough_cases(
        "{kind: none}-0.34",
        "{kind: torque, rate: 100, interpolation: linear, values: [ZEROS]}-0.34",
    )
    @pytest.mark.parametrize("duration", [0.34, 0.4])
    @pytest.mark.parametrize(
        "drive",
        [
            "{kind: none}",
            "{kind: rigid_inverse_dynamics}",
            "{kind: torque, rate: 100, interpolation: linear, values: [ZEROS]}",
            "{kind: joint_pd, proportional: 20, derivative: 1, reference: rigid}",
            (
                "{kind: joint_pd, proportional: 20, derivative: 1, reference: rigid, "
                "feedforward: none}"
            ),
            (
                "{kind: joint_pd, proportional: 20, derivative: 1, "
                "feedforward: rigid_inverse_dynamics}"
            ),
        ],
    )
    def test_balanced_drive_keeps_the_equilibrium_until_a_load_changes(
        self, drive, duration, write
    ):
        still = "motion: {kind: joint, start: [0.3, -0.5], end: [0.3, -0.5], duration: 0.4}\n"
        drive = "drive: " + drive.replace("ZEROS", ", ".join(["[0, 0]"] * 41)) + "\n"
        start = "initial: {equilibrium: true, balance: true}\n"
        path = write(self.LOADS + still + drive + start)
        path.write_text(
            path.read_text().replace("duration: 0.4, rate", f"duration: {duration}, rate")
        )
        result = fa.run_scenario(path)
        moved = np.ptp(result.q.values, axis=0).max()
        if duration < 0.35:
            assert moved < 1e-8  # the residual of the equilibrium, over 0.34 s
            holding = fa.equilibrium(fa.load_arm(path), [0.3, -0.5], **ACTING).torque
            np.testing.assert_allclose(result.torque, [holding] * 35, rtol=1e-6)
        else:
            assert moved > 1e-3

    def test_balance_is_added_to_the_rigid_torques(self, run, arm):
        common = MOTION + "drive: {kind: rigid_inverse_dynamics}\n"
        plain = run(common)
        balanced = run(common + "initial: {equilibrium: true, balance: true}\n")
        more = balanced.torque - plain.torque
        # Two torques of 10 N m are subtracted.
        np.testing.assert_allclose(more, more[[0] * len(more)], rtol=0, atol=1e-12)
        holding = fa.equilibrium(arm, [0.3, -0.5]).torque
        # The quintic starts without acceleration, so at time zero the whole torque is static.
        np.testing.assert_allclose(balanced.torque[0], holding, rtol=1e-12)
        assert abs(more[0]).max() > 1e-3

    def test_balance_ignores_the_initial_acceleration(self, run, arm):
        """A trapezoidal motion starts with a jump, which must not be balanced."""
        common = MOTION.replace("duration", "profile: trapezoidal, duration")
        common += "drive: {kind: rigid_inverse_dynamics}\n"
        more = (
            run(common + "initial: {equilibrium: true, balance: true}\n").torque
            - run(common).torque
        )
        rigid = arm.rigid()
        known = rigid.inverse_dynamics([0.3, -0.5], [0, 0], [0, 0])
        wanted = fa.equilibrium(arm, [0.3, -0.5]).torque - known
        np.testing.assert_allclose(more, [wanted] * len(more), rtol=0, atol=1e-12)

    def test_prescribed_joints_start_at_their_motion(self, run, arm):
        found = run(
            "initial: {joint_angle: [0.3, 9.0], equilibrium: true}\n"
            "prescribed:\n"
            "  - {joint: 1, kind: hold}\n"
            "  - {joint: 2, kind: table, times: [0.2, 0.3], angles: [-0.5, -0.4]}\n"
        )
        wanted = fa.equilibrium(arm, [0.3, -0.5])
        np.testing.assert_array_equal(found.q[0], wanted.q)
        until = found.q.sel(time=slice(0.0, 0.2))
        # The residual of the equilibrium vibrates.
        np.testing.assert_allclose(until, [wanted.q] * len(until), rtol=0, atol=1e-8)

    def test_initial_angle_of_a_prescribed_joint_is_that_of_its_motion(self, run, arm):
        found = run(
            MOTION
            + "initial: {joint_angle: [0.3, 9.0], equilibrium: true}\n"
            + "prescribed: [{joint: 2, kind: motion}]\n"
        )
        wanted = fa.equilibrium(arm, [0.3, -0.5])
        np.testing.assert_array_equal(found.q[0], wanted.q)

    def test_missing_equilibrium_is_reported(self, write, monkeypatch):
        """The error is simulated, because every arm with locked joints has an equilibrium here."""

        def none(arm, *_, **__):
            raise fa.EquilibriumError(0.4, arm.rest([0.0, 0.0]), "the arm buckles.")

        monkeypatch.setattr(import_module("flexarm.cases.scenario.scenario"), "equilibrium", none)
        with pytest.raises(fa.EquilibriumError, match=r"above 0\.4 of gravity and loads"):
            prepare(load_scenario(write("initial: {equilibrium: true}\n")))


def test_fixed_and_elastic_joints_start_in_equilibrium(tmp_path):
    """Joint 2 is fixed and has no angle; the spring of joint 3 is twisted."""
    text = (
        "flexarm: 1\n"
        "arm:\n"
        "  gravity: [0, -9.81]\n"
        "  links:\n"
        "    - &rod {length: 0.6, flexural_rigidity: 1000, mass_per_length: 0.6, elements: 1}\n"
        "    - *rod\n"
        "    - *rod\n"
        "  joints:\n"
        "    - {hub_inertia: 0.5, damping: 0.1}\n"
        "    - {fixed: true, rest_angle: 0.4}\n"
        "    - {rotor_inertia: 0.01, gear_ratio: 5, stiffness: 300}\n"
        "motion: {kind: joint, start: [0.3, -0.5], end: [0.3, -0.5], duration: 0.2}\n"
        "drive: {kind: rigid_inverse_dynamics}\n"
        "initial: {equilibrium: true, balance: true}\n"
        "run: {duration: 0.2, rate: 100}\n"
    )
    path = tmp_path / "run.yaml"
    path.write_text(text)
    still = fa.run_scenario(path)
    assert np.ptp(still.q.values, axis=0).max() < 1e-8  # the residual of the equilibrium
    assert abs(still.joint_twist.values[0, 1]) > 1e-3
    path.write_text(text.replace("motion:", "prescribed: [{joint: 3, kind: hold}]\nmotion:"))
    held = fa.run_scenario(path)
    np.testing.assert_array_equal(held.joint_angle.sel(joint=3), -0.5)
    assert np.ptp(held.q.values, axis=0).max() < 1e-8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "motion:\n  kind: line\n  start: [2.0, 0.5]\n  end: [3.0, 0.0]\n  duration: 1.0\n",
            r"run\.yaml:14: motion\.end must .* reach",
        ),
        (
            "motion: {kind: line, start: [0, 1], end: [0, -1], duration: 1}\n",
            r"run\.yaml:11: motion\.line from start to end must",
        ),
        (
            "drive:\n  kind: torque\n  rate: 100\n  values: [[0, 0], [1, 1]]\n",
            r"run\.yaml:14: drive\.values must have at least 40 samples",
        ),
    ],
)
def test_errors_during_preparation_have_their_line(text, message, run):
    with pytest.raises(fa.InputError, match=message):
        run(text)


def test_unknown_integrator_has_its_line(write):
    path = write("")
    path.write_text(path.read_text().replace("rate: 100", "integrator: rk5"))
    with pytest.raises(fa.InputError, match=r"run\.yaml:10: run\.integrator must be one of"):
        fa.run_scenario(path)


def test_sampled_torques_state_their_interpolation(run):
    samples = [[0.1, 0.0]] * 300
    found = run(f"drive: {{kind: torque, rate: 100, interpolation: hold, values: {samples}}}\n")
    assert found.attrs["torque_interpolation"] == "hold"


def test_without_a_file_errors_have_the_key_only(write):
    scenario = load_scenario(write("drive: {kind: torque, rate: 9, values: [[0, 0], [1, 1]]}\n"))
    with pytest.raises(fa.InputError, match=r"^scenario: drive\.values must"):
        fa.run_scenario(scenario)


def test_events(run, arm, write):
    text = (
        "events:\n"
        "  - {kind: tip_line, point: [0, -0.5], normal: [0, 1], name: low}\n"
        "  - {kind: joint_angle, joint: 1, angle: -0.4, direction: falling, terminal: true}\n"
    )
    found = run(text)
    events = [
        fa.tip_event(arm, (0.0, -0.5), (0.0, 1.0), name="low"),
        fa.joint_event(arm, 1, -0.4, direction=-1, terminal=True),
    ]
    wanted = fa.simulate(arm, events=events, **FINE)
    assert wanted.event_name.values.tolist() == ["low", "event_2"]
    np.testing.assert_array_equal(found.q, wanted.q)
    np.testing.assert_array_equal(found.event_time, wanted.event_time)
    assert found.attrs["ended_by"] == "event_2"
    # On another plant events are located on that plant.
    prepared = prepare(load_scenario(write(text)))
    rigid = prepared.run(arm=arm.rigid())
    height = [arm.rigid().tip(q)[1] for q in rigid.event_q.values]
    assert height[0] == pytest.approx(-0.5, abs=1e-9)


def test_event_at_a_joint_stop(tmp_path):
    path = tmp_path / "run.yaml"
    stops = "limits: {lower: -0.3, upper: 1.0, stiffness: 1.0e+3}"
    text = ARM.replace("damping: 0.1}", f"damping: 0.1, {stops}}}")
    path.write_text(text + "events: [{kind: joint_angle, joint: 1, stop: lower, terminal: true}]\n")
    result = fa.run_scenario(path)
    assert result.joint_angle.values[-1, 0] == pytest.approx(-0.3, abs=1e-9)
    assert result.attrs["ended_by"] == "event_1"


@pytest.mark.parametrize("how", ["", "rtol: 1.0e-6", "step: 1.0e-4", "accuracy: 1.0e-5"])
def test_samples_of_a_torque_that_jumps(write, how):
    """Steps end at the same samples as in Python."""
    torque = np.where(np.arange(41) < 20, 5.0, -5.0)[:, None] * [1.0, 0.3]
    drive = f"drive: {{kind: torque, rate: 100, values: {torque.tolist()}}}\n"
    path = write("initial: {joint_angle: [0.3, 0.1]}\n" + drive)
    text = path.read_text().replace(", rtol: 1.0e-9, atol: 1.0e-11", f", {how}" if how else "")
    path.write_text(text)
    found = fa.run_scenario(path)
    arm, given = fa.load_arm(path), dict([how.split(": ")] if how else [])
    start = {"initial": arm.rest([0.3, 0.1]), "rate": 100.0, "progress": False}
    wanted = fa.simulate(
        arm, 0.4, torque=torque, **start, **{k: float(v) for k, v in given.items()}
    )
    np.testing.assert_array_equal(found["q"], wanted["q"])
    assert found.attrs["steps"] == wanted.attrs["steps"]
