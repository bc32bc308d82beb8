"""The numbered rules of ``flexarm.control.contract.base``, for every controller of the registry."""

import inspect
import math

import numpy as np
import pytest
from controller_examples import DRIVES, EXAMPLES, SAMPLE_TIME, example, two_links, usual

import flexarm as fa
from flexarm.cases.scenario.scenario import FILTERS
from flexarm.control.contract.base import Controller, has_poles
from flexarm.control.hardware.measurement import Measurement
from flexarm.control.laws import CONTROLLERS
from flexarm.model import Scenario, file_text, load_scenario
from flexarm.model.checks import descriptions_of
from flexarm.model.drives import CONTROLLED, FilterSpec

#: The motion is fast and links bend far, which is not the subject of these tests.
pytestmark = [
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    # The arm has no damping, and the delay of half a sample makes its fastest vibrations unstable.
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]

every = pytest.mark.parametrize("name", EXAMPLES)


def test_every_example_is_of_a_controller():
    assert set(EXAMPLES) == set(CONTROLLERS)


@pytest.mark.parametrize("name", ["joint_pd", "adaptive", "hybrid_force", "lqg", "repetitive"])
def test_controller_without_an_entry_has_its_starting_values(name, arm):
    """A controller that is added gets such an example."""
    given = {**usual(name), "sample_time": SAMPLE_TIME}
    wanted = inspect.signature(CONTROLLERS[name]).parameters
    given |= {"arm": arm} if "arm" in wanted and name != "joint_pid" else {}
    values = {key: v() if callable(v) else v for key, v in given.items() if key in wanted}
    controller = CONTROLLERS[name](**values)
    assert np.isfinite(fa.simulate(arm, 0.02, controller=controller).torque).all()


@pytest.fixture
def arm():
    return two_links()


class Watched:
    """A controller that records its measurements and its torques."""

    def __init__(self, controller):
        self.controller = controller
        self.sample_time = controller.sample_time
        self.calls = []
        self.resets = 0

    def reset(self):
        self.resets += 1
        self.controller.reset()

    def update(self, t, measurement, reference):
        torque = np.array(self.controller.update(t, measurement, reference), dtype=float)
        self.calls.append((t, measurement, reference, torque))
        return torque


def motion(arm):
    return fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3)


@every
def test_class_has_its_name_and_documents_every_argument(name):
    kind = CONTROLLERS[name]
    assert issubclass(kind, Controller)
    assert kind.name == name
    text = inspect.getdoc(kind)
    for argument in inspect.signature(kind).parameters:
        assert f"\n    {argument}: " in text, f"{argument} has no description"


@every
def test_sample_time_is_positive_and_constant(name, arm):
    controller = EXAMPLES[name]()
    assert controller.sample_time == SAMPLE_TIME
    fa.simulate(arm, 0.1, controller=controller, reference=motion(arm))
    assert controller.sample_time == SAMPLE_TIME


@every
def test_another_sample_time_is_rejected(name):
    arguments = dict(vars(EXAMPLES[name]()))
    wanted = inspect.signature(CONTROLLERS[name]).parameters
    if "sample_time" not in wanted:
        controller = EXAMPLES[name]()
        controller.inner.sample_time = 0.123
        assert controller.sample_time == 0.123, "a wrapper's is that of what it wraps"
        return
    given = {key: value for key, value in arguments.items() if key in wanted}
    for bad in (0.0, -1e-3, np.nan, np.inf):
        with pytest.raises(fa.InputError, match="sample_time"):
            CONTROLLERS[name](**{**given, "sample_time": bad})


@pytest.mark.sampled("computed_torque", "lqg", "strain_feedback")
@every
def test_reset_makes_two_runs_equal(name, arm):
    controller = Watched(EXAMPLES[name]())
    runs = []
    for start in ([0.2, -0.4], [1.0, 1.0], [0.2, -0.4]):
        reference = None if start[0] == 1.0 else motion(arm)
        runs.append(
            fa.simulate(
                arm, 0.2, controller=controller, reference=reference, initial=arm.rest(start)
            )
        )
    assert controller.resets == 3
    fresh = fa.simulate(
        arm, 0.2, controller=EXAMPLES[name](), reference=motion(arm), initial=arm.rest([0.2, -0.4])
    )
    for other in (runs[2], fresh):
        for channel in ("q", "qd", "torque"):
            np.testing.assert_array_equal(other[channel].values, runs[0][channel].values)


@pytest.mark.sampled("computed_torque", "lqg", "hybrid_force")
@every
def test_reset_without_a_reference_makes_two_runs_equal(name, arm):
    """The state of one run must not affect the next one."""
    controller = EXAMPLES[name]()
    for start in ([0.3, 0.1], [-0.7, 0.9]):
        run = fa.simulate(arm, 0.1, controller=controller, initial=arm.rest(start))
        fresh = fa.simulate(arm, 0.1, controller=EXAMPLES[name](), initial=arm.rest(start))
        np.testing.assert_array_equal(run.torque.values, fresh.torque.values)


@pytest.mark.sampled("joint_pd", "computed_torque", "lqg", "strain_feedback", "hybrid_force", "mpc")
@every
def test_update_is_called_at_each_sample_time_with_the_readings(name, arm):
    controller = Watched(EXAMPLES[name]())
    reference = motion(arm)
    result = fa.simulate(arm, 0.1, controller=controller, reference=reference, rate=1000.0)
    times = np.array([call[0] for call in controller.calls])
    np.testing.assert_allclose(times, SAMPLE_TIME * np.arange(25), rtol=1e-15)
    for t, measurement, given, torque in controller.calls:
        assert isinstance(measurement, Measurement)
        now = result.sel(time=t, method="nearest")
        assert float(now.time) == pytest.approx(t, abs=1e-12)
        # A sensor reads the state at that instant, which is also recorded.
        np.testing.assert_allclose(measurement.joint_angle, now.joint_angle, rtol=0, atol=1e-14)
        np.testing.assert_allclose(measurement.joint_rate, now.joint_rate, rtol=0, atol=1e-12)
        np.testing.assert_allclose(measurement.strain, now.strain, rtol=0, atol=1e-14)
        assert torque.shape == (2,)
        np.testing.assert_array_equal(given.joint_angle(t), reference.joint_angle(t))
    # The torque is constant between two calls.
    wanted = np.array([call[3] for call in controller.calls])
    held = np.clip(np.floor(result.time.values / SAMPLE_TIME + 1e-9).astype(int), 0, 24)
    np.testing.assert_array_equal(result.torque.values, wanted[held])


@every
def test_changing_a_measurement_does_not_change_the_run(name, arm):
    """Rule 4: a measurement is a copy."""

    class Scribbler(Watched):
        def update(self, t, measurement, reference):
            torque = super().update(t, measurement, reference)
            for values in (measurement.joint_angle, measurement.joint_rate, measurement.strain):
                if values.flags.writeable:
                    values += 100.0
            return torque

    runs = [
        fa.simulate(arm, 0.05, controller=kind(EXAMPLES[name]()), reference=motion(arm))
        for kind in (Watched, Scribbler)
    ]
    np.testing.assert_array_equal(runs[0].q.values, runs[1].q.values)


@pytest.mark.sampled("joint_pd", "computed_torque")
@every
def test_slow_motion_is_followed_within_a_few_degrees(name, arm):
    """The error of a slow motion is a few degrees at most."""
    slow = fa.joint_motion(arm, [0.2, -0.4], [0.5, 0.1], 2.0)
    controller = EXAMPLES[name]()
    controller.sample_time = 0.001  # at a sample time four times as long, these gains are unstable
    result = fa.simulate(arm, 5.0, controller=controller, reference=slow, rate=50.0)
    wanted = slow.joint_angle(result.time.values)
    assert abs(result.joint_angle.values - wanted).max() < 0.1
    assert abs(result.joint_angle.values[-1] - wanted[-1]).max() < 0.02


def run_with_instruments(arm, controller, reference, names):
    """Simulate a short run with instruments for some readings."""
    hardware = fa.Hardware([fa.Instrument(name) for name in names])
    fa.simulate(arm, 0.02, controller=controller, reference=reference, hardware=hardware)


@every
def test_stated_requirements_are_sufficient(name, arm):
    """A run with instruments for these readings, and no others, succeeds."""
    controller, reference = EXAMPLES[name](), motion(arm)
    requirements = controller.requirements(arm, reference)
    assert requirements.joints == 2
    run_with_instruments(arm, controller, reference, requirements.measured)


@every
def test_each_missing_requirement_is_rejected_before_the_run(name, arm):
    controller, reference = EXAMPLES[name](), motion(arm)
    needed = controller.requirements(arm, reference).measured
    for omitted in needed:
        others = [name for name in needed if name != omitted]
        with pytest.raises(fa.InputError, match=f"hardware has no instrument for {omitted}"):
            run_with_instruments(arm, controller, reference, others)


@every
def test_arm_with_another_number_of_joints_is_rejected_before_the_run(name, arm):
    three = fa.Arm(links=[arm.spec.links[0]] * 3, joints=[fa.Joint(hub_inertia=0.05)] * 3)
    with pytest.raises(fa.InputError, match="controller is for 2 joints, but the arm has 3"):
        fa.simulate(three, 0.02, controller=EXAMPLES[name]())


@every
def test_lists_for_another_number_of_joints_are_rejected_before_the_run(name, arm):
    def run(key):
        controller = example(name, **{key: [1.0] * 3})
        fa.simulate(arm, 0.02, controller=controller, reference=motion(arm))

    wanted = inspect.signature(CONTROLLERS[name]).parameters
    for key in wanted.keys() & set(CONTROLLED[name].per_joint):
        with pytest.raises(fa.InputError, match=rf"{key} must have|controller is for 3 joints"):
            run(key)


#: Controllers without a stability analysis of the sampled loop, because their gains change, or
#: their memory is a whole period.
WITHOUT_POLES = ("estimator", "nonlinear_mpc", "rbf_adaptive", "repetitive")


@every
def test_loops_have_poles(name):
    """Without poles no run warns of an unstable loop."""
    assert has_poles(EXAMPLES[name]()) == (name not in WITHOUT_POLES)


@pytest.mark.parametrize("name", WITHOUT_POLES)
@pytest.mark.parametrize("call", [fa.loop_margins, fa.loop_models], ids=lambda call: call.__name__)
def test_controllers_without_poles_are_documented(name, call):
    assert f"`{type(EXAMPLES[name]()).__name__}`" in call.__doc__


# In files ----------------------------------------------------------------------------------------

#: Arguments that only Python can express, or that have no effect in a file.
PYTHON_ONLY = {
    ("lqg", "nominal"): "a result of a run",
    ("mpc", "nominal"): "a result of a run",
    ("nonlinear_mpc", "nominal"): "a result of a run",
    ("estimator", "sample_time"): "that of the inner controller",
}
#: Keys that every drive has: a motion and a kind are objects in Python.
OF_FILES = ("kind", "reference")
#: Keys of a record that replace arguments of the class.
INSTEAD = {("joint_pid", "gravity"): ("arm", "sag")}


@every
def test_drive_has_the_same_arguments_and_defaults(name):
    """A new controller needs a line in the registry of ``flexarm.model.drives``."""
    assert name in CONTROLLED, f"files have no {name}: add its parameters to registry.py"
    fields = {k: f for k, f in CONTROLLED[name].model_fields.items() if k not in OF_FILES}
    left_out = {"arm"} | {k for record, k in PYTHON_ONLY if record == name}
    for (record, key), replaced in INSTEAD.items():
        if record == name:
            assert not fields.pop(key).is_required()
            left_out |= set(replaced)
    found = inspect.signature(CONTROLLERS[name]).parameters
    wanted = {key: p for key, p in found.items() if key not in left_out}
    assert set(fields) == set(wanted)
    for key, field in fields.items():
        assert key in descriptions_of(CONTROLLED[name])
        compare(f"{name}.{key}", field, wanted[key].default)


def compare(place, field, default):
    """Fail if the default of a record differs from that of the class."""
    nothing = (None, inspect.Parameter.empty, math.inf)
    if default is inspect.Parameter.empty:
        # A part with keys of its own is optional if each of these keys is.
        nested = field.default is not None and hasattr(field.default, "model_fields_set")
        assert field.is_required() or nested, f"{place} must be required"
    elif place.endswith(".feedforward"):
        assert (field.default, default) == (None, None)
    elif field.default is None:
        assert default in nothing, f"{place} must be {default} by default"
    else:
        assert field.default == default, f"{place} must be {default} by default"


@pytest.mark.parametrize("kind", FILTERS)
def test_filter_record_has_the_same_arguments_and_defaults(kind):
    fields = dict(FilterSpec.model_fields)
    del fields["kind"]
    wanted = dict(inspect.signature(FILTERS[kind]).parameters)
    if kind != "moving_horizon":
        for key in ("horizon", "lower_bounds", "upper_bounds"):
            del fields[key]
    # given by the file: the arm, and the time of the inner controller
    for key in ("arm", "sample_time"):
        del wanted[key]
    assert set(fields) == set(wanted)
    for key, field in fields.items():
        if key != "instruments":  # by default that of the hardware
            compare(f"estimator.{key}", field, wanted[key].default)


def test_every_record_has_a_controller():
    assert set(CONTROLLED) == set(CONTROLLERS)


@pytest.mark.sampled("joint_pd", "computed_torque", "lqg", "strain_feedback", "hybrid_force", "mpc")
@every
def test_file_gives_the_same_run(name, arm, tmp_path):
    """Strain feedback of a file needs one gauge for each joint, so two."""
    gauge = fa.Gauge(station=0.1, distance=0.005)
    links = [link.replace(gauges=[gauge]) for link in arm.spec.links]
    controller, spec = EXAMPLES[name](), arm.spec
    if name == "strain_feedback":
        spec = arm.spec.replace(links=links)
        controller.strain, controller.strain_rate = np.array([100.0, 50.0]), np.array([0.1, 0.0])
    inside = {} if "inner" in DRIVES[name] else {"sample_time": SAMPLE_TIME}
    drive = {**DRIVES[name], **inside, "kind": name, "reference": "rigid"}
    within = drive
    while "inner" in within:
        within["inner"] = dict(within["inner"])
        within = within["inner"]
    if "feedforward" in CONTROLLED[within["kind"]].model_fields:
        within["feedforward"] = "none"
    scenario = Scenario(
        arm=spec,
        motion={"kind": "joint", "start": [0.2, -0.4], "end": [0.9, 0.5], "duration": 0.3},
        drive=drive,
        run={"duration": 0.1},
    )
    plant = fa.Arm(spec)
    by_hand = fa.simulate(plant, 0.1, controller=controller, reference=motion(arm))
    np.testing.assert_array_equal(fa.run_scenario(scenario).torque, by_hand.torque)
    path = tmp_path / "scenario.yaml"
    path.write_text(file_text(scenario), encoding="utf-8")
    assert load_scenario(path).drive == scenario.drive
