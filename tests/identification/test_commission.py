"""Guided identification: inspected records, stages, faults that are named, and files."""

import re
import time
import warnings

import numpy as np
import pytest
import xarray as xr

import flexarm as fa
from data.bench_records import ONE
from flexarm.identification.commission import _Commissioning
from flexarm.identification.data_sheet import of_drives, of_links, of_masses
from flexarm.identification.findings import alike_masses, findings_of
from flexarm.identification.fitting import FitProblem
from flexarm.identification.inspection import inspected
from flexarm.identification.missing import information_of, missing_effects
from flexarm.identification.record import Label
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Space, check_free
from identification.benches import arm_of, believed, record, rough_record, truth
from identification.faults import FAULTS, UNSEEN, data_sheet, faulty_record, names_fault

pytestmark = pytest.mark.compiled

RIGIDITY = "links[0].flexural_rigidity"


def changed(measured: fa.MeasuredRecord, channel: str, values: np.ndarray) -> fa.MeasuredRecord:
    data = measured.data.copy(deep=True)
    data[channel][:, 0] = values
    return fa.MeasuredRecord(data, measured.settings)


@pytest.mark.parametrize(
    ("fault", "words", "lost"),
    [
        (lambda s: np.zeros_like(s), "strain_1 does not change: the sensor is dead", 201),
        (lambda s: np.where(np.arange(201) < 80, 0.0, s), "strain_1 reads zero until 0.4 s", 80),
        (lambda s: np.where(abs(np.arange(201) - 100) < 25, s[75], s), "from 0.375 to 0.625 s", 50),
        (lambda s: np.clip(s, -2e-5, 2e-5), "strain_1 is saturated at 2e-05", None),
        (lambda s: np.where(np.arange(201) == 90, 9e-4, s), "strain_1 has 1 spikes", 1),
        (lambda s: np.where(np.arange(201) == 90, np.nan, s), "strain_1 lacks 1 samples", 1),
        (lambda s: s, None, 0),
    ],
)
def test_faults_of_sensors_are_found_without_a_model(fault, words, lost):
    bench = record(ONE.name, 1, end=1.0)
    strain = bench.data["strain"].values[:, 0]
    checked, sentences = inspected("run", changed(bench, "strain", fault(strain)))
    assert len(sentences) == (words is not None), sentences
    assert words is None or words in sentences[0]
    missing = int(np.isnan(checked.data["strain"].values).sum())
    assert missing == lost if lost is not None else 5 <= missing < 100
    angles = checked.data["joint_angle"].values
    np.testing.assert_array_equal(angles, bench.data["joint_angle"].values)


def test_sensors_are_inspected_without_a_changing_input():
    bench = record(ONE.name, 1, end=1.0)
    still = changed(bench, "torque", np.zeros(201))
    late = np.where(np.arange(201) < 80, 0.0, bench.data["strain"].values[:, 0])
    _, sentences = inspected("run", changed(still, "strain", late))
    assert "run: strain_1 reads zero until 0.4 s" in sentences[0]
    _, sentences = inspected("run", changed(still, "strain", np.zeros(201)))
    assert "strain_1 does not change" in sentences[0]


@pytest.mark.thorough
def test_a_gauge_that_hangs_before_the_last_part_is_named():
    bench = record(ONE.name, 1, end=1.0)
    strain = bench.data["strain"].values[:, 0]
    hanging = changed(bench, "strain", np.where(np.arange(201) < 130, strain, strain[130]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)
        model = fa.commission(arm_of(ONE), {"run": hanging})
    assert any("strain_1" in sentence for sentence in model.findings)
    assert float(model.validation["fit"].sel(channel="joint_angle_1").min()) > 90.0


def test_a_record_without_a_valid_last_part_is_refused():
    bench = record(ONE.name, 1, end=1.0)
    broken = bench
    for name in ("strain", "joint_angle"):
        values = broken.data[name].values[:, 0].copy()
        values[130:] = np.nan
        broken = changed(broken, name, values)
    with pytest.raises(fa.InputError, match=r"records\['run'\] has no valid sample .* last 30 %"):
        fa.commission(arm_of(ONE), {"run": broken})


def test_wrapped_angles_are_unwrapped_and_sticking_joints_are_left():
    bench = record(ONE.name, 1, end=1.0)
    angle = np.linspace(0.0, 5.0, 201)
    angle[50:100] = angle[50]
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    checked, sentences = inspected("run", changed(bench, "joint_angle", wrapped))
    np.testing.assert_allclose(checked.data["joint_angle"].values[:, 0], angle, atol=1e-12)
    assert sentences == ["run: joint_angle_1 jumps by a whole turn 1 times; it is unwrapped."]


def test_bounds_are_relative_to_the_data_sheet():
    spec = arm_of(ONE).spec
    links = of_links(spec, [Label("strain", 1)])
    assert (links[RIGIDITY].lower, links[RIGIDITY].upper) == pytest.approx((2.4, 9.6))
    distance = links["links[0].gauges[0].distance"]
    assert (distance.lower, distance.upper) == pytest.approx((0.7e-3, 1.3e-3))
    assert "links[0].gauges[0].distance" not in of_links(spec, [])
    assert of_masses(spec)["payload.mass"].prior_deviation == pytest.approx(0.05 * 0.15)
    drives = of_drives(spec, None, [])
    assert set(drives) == {"joints[0].hub_inertia", "joints[0].damping"}
    assert of_drives(spec, None, [1]) == {}


def test_errors_of_records_are_free_parameters():
    """Planted: torque +0.01 N m, strain +2e-6, 5 % too large, one sample late."""
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    data["torque"] = data["torque"] + 0.01
    data["strain"] = 1.05 * data["strain"]
    data["strain"][1:] = data["strain"].values[:-1]
    data["strain"] = data["strain"] + 2e-6
    names = ("offsets.torque_1", "offsets.strain_1", "gains.strain_1", "delays.strain_1")
    measured = fa.MeasuredRecord(data, bench.settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fa.identify(
            arm_of(ONE),
            measured,
            [*names, "delays.torque"],
            validation={"same": measured},
            starts=1,
            progress=False,
        )
    table = found.parameters
    values = np.array([found[name] for name in names])
    deviations = table["standard_deviation"].values[:4]
    assert np.all(np.abs(values - [0.01, 2e-6, 1.05, 0.005]) < 4.0 * deviations)
    assert np.all(deviations < [1e-4, 2e-7, 5e-3, 3e-4])
    assert found["delays.torque"] < 5e-4
    np.testing.assert_allclose(found.validation["fit"], found.fit["fit"], atol=0.01)


def test_torques_that_act_before_their_record_have_a_negative_delay():
    """Planted: the record shows the torque one sample late (5 ms), and 5 % too large."""
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    data["torque"][1:] = 1.05 * data["torque"].values[:-1]
    measured = fa.MeasuredRecord(data, bench.settings)
    names = ["delays.torque", "gains.torque_1"]
    found = fa.identify(arm_of(ONE), measured, names, starts=1, progress=False)
    # The hold of the torque in the record is exact, so that the noise gives the errors.
    deviations = found.parameters["standard_deviation"].values
    values = np.array([found[name] for name in names])
    assert np.all(np.abs(values - [-0.005, 1.05]) < 4.0 * deviations)
    assert np.all(deviations < [3e-4, 5e-3])


@pytest.mark.thorough
def test_a_late_torque_is_not_taken_for_late_readings():
    """The joint turns freely for 3 s. Runs at ``rtol=1e-4`` err by eight times the resolution of
    the encoder there, and the strain was named late in place of the torque."""

    def build(rigidity, distance, coefficient, **joint):
        gauge = fa.Gauge(station=0.05, distance=distance)
        rod = {"length": 0.55, "mass_per_length": 0.5, "elements": 2, "gauges": [gauge]}
        rod["damping"] = fa.RayleighDamping(stiffness_coefficient=coefficient)
        link, joint = fa.Link(flexural_rigidity=rigidity, **rod), fa.Joint(**joint)
        return fa.Arm(links=[link], joints=[joint], payload=fa.Payload(mass=0.2))

    true = build(14.0, 1.5e-3, 9e-4, hub_inertia=0.02, damping=0.05, friction={"coulomb": 0.08})
    sheet = build(16.1, 1.65e-3, 5e-4, hub_inertia=0.023, damping=0.043)
    random, late = np.random.default_rng(3), 0.004
    hertz = 0.4 + 0.9 * np.arange(12) + random.uniform(0.0, 0.2, 12)
    phase = random.uniform(0.0, 2.0 * np.pi, 12)

    def torque(t):
        return [0.25 * min(1.0, t / 0.1) * np.sin(2.0 * np.pi * hertz * t + phase).sum()]

    run = fa.simulate(true, 3.0, torque=lambda t: torque(max(t - late, 0.0)), rate=500.0)
    data = run[["joint_angle", "strain", "torque"]].copy(deep=True)
    step = 2.0 * np.pi / 8192
    data["joint_angle"].values[:] = np.round(data["joint_angle"].values / step) * step
    data["strain"].values[:] += random.normal(0.0, 1.5e-6, data["strain"].shape)
    data["torque"].values[:] = [torque(t) for t in data["time"].values]
    data["torque"].values[:] += random.normal(0.0, 2e-3, data["torque"].shape)
    measured = fa.MeasuredRecord(data, outputs=["joint_angle", "strain"], interpolation="cubic")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)
        model = fa.commission(sheet, measured, progress=False)
    (sentence,) = [text for text in model.findings if "is late" in text]
    assert sentence.startswith("The torque is late by about 0.004")
    assert model[RIGIDITY] == pytest.approx(14.0, rel=0.02)
    assert model["joints[0].hub_inertia"] == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(("channel", "stated"), [("torque", 0.01), ("strain", 0.01)])
def test_errors_of_stated_delays_are_named_relative_to_them(channel, stated):
    """Planted: torque or strain are 5 ms late, and the settings say 10 ms."""
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    if channel == "torque":  # that of the record comes first
        data["torque"][:-1] = data["torque"].values[1:]
    else:
        data["strain"][1:] = data["strain"].values[:-1]
    measured = fa.MeasuredRecord(data, bench.settings.replace(delays={channel: stated}))
    name = "torque" if channel == "torque" else "strain_1"
    with pytest.warns(fa.AccuracyWarning, match=f"the stated delay of .*{name} is about"):
        found = fa.identify(arm_of(ONE), measured, ["joints[0].hub_inertia"], progress=False)
    (sentence,) = [text for text in found.missing if "stated delay" in text]
    size = float(re.search(r"about ([\d.]+) s too long", sentence)[1])
    assert size == pytest.approx(0.005, rel=0.03)  # of the fit with it, not the linear size
    table = found.parameters.isel(parameter=0)
    # The estimate with the effect, and the deviation that contains its change.
    change = float(table["with_effects"] - table["estimate"])
    assert float(table["standard_deviation"]) >= abs(change)
    assert float(table["with_effects"]) == pytest.approx(ONE.hub_inertia[0], rel=0.01)
    fitted = fa.identify(
        arm_of(ONE), measured, ["joints[0].hub_inertia", f"delays.{name}"], progress=False
    )
    assert fitted[f"delays.{name}"] == pytest.approx(-0.005, abs=2e-4)
    assert not any("delay" in text for text in fitted.missing)
    columns = ("estimate", "start", "standard_deviation")
    values = ([-0.005], [0.0], [1e-4])
    both = zip(columns, values, strict=True)
    named = xr.Dataset(
        {key: ("parameter", v) for key, v in both}, {"parameter": [f"delays.{name}"]}
    )
    whose = "the torque" if channel == "torque" else name
    assert findings_of(named, {channel}) == [
        f"The stated delay of {whose} is about 0.005 s too long."
    ]


def test_inputs_may_have_a_negative_stated_delay():
    """Of a record that shows the torque one sample late, without other faults."""
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    data["torque"][1:] = data["torque"].values[:-1]
    measured = fa.MeasuredRecord(data, bench.settings.replace(delays={"torque": -0.005}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fa.identify(arm_of(ONE), measured, ["joints[0].hub_inertia"], progress=False)
    assert float(found.fit["fit"].min()) > 90.0
    with pytest.raises(fa.InputError, match=r"delays.strain must be at least 0, got -0.005"):
        fa.MeasuredRecord(data, delays={"strain": -0.005})


@pytest.mark.parametrize(
    ("ends", "others", "words"),
    [((1.1, 1.1), (), "upper"), ((0.9, 0.9), (), "lower"), ((1.1, 0.9), (), None),
     ((1.1, 1.05), (), None), ((1.1, 1.1), ("gains.torque_1",), None),
     ((1.1, 1.1), ("gains.current_1",), None), ((1.1, 1.1), ("motors.torque_constant",), None)],
)  # fmt: skip
def test_masses_that_all_end_at_their_bounds_may_be_a_gain(ends, others, words):
    """The equations of motion scale with masses, stiffnesses and damping, as the torque does."""
    masses = ["links[0].mass_per_length", "payload.mass"]
    values = np.array(ends)
    columns = {"estimate": values, "start": np.ones(2), "at_bound": np.abs(values - 1.0) > 0.09}
    table = xr.Dataset({n: ("parameter", c) for n, c in columns.items()}, {"parameter": masses})
    sentences = alike_masses(table, dict.fromkeys([*masses, *others]))
    assert len(sentences) == (words is not None)
    assert words is None or f"All masses end at their {words} bounds" in sentences[0]


def test_readings_are_not_named_early():
    """A gauge 5 ms before its strain has another reason, such as a late encoder."""
    bench, arm = record(ONE.name, 1, end=1.0), arm_of(ONE)
    early = changed(bench, "strain", np.roll(bench.data["strain"].values[:, 0], -1))
    problem = FitProblem(
        Space(arm, None, [], {"run": early}), [RecordRun("run", early, arm, {})], None
    )
    outputs = problem.outputs(problem.space.start)
    fit = problem.fit(problem.space.start, outputs, True)
    columns, priors, _ = information_of(problem, fit)
    effects = missing_effects(problem, fit, columns, priors)
    assert effects
    assert not any(e.path == "delays.strain_1" for e in effects), effects


def test_derivatives_by_errors_of_records_are_those_of_differences():
    measured = record(ONE.name, None, end=0.5)
    names = ["gains.torque_1", "offsets.strain_1", "gains.strain_1", "links[0].gauges[0].distance"]
    space = Space(arm_of(ONE), None, check_free(names), {"run": measured})
    problem = FitProblem(space, [RecordRun("run", measured, arm_of(ONE), {})], None)
    vector = space.start.copy()
    vector[:4] += [0.1, 1e-5, 0.2, 1e-4]
    (slopes,) = problem.derivatives(vector)
    for k in range(len(names)):
        step = 1e-3 * space.scale[k] * np.eye(vector.size)[k]
        (after,), (before,) = (problem.outputs(vector + s * step) for s in (1.0, -1.0))
        slope = (after - before) / (2.0 * step[k])
        size = np.abs(slope).max(axis=0)
        # Linear, or differences whose change of the outputs, 5e-3, has an error near its square.
        assert np.all(
            np.abs(slopes[..., k] - slope).max(axis=0) <= 1e-4 * size + 1e-12 * size.max()
        )


def test_no_free_parameter_scores_the_arm():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fa.identify(arm_of(ONE), record(ONE.name, 1, end=0.5), [], progress=False)
    assert found.parameters.sizes["parameter"] == 0
    assert found.fit["fit"].min() > 90.0
    again = fa.Identification.from_dataset(found.to_dataset())
    assert str(again) == str(found)
    assert "joint_angle_1" in fa.report(again.to_dataset())


@pytest.mark.thorough
def test_commissioning_from_a_wrong_data_sheet():
    """Values wrong by up to 20 %, friction, coloured noise; a record of other torques is unseen."""
    unseen = record(f"{ONE.name}_other", 3, end=2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fa.commission(
            believed(ONE, 1), rough_record(ONE, 1, end=2.0), validation=unseen, progress=False
        )
    assert any("Joint 1 stops early: Coulomb friction" in text for text in found.findings)
    stages = found.stages
    assert stages["stage"].values[0] == "data sheet"
    assert bool(stages.kept.sel(stage="together"))
    judged = stages.isel(stage=np.flatnonzero(stages.kept))
    assert np.all(judged.after[-1] > judged.after[0])
    for path in (RIGIDITY, "links[0].gauges[0].distance", "joints[0].hub_inertia"):
        assert found[path] == pytest.approx(truth(ONE, path), rel=0.1)
    assert found.parameters["start"].sel(parameter=RIGIDITY) == pytest.approx(
        believed(ONE, 1).spec.links[0].flexural_rigidity
    )
    again = fa.Identification.from_dataset(found.to_dataset())
    assert str(again) == str(found)
    page = fa.report(found.to_dataset())
    assert "stops early" in page
    assert "data sheet" in page


@pytest.mark.thorough
def test_effects_that_have_no_meaning_together_are_left_out():
    # Alone, friction explains residuals of this record; beside a gain it would be negative.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fa.commission(data_sheet("gain", 8), faulty_record("gain", 8, 2.0), progress=False)
    assert names_fault(found, "gain")


@pytest.mark.thorough
@pytest.mark.parametrize("fault", [kind for kind in FAULTS if kind not in UNSEEN[ONE.name]])
def test_planted_faults_are_named(fault):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        measured = faulty_record(fault, 1, 2.0)
        found = fa.commission(data_sheet(fault, 1), measured, progress=False)
    assert names_fault(found, fault), [*found.findings, *found.missing]


@pytest.mark.parametrize(
    ("progress", "spent", "lines"),
    [(None, 11.0, 1), (None, 1.0, 0), (False, 11.0, 0), (True, 1.0, 1)],
)
def test_long_stages_print_a_line_without_a_terminal(capsys, progress, spent, lines):
    """A script whose output goes to a file would otherwise be silent for minutes."""
    work = _Commissioning(arm_of(ONE), {}, None, {}, progress)
    score = {("first", "strain_1"): (1e-6, 90.0)}
    work._add("links", score, score, True, time.process_time() - spent)
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == lines
    assert all(line.startswith("links  90.0") for line in printed)
