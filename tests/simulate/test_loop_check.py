"""Runs with an unstable sampled loop give a warning before they start, and others do not."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from arms import laboratory_arm, table_one_arm
from flexarm.cases.scenario.scenario import prepare
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cli.main import app
from flexarm.control.contract.base import has_poles
from flexarm.model import load_scenario, locate_study
from flexarm.simulation.loop.stability import AnalysedLoop, loop_poles, stability

GAINS = [300.0, 80.0], [25.0, 6.0]


def instability_of(*loop):
    """Return the description of the instability of a loop."""
    return stability(AnalysedLoop(*loop)).text


def paper_arm(**joint):
    return table_one_arm(joints=[fa.Joint(**joint)] * 2)


def straight(arm):
    return fa.line_motion(arm, (2.0, 1.0), (1.0, 2.0), 2.0)


def test_too_high_gains_give_a_warning_and_explain_the_failure():
    arm = paper_arm()
    with (
        pytest.warns(fa.UnstableLoopWarning, match="at the start: a pole of magnitude 18"),
        pytest.raises(fa.SimulationError, match="The sampled loop is unstable") as caught,
    ):
        fa.simulate(arm, 0.2, controller=fa.JointPD(*GAINS), reference=straight(arm))
    assert "integrator='auto'" not in str(caught.value)
    assert "unstable" in caught.value.result.attrs["unstable_loop"]


def test_hanging_arm_is_analysed_at_its_equilibrium():
    """About straight links, which are not in equilibrium under gravity, this loop has a growing
    pole."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    rod["damping"] = fa.ModalDamping(ratio=0.01)
    links = [fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]
    arm = fa.Arm(links=links, gravity=(0.0, -9.81))
    rest = fa.equilibrium(arm, [-0.3, -1.58])
    controller = fa.JointPD([200.0, 60.0], [2.0, 0.5], feedforward=lambda t: rest.torque)
    assert instability_of(arm, arm, controller, None, None, (), rest.q, 10.0) == ""
    assert float(fa.loop_margins(controller, arm, postures=[[-0.3, -1.58]]).growth.max()) < 0.0


def test_slow_growth_within_a_short_run_gives_no_warning():
    arm = paper_arm()
    run = fa.simulate(arm, 1e-3, controller=fa.JointPD([4.0, 1.0], [0.2, 0.03]))
    assert run.attrs["unstable_loop"] == ""


def test_reported_growth_is_that_of_the_run():
    """The gains are at the limit of stability."""
    arm = paper_arm(hub_inertia=0.05)
    controller = fa.JointPD([40.0, 10.0], [40.0, 40.0])
    start = arm.rest([0.3, 0.8])
    text = instability_of(arm, arm, controller, None, None, (), start, 1.0)
    tenfold = float(text.split("grows tenfold every ")[1].split(" s")[0])
    start[arm.joint_index] += 1e-9
    with pytest.warns(fa.UnstableLoopWarning):
        run = fa.simulate(
            arm,
            6.0 * tenfold,
            controller=controller,
            reference=fa.joint_motion(arm, [0.3, 0.8], [0.3, 0.8], 10.0),
            initial=start,
            rate=1000.0,
            rtol=1e-10,
            atol=1e-15,
        )
    size = np.abs(np.diff(run.torque.values, axis=0)).max(axis=1)
    middle, late = int(0.4 * size.size), int(0.9 * size.size)
    decades = np.log10(size[late] / size[middle]) / (run.time[late] - run.time[middle])
    # The text has two digits, and neighbouring samples alternate.
    assert float(decades) * tenfold == pytest.approx(1.0, abs=0.15)


def test_plant_and_slow_instruments_are_included():
    arm = paper_arm(hub_inertia=0.1)
    controller = fa.JointPD([40.0, 10.0], [4.0, 0.5])
    start = arm.rest([0.3, 0.8])
    assert instability_of(arm, arm, controller, None, None, (), start, 0.1) == ""
    light = paper_arm()
    assert "unstable" in instability_of(arm, light, controller, None, None, (), start, 0.1)
    late = fa.Hardware(motors=fa.Motors(delay=0.02))
    assert "unstable" in instability_of(arm, arm, controller, None, late, (), start, 0.1)
    frames = fa.Hardware([fa.Instrument("joint_angle", sample_time=0.1, rate_cutoff=5.0)])
    assert "unstable" in instability_of(arm, arm, controller, None, frames, (), start, 5.0)


def test_compare_warns_once_and_keeps_the_warning_with_the_metrics():
    arm = paper_arm(hub_inertia=0.1)
    controllers = {"gentle": fa.JointPD([4.0, 1.0], [0.5, 0.05]), "hard": fa.JointPD(*GAINS)}
    motion = {"line": straight(arm)}
    with pytest.warns(fa.UnstableLoopWarning, match="'hard' on 'light'") as caught:
        table = fa.compare(
            arm, controllers, 0.05, motion, {"light": paper_arm()}, integrator="rk4", step=1e-4
        )
    assert len(caught) == 1
    reported = [f"{table.warning.sel(controller=name).item()}" for name in controllers]
    reported = [a or b for a, b in zip(reported, table.failure.values.ravel(), strict=True)]
    assert reported[0] == ""
    assert "unstable" in reported[1]


def test_check_warns_of_an_unstable_loop(tmp_path):
    text = """
flexarm: 1
arm:
  links: [{length: 1.4142, flexural_rigidity: 105.0, mass_per_length: 0.61732, elements: 2}]
  joints: [{hub_inertia: 0.01}]
motion: {kind: joint, start: [0.0], end: [1.0], duration: 1.0}
drive: {kind: joint_pd, proportional: 300.0, derivative: GAIN}
run: {duration: 1.0, rate: 100}
"""
    for gain, warned in (("25.0", True), ("2.0", False)):
        path = tmp_path / "scenario.yaml"
        path.write_text(text.replace("GAIN", gain), encoding="utf-8")
        result = CliRunner().invoke(app, ["check", str(path)])
        assert result.exit_code == 0
        assert ("the sampled loop is unstable" in result.stderr) == warned
        assert ("ok, but for the warning" in result.stdout) == warned
        assert "ok" in result.stdout


def test_check_and_run_name_the_same_cure(tmp_path):
    """The design ignores motors with a delay and a lag."""
    path = tmp_path / "scenario.yaml"
    path.write_text(
        """
flexarm: 1
arm:
  links:
    - {length: 1.0, flexural_rigidity: 60.0, mass_per_length: 0.6, elements: 2,
       damping: {kind: modal, ratio: 0.01}}
  joints: [{hub_inertia: 0.05}]
  payload: {mass: 0.2}
motion: {kind: joint, start: [0.0], end: [0.0], duration: 0.1}
drive: {kind: lqg, measured: {joint_angle: 1.0e-4}}
hardware: {instruments: [{signal: joint_angle}], motors: {delay: 1.0e-3, time_constant: 2.0e-3}}
run: {duration: 0.02}
""",
        encoding="utf-8",
    )
    shown = " ".join(CliRunner().invoke(app, ["check", str(path)]).stderr.split())
    with pytest.warns(fa.UnstableLoopWarning, match="design it with hardware=") as caught:
        prepare(load_scenario(path)).run()
    assert str(caught[0].message) in shown


def test_surfaces_without_a_force_reference_are_ignored():
    """Joint control ends with straight links deep in the wall, which is not an equilibrium."""
    path = Path(__file__).parents[2] / "examples" / "wipe_wall.yaml"
    prepared = prepare(load_scenario(path))
    text, _, _, poles = prepared.stability()
    assert [pole.when for pole in poles if not pole.passing] == [
        "at the start",
        "at the end of the motion",
    ]
    assert text == ""


ENCODERS = fa.Hardware(
    [
        fa.Instrument("joint_angle", resolution=2.0 * np.pi / 2**17, rate_cutoff=100.0),
        fa.Instrument("contact_force"),
    ]
)


@pytest.mark.thorough
@pytest.mark.parametrize(("rigidity", "payload"), [(1.0, 0.1), (1.0, 0.2), (0.7, 0.1)])
@pytest.mark.parametrize("kind", [fa.HybridForce, fa.Impedance, fa.Admittance])
def test_force_controllers_are_stable_with_encoders_of_17_bits(kind, rigidity, payload):
    """The three arms of examples/studies/wipe.yaml."""
    arm, plant = laboratory_arm(payload=0.1), laboratory_arm(rigidity, payload)
    path = fa.line_motion(arm, (1.5, 0.5), (1.5, 0.8), 2.0, start_time=1.0)
    reference = fa.pressed_motion(arm, path, lambda t: 5.0, (-1.0, 0.0))
    wall = fa.Contact(fa.Wall((1.5, 0.0), (-1.0, 0.0)), stiffness=1e4, damping=0.5, friction=0.2)
    found = fa.loop_margins(
        kind(arm), plant, [0.0, 3.0], hardware=ENCODERS, contacts=[wall], reference=reference
    )
    assert float(found.growth.max()) < 1e-6
    assert float(found.disk_margin.min()) > 0.1
    text = instability_of(
        arm, plant, kind(arm), reference, ENCODERS, [wall], reference.initial, 4.0
    )
    assert text == ""


def test_dry_friction_does_not_hide_an_instability():
    """At rest it acts like a damper of 100 N m s/rad, in motion it does not."""
    arm = paper_arm(friction=fa.Friction(coulomb=1.0))
    with (
        pytest.warns(fa.UnstableLoopWarning, match="at the start"),
        pytest.raises(fa.SimulationError, match="The sampled loop is unstable"),
    ):
        fa.simulate(arm, 0.2, controller=fa.JointPD(*GAINS), reference=straight(arm))
    margins = fa.loop_margins(fa.JointPD(*GAINS), arm, [0.3, 0.8])
    assert float(margins.growth.max()) > 100.0


@pytest.mark.parametrize(
    ("kind", "numbers"), [(fa.ComputedTorque, (1.0, 0.7)), (fa.SlidingMode, (5.0, 0.5))]
)
def test_compensated_friction_is_not_an_instability(kind, numbers):
    """The controller subtracts the friction of the joints, so both are ignored."""
    arm = paper_arm(hub_inertia=0.5, friction=fa.Friction(coulomb=2.0, static=3.0)).rigid()
    controller = kind(arm, *numbers)
    reference = fa.joint_motion(arm, [0.3, 0.8], [0.4, 0.9], 1.0)
    text = instability_of(
        arm, arm, controller, reference, None, (), reference.joint_angle(0.0), 1.0
    )
    assert text == ""
    plain = paper_arm(hub_inertia=0.5).rigid()
    without = kind(plain, *numbers)
    growth = [
        fa.loop_margins(one, of, [0.0], reference=reference).growth.values
        for one, of in ((controller, arm), (without, plain))
    ]
    # Slopes of the controller are differences over 1e-5 about joint rates of 0.4 rad/s.
    np.testing.assert_allclose(*growth, rtol=1e-4, atol=1e-4)


class Integrating(fa.JointPD):
    """A user's controller with more memory than its base class."""

    def reset(self):
        super().reset()
        self.integral = np.zeros(2)

    def update(self, t, measurement, reference):
        self.integral += 1e-3 * measurement.joint_angle
        return np.asarray(super().update(t, measurement, reference)) - 50.0 * self.integral


class IntegratingStep(fa.JointPD):
    """The same as a step."""

    def initial_memory(self, readings, inputs):
        return {"total": 0.0 * readings.joint_angle}

    def step(self, memory, readings, inputs):
        total = memory["total"] + 1e-3 * readings.joint_angle
        return {"total": total}, super().step({}, readings, inputs)[1] - 50.0 * total


def test_a_step_is_valid_unless_a_class_overrides_the_update():
    arm = paper_arm(hub_inertia=0.1)
    start = arm.rest([0.3, 0.8])
    too_hard = Integrating([4.0, 1.0], [0.5, 0.05])
    assert instability_of(arm, arm, too_hard, None, None, (), start, 1.0) == ""
    with pytest.raises(fa.InputError, match="has no step"):
        fa.loop_margins(too_hard, arm)

    declared = IntegratingStep([4.0, 1.0], [0.5, 0.05])
    assert "unstable" in instability_of(arm, arm, declared, None, None, (), start, 1.0)
    observed = fa.DisturbanceObserver(arm, declared)
    assert has_poles(observed)
    assert not has_poles(fa.DisturbanceObserver(arm, too_hard))
    runs = [
        fa.simulate(arm, 0.02, controller=one, initial=start).torque.values
        for one in (too_hard, declared)
    ]
    np.testing.assert_allclose(*runs, rtol=1e-12)  # the same sums in another order


class Stubborn(fa.Controller):
    """Works in a run, and raises in an analysis."""

    sample_time = 1e-3

    def __init__(self, fault):
        from threading import Lock

        self.calls, self.fault = 0, fault
        self.lock = Lock() if fault == "copy" else None

    def step(self, memory, readings, inputs):
        if self.fault == "update" and abs(float(readings.joint_angle[0])) > 1e-6:
            raise ValueError("not mine")
        return memory, [0.0, 0.0]


@pytest.mark.parametrize("fault", ["copy", "update"])
def test_failed_analysis_does_not_end_the_run(fault):
    arm = paper_arm(hub_inertia=0.1)
    run = fa.simulate(arm, 0.01, controller=Stubborn(fault))
    assert run.attrs["failure"] == ""
    assert run.attrs["unstable_loop"] == ""


def test_incommensurable_sample_times_are_not_analysed():
    """97, 101 and 103 ms at 1 ms: a period of a million samples."""
    arm = paper_arm(hub_inertia=0.1)
    frames = {"joint_angle": 0.097, "joint_rate": 0.101, "tip": 0.103}
    hardware = fa.Hardware([fa.Instrument(k, sample_time=v) for k, v in frames.items()])
    controller = fa.JointPD([4.0, 1.0], [0.5, 0.05])
    start = arm.rest([0.3, 0.8])
    assert instability_of(arm, arm, controller, None, hardware, (), start, 1.0) == ""
    late = fa.Hardware(motors=fa.Motors(delay=10.0))
    assert instability_of(arm, arm, controller, None, late, (), start, 1.0) == ""
    with pytest.raises(fa.InputError, match="must repeat within 300 samples"):
        fa.loop_margins(controller, arm, hardware=hardware)


def test_posture_that_the_motion_passes_is_examined():
    """Joint 1 feels the payload only where link 2 is across link 1; else its loop is too fast."""
    links = [fa.Link(length=1.0, flexural_rigidity=4e3, mass_per_length=0.2)] * 2
    joints, payload = [fa.Joint(hub_inertia=0.3)] * 2, fa.Payload(mass=2.0)
    arm = fa.Arm(links=links, joints=joints, payload=payload).rigid()
    encoders, motors = fa.Instrument("joint_angle", rate_cutoff=50.0), fa.Motors(delay=6e-3)
    late = fa.Hardware([encoders], motors=motors)
    law = fa.JointPD([200.0, 30.0], [150.0, 12.0])
    growth = fa.loop_margins(law, arm, [[0.0, 0.5 * np.pi], [0.0, np.pi]], hardware=late).growth[0]
    assert growth[0] < 0.0 < growth[1]
    start, end = [0.0, 0.5 * np.pi], [0.0, 1.5 * np.pi]
    turn = fa.joint_motion(arm, start, end, 4.0)
    loop = arm, arm, law, turn, late, (), arm.rest(start), 5.0
    poles = loop_poles(AnalysedLoop(*loop))
    assert [pole.passing for pole in poles] == [False, False, True, True, True]
    assert poles[3].growth == pytest.approx(growth[1].item(), rel=1e-5)
    assert (poles[3].begin, poles[3].end) == pytest.approx((4.0 / 3.0, 8.0 / 3.0), abs=0.4)
    assert "unstable during the motion, at t = 2 s" in instability_of(*loop)
    # A motion that is over before the growth is tenfold gives no warning.
    brief = fa.joint_motion(arm, start, end, 0.5 / growth[1].item())
    assert instability_of(*loop[:3], brief, *loop[4:]) == ""


def test_growth_is_an_attribute_of_the_result_and_a_metric_of_comparisons():
    arm = paper_arm(hub_inertia=0.1, housing_inertia=0.05)
    law = fa.JointPD([60.0, 20.0], [12.0, 4.0])
    motion = straight(arm)
    table = fa.compare(arm, {"pd": law}, 2.5, {"line": motion}, rate=200.0, progress=False)
    postures = [motion.joint_angle(0.0), motion.joint_angle(2.0)]
    # The postures between them decay faster on this line.
    expected = fa.loop_margins(law, arm, postures).growth.max()
    assert table.growth.item() == pytest.approx(expected.item(), rel=1e-5)
    assert table.growth.units == "1/s"


class AccelerationFeedback(fa.JointPD):
    """Joint control that adds the acceleration of the tip to the torque of joint 1."""

    def __init__(self, gain):
        super().__init__([40.0, 10.0], [4.0, 0.5])
        self.gain = gain

    def step(self, memory, readings, inputs):
        memory, torque = super().step(memory, readings, inputs)
        return memory, torque + np.array([self.gain * readings.accelerometer[1], 0.0])


ACCELEROMETER = fa.Instrument(fa.Sensor("acceleration", link=2, name="accelerometer"))


def test_sensors_and_torques_that_no_law_reads_do_not_end_the_analysis():
    arm = paper_arm(hub_inertia=0.1)
    law, start = fa.JointPD([40.0, 10.0], [4.0, 0.5]), arm.rest([0.3, 0.8])
    motors, joints = (
        fa.Motors(delay=0.02),
        [fa.Instrument(k) for k in ("joint_angle", "joint_rate")],
    )
    growth = [
        stability(AnalysedLoop(arm, arm, law, None, hardware, (), start, 1.0)).growth
        for hardware in (
            fa.Hardware(joints, motors=motors),
            fa.Hardware([*joints, ACCELEROMETER, fa.Instrument("torque")], motors=motors),
        )
    ]
    assert growth[0] > 10.0
    assert growth[1] == pytest.approx(growth[0], rel=1e-9)


def test_growth_with_an_accelerometer_is_that_of_the_run():
    """Without the feedback it would be half as large."""
    arm = paper_arm(hub_inertia=0.1)
    law, motion = AccelerationFeedback(1.0), fa.joint_motion(arm, [0.3, 0.8], [0.3, 0.8], 10.0)
    instruments = [fa.Instrument("joint_angle"), fa.Instrument("joint_rate"), ACCELEROMETER]
    start = arm.rest([0.3, 0.8])
    start[arm.joint_index] += 1e-10
    with pytest.warns(fa.UnstableLoopWarning):
        run = fa.simulate(
            arm,
            0.8,
            controller=law,
            reference=motion,
            hardware=fa.Hardware(instruments, motors=fa.Motors(time_constant=2e-3)),
            initial=start,
            rate=1000.0,
            rtol=1e-10,
            atol=1e-15,
        )
    # Slower growing poles are at lower frequencies; the pole at 180 Hz dominates accelerations.
    size = np.abs(np.diff(run.torque.values[:, 0]))
    early, late = size[450:550].max(), size[700:800].max()
    assert np.log(late / early) / 0.25 == pytest.approx(run.attrs["loop_growth"], rel=0.02)


class Unused(IntegratingStep):
    """Joint control with a sum of angles in its memory that no torque depends on."""

    def step(self, memory, readings, inputs):
        memory, _ = super().step(memory, readings, inputs)
        return memory, fa.JointPD.step(self, {}, readings, inputs)[1]


def test_an_integral_that_no_torque_depends_on_is_not_the_slowest_pole():
    arm = paper_arm(hub_inertia=0.1, housing_inertia=0.05)
    start, gains = arm.rest([0.3, 0.8]), ([60.0, 20.0], [12.0, 4.0])
    used, unused = (
        loop_poles(AnalysedLoop(arm, arm, law, None, None, (), start, 1.0))[0]
        for law in (fa.JointPD(*gains), Unused(*gains))
    )
    assert used.growth < -0.1
    assert unused.growth == pytest.approx(used.growth, rel=1e-6)
    assert unused.frequency == pytest.approx(used.frequency, rel=1e-6)


def test_slow_instabilities_are_reported_in_the_same_words_everywhere(tmp_path):
    """Growth of 1.1 1/s in a run of 1 s: by the check of a scenario and of a study, and by
    comparisons."""
    joints = "{signal: joint_angle}, {signal: joint_rate}"
    late = f"hardware: {{instruments: [{joints}], motors: {{delay: 4 ms}}}}"
    link = "flexural_rigidity: 105.0, mass_per_length: 0.61732"
    head = f"""
flexarm: 1
arm:
  links: [{{length: 1.4142, elements: 2, {link}}}, {{length: 1.0, elements: 1, {link}}}]
  joints: [{{hub_inertia: 0.1}}, {{hub_inertia: 0.1}}]
"""
    motion = "{kind: joint, start: [0.3, 0.8], end: [0.3, 0.8], duration: 0.5}"
    drive = "{kind: joint_pd, proportional: [4, 1], derivative: [0.5, 0.05], reference: rigid}"
    run = "run: {duration: 1.0, rate: 100}"
    paths = tmp_path / "scenario.yaml", tmp_path / "study.yaml"
    paths[0].write_text(
        f"{head}motion: {motion}\ndrive: {drive}\n{late}\n{run}\n", encoding="utf-8"
    )
    plants = f"plants:\n  good: {{}}\n  late:\n    {late}\n"
    named = f"motions: {{rest: {motion}}}\ndrives: {{pd: {drive}}}\n{plants}"
    paths[1].write_text(f"{head}{named}{run}\n", encoding="utf-8")
    scenario, study = prepare(load_scenario(paths[0])), PreparedStudy(*locate_study(paths[1]))
    text = scenario.stability().slow
    assert "slowly unstable at the start" in text
    assert scenario.run().attrs["slow_instability"] == text
    assert study.unstable_loops() == {"pd on late along rest": text}
    table = study.run()
    assert table["warning"].values.ravel().tolist() == ["", text]
