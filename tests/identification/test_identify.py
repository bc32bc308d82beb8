"""Identification of arms whose records come from MuJoCo, and of every kind of input."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from data.bench_records import ONE
from data.geared_bench import THREE
from identification.benches import (
    DATA,
    FREE,
    NOISE,
    OPTIONS,
    arm_of,
    believed,
    names_unclear,
    record,
    truth,
)  # fmt: skip

pytestmark = pytest.mark.compiled

RIGIDITY = "links[0].flexural_rigidity"


def short(name=ONE.name, seed=1, end=1.5, **settings):
    return record(name, seed, end=end, **settings)


def errors(found, bench, free):
    """Return the errors of the estimates in their stated standard deviations."""
    deviations = found.parameters["standard_deviation"].values
    return (np.array([found[path] - truth(bench, path) for path in free])) / deviations


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2])
def test_one_link_is_recovered_within_the_stated_deviations(seed):
    free = FREE[ONE.name]
    found = fa.identify(believed(ONE, seed), record(ONE.name, seed, end=3.0), free, progress=False)
    assert found.converged
    assert found.undetermined == ()
    # Six normal numbers: all below 3.5 in 997 of 1000 seeds.
    assert np.abs(errors(found, ONE, free)).max() < 3.5
    assert found.noise["joint_angle_1"] == pytest.approx(NOISE["joint_angle"], rel=0.1)
    assert np.all(found.fit["whiteness"] > 1e-3)
    assert np.all(found.parameters["standard_deviation"] < 0.1 * found.parameters["estimate"])


@pytest.mark.thorough
def test_a_record_that_was_not_fitted_is_predicted(tmp_path):
    other = record("bench_one_link_other", 5)
    found = fa.identify(
        believed(ONE),
        record(ONE.name, 4, end=3.0),
        FREE[ONE.name],
        validation=other,
        progress=False,
    )
    # Perfect but for the noise, which is what remains of the fit.
    np.testing.assert_allclose(found.validation["rms"], [list(NOISE.values())[:2]], rtol=0.15)
    assert np.all(found.validation["fit"] > 95.0)
    assert found.histories["validation 1"].sizes["channel"] == 2
    found.write(tmp_path / "bench.yaml")
    again = fa.load_arm(tmp_path / "bench.yaml")
    assert again.spec == found.arm.spec
    assert again.spec.links[0].flexural_rigidity == found[RIGIDITY]


# The data sheet has a wrong distance of the gauge, which acts as a gain of its strain.
@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:The residuals show a relative error:flexarm.AccuracyWarning")
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_parameters_that_cannot_be_determined_are_named(seed):
    free = [RIGIDITY, "joints[0].hub_inertia", "joints[0].rotor_inertia", "joints[0].mass"]
    spec = believed(ONE, seed, elements=2).spec
    joint = spec.joints[0].replace(rotor_inertia=0.002, mass=0.3)
    with pytest.warns(fa.IdentifiabilityWarning) as caught:
        found = fa.identify(
            fa.Arm(spec.replace(joints=[joint])), short(seed=seed), free, progress=False
        )
    assert len(found.undetermined) == 2, found.undetermined
    together, alone = sorted(found.undetermined, key=len, reverse=True)
    assert "hub inertia of joint 1" in together
    assert "rotor inertia of joint 1" in together
    assert "flexural rigidity" not in together
    assert alone.startswith("The data do not determine the mass of joint 1")
    assert caught[0].filename == __file__


def test_a_fit_that_has_not_converged_says_so():
    arm, measured = believed(ONE), short(end=0.6)
    with pytest.warns(fa.ConvergenceWarning, match="has not converged. Raise iterations"):
        fit = fa.identify(arm, measured, [RIGIDITY], iterations=2, progress=False)
    assert not fit.converged
    assert "The fit has not converged." in str(fit)


@pytest.mark.filterwarnings("ignore::flexarm.IdentifiabilityWarning")
def test_iterations_limit_all_rounds_together(monkeypatch):
    """The noise is estimated anew in up to six rounds, each of which is a fit of its own."""
    from flexarm.identification.fitting import FitProblem

    counts = []
    evaluate = FitProblem.residuals

    def counted(self, scaled):
        counts.append(1)
        return evaluate(self, scaled)

    monkeypatch.setattr(FitProblem, "residuals", counted)
    with pytest.warns(fa.ConvergenceWarning):
        fa.identify(believed(ONE), short(end=0.6), FREE[ONE.name], iterations=5, progress=False)
    assert sum(counts) <= 5


# Of a record of 1.5 s, rigidity and distance of the gauge have an effect together.
@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:Another arm fits:flexarm.IdentifiabilityWarning")
def test_a_geared_link_of_exudyn_is_recovered():
    """Ten parameters of an elastic drive with friction in gravity; the pair of rotor inertia and
    gear ratio, of which only a product acts, is named."""
    free = FREE[THREE.name]
    measured = record(THREE.name, 4, end=1.5)
    arm = believed(THREE, 4, elements=2)
    found = fa.identify(arm, measured, free, progress=False, **OPTIONS[THREE.name])
    assert found.undetermined == ()
    # Ten normal numbers: all below 3.5 in 995 of 1000 seeds.
    assert np.abs(errors(found, THREE, free)).max() < 3.5
    assert names_unclear(found.arm, THREE, measured)


def test_a_prior_determines_what_data_do_not():
    free = ["joints[0].hub_inertia", fa.FreeParameter("joints[0].mass", prior_deviation=0.1)]
    spec = arm_of(ONE).spec
    arm = fa.Arm(spec.replace(joints=[spec.joints[0].replace(mass=0.3)]))
    with pytest.warns(fa.IdentifiabilityWarning, match="mass of joint 1"):
        found = fa.identify(arm, short(), free, progress=False)
    assert found["joints[0].mass"] == pytest.approx(0.3, abs=1e-6)
    assert found.parameters["standard_deviation"][1] == pytest.approx(0.1, rel=1e-6)


@pytest.mark.thorough
def test_records_may_start_in_motion():
    """The middle of a record alone: angle, rate and the first modes are estimated."""
    free = [RIGIDITY, "payload.mass"]
    cut = record(ONE.name, 3, start=2.0, end=4.0, initial="estimate")
    arm = fa.varied(arm_of(ONE), flexural_rigidity_factor=1.1)
    found = fa.identify(arm, cut, free, progress=False)
    assert np.abs(errors(found, ONE, free)).max() < 4.0
    assert found.initial.sizes["parameter"] == 6
    at_rest = record(ONE.name, 3, start=2.0, end=4.0)
    with warnings.catch_warnings():  # large residuals leave the payload undetermined
        warnings.simplefilter("ignore", fa.IdentifiabilityWarning)
        warnings.simplefilter("ignore", fa.AccuracyWarning)  # the angle drifts
        wrong = fa.identify(arm, at_rest, free, progress=False)
    assert np.all(wrong.fit["fit"] < found.fit["fit"] - 5.0)


@pytest.mark.thorough
def test_a_strongly_damped_link_is_recovered():
    """Derivatives of runs at 1e-4 are wrong by three times their values here."""

    def build(rigidity):
        damping = fa.RayleighDamping(stiffness_coefficient=0.01)
        gauge = fa.Gauge(station=0.05, distance=1e-3)
        link = fa.Link(
            length=1.0, flexural_rigidity=rigidity, mass_per_length=0.6, elements=2, modes=2,
            gauges=[gauge], damping=damping,
        )  # fmt: skip
        return fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)])

    torque = fa.multisine(0.25, (4.0, 24.0), 1.0, rise=0.05).samples(200.0, 1.0)
    run = fa.simulate(build(112.0), 1.0, torque=torque, rate=200.0, rtol=1e-9, progress=False)
    record, rng = run[["torque", "joint_angle", "strain"]].copy(deep=True), np.random.default_rng(0)
    record["joint_angle"] = record.joint_angle + 1e-4 * rng.standard_normal((201, 1))
    record["strain"] = record.strain + 1e-7 * rng.standard_normal((201, 1))
    free = ["links[0].flexural_rigidity", "joints[0].hub_inertia"]
    found = fa.identify(build(100.0), record, free, progress=False, starts=1).parameters
    away = (found.estimate - [112.0, 0.05]) / found.standard_deviation
    assert np.abs(away).max() < 3.0


def test_values_of_single_records_and_random_starts():
    heavy = fa.varied(arm_of(ONE), payload_factor=1.5)
    data = record(ONE.name, 1).data
    run = fa.simulate(
        heavy, 1.5, torque=data["torque"].values, rate=200.0, torque_interpolation="hold"
    )
    second = fa.MeasuredRecord(run, interpolation="hold", outputs=["joint_angle", "strain"])
    free = [RIGIDITY, fa.FreeParameter("payload.mass", per_record=True, lower=0.01, upper=1.0)]
    records = {"light": short(), "heavy": second}
    arm = fa.varied(arm_of(ONE), flexural_rigidity_factor=1.05)
    found = fa.identify(arm, records, free, starts=2, progress=False)
    assert found["payload.mass (light)"] == pytest.approx(ONE.payload, rel=0.02)
    assert found["payload.mass (heavy)"] == pytest.approx(1.5 * ONE.payload, rel=0.02)
    assert found.arms["heavy"].spec.payload.mass == found["payload.mass (heavy)"]
    assert len(found.starts) == 2
    assert found["links[0].flexural_rigidity"] == pytest.approx(8.0, rel=0.01)


@pytest.mark.thorough
def test_currents_drive_the_arm_through_the_torque_constant():
    given = short(filters={"strain": [fa.Filter("high_pass", cutoff=0.2)]})
    current = given.data["torque"] / 0.07
    data = given.data.drop_vars("torque").assign(current=current)
    bench = fa.MeasuredRecord(data, given.settings)
    free = ["motors.torque_constant", "joints[0].damping"]
    motors = fa.Motors(torque_constant=0.06)
    found = fa.identify(arm_of(ONE), bench, free, motors=motors, progress=False)
    assert found.motors.torque_constant == found["motors.torque_constant"]
    assert found["motors.torque_constant"] == pytest.approx(0.07, rel=5e-3)
    with pytest.raises(fa.InputError, match="torque_constant are required for the currents"):
        fa.identify(arm_of(ONE), bench, free[1:])


def test_voltages_drive_the_arm_through_its_winding():
    """Constant and resistance of a motor from its voltage and the joint angle, inertia known."""

    def motor(constant, resistance):
        winding = fa.Winding(torque_constant=constant, resistance=resistance)
        joint = fa.Joint(rotor_inertia=2e-5, gear_ratio=80.0, winding=winding)
        link = fa.Link(length=1.0, mass_per_length=0.9, flexible=False)
        return fa.Arm(links=[link], joints=[joint])

    times = np.arange(401) / 200.0
    volts = 6.0 * np.sin(5.0 * times)[:, None] + 3.0 * np.sin(11.0 * times)[:, None]
    true = motor(0.04, 1.5)
    run = fa.simulate(true, 2.0, torque=true.motor_torque(volts), rate=200.0)
    data = run[["joint_angle"]].assign(voltage=(("time", "joint"), volts))
    bench = fa.MeasuredRecord(data, interpolation="cubic")
    assert bench.input == "voltage"
    free = [f"joints[0].winding.{name}" for name in ("torque_constant", "resistance")]
    found = fa.identify(motor(0.05, 1.2), bench, free, progress=False)
    assert found[free[0]] == pytest.approx(0.04, rel=1e-4)  # the record has no noise
    assert found[free[1]] == pytest.approx(1.5, rel=1e-4)
    with pytest.raises(fa.InputError, match="not every joint has a winding"):
        fa.identify(fa.Arm(true.spec.replace(joints=[fa.Joint()])), bench, ["payload.mass"])


@pytest.mark.filterwarnings("ignore:The residuals show")  # the mesh: 0.8 % of the strain
def test_prescribed_joints_follow_their_measured_angles():
    free = [RIGIDITY, "payload.mass"]
    settings = {"prescribed": [1], "outputs": ("joint_angle", "strain"), "prescribed_cutoff": 40.0}
    followed = fa.MeasuredRecord(
        fa.read_record(DATA / "bench_one_link.csv", end=1.5).data, **settings
    )
    assert [label.text for label in followed.outputs] == ["strain_1"]
    found = fa.identify(arm_of(ONE), followed, free, progress=False)
    # The rigidity has no effect on the ratio of strain and motion other than by the frequency.
    assert np.abs(found[RIGIDITY] / 8.0 - 1.0) < 0.02
    assert float(found.fit["fit"].min()) > 95.0


def test_a_known_controller_drives_the_arm():
    arm = arm_of(ONE)
    motion = fa.joint_motion(arm, [0.0], [0.8], 0.4)
    pd = fa.JointPD([6.0], [0.6], sample_time=0.005)
    result = fa.simulate(arm, 0.8, controller=pd, reference=motion, rate=200.0)
    driven = fa.MeasuredRecord(
        result, outputs=["joint_angle", "strain"], controller=pd, reference=motion
    )
    believed_arm = fa.varied(arm, flexural_rigidity_factor=1.1)
    found = fa.identify(believed_arm, driven, [RIGIDITY], progress=False)
    # The controller's model has no effect here, and the record has no noise.
    assert found[RIGIDITY] == pytest.approx(8.0, rel=1e-4)


@pytest.fixture(scope="module")
def closed_loop():
    """Result of a closed loop sampled twice per sample time of its controller."""
    arm = arm_of(ONE)
    motion = fa.joint_motion(arm, [0.0], [0.8], 0.4)
    pd = fa.JointPD([6.0], [0.6], sample_time=0.01)
    return fa.simulate(arm, 0.8, controller=pd, reference=motion, rate=200.0)


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", ["", ".nc"])
def test_the_torque_of_a_closed_loop_is_a_zero_order_hold(closed_loop, suffix, tmp_path):
    record = closed_loop
    if suffix:
        fa.write_result(closed_loop, tmp_path / f"run{suffix}")
        record = fa.read_record(tmp_path / f"run{suffix}", outputs=["joint_angle", "strain"])
    found = fa.identify(
        fa.varied(arm_of(ONE), flexural_rigidity_factor=1.1), record, [RIGIDITY], progress=False
    )
    assert found[RIGIDITY] == pytest.approx(8.0, rel=1e-5)  # without noise


@pytest.mark.filterwarnings("ignore:The residuals show")
def test_steps_of_the_torque_between_samples_are_warned_of(closed_loop):
    with pytest.warns(fa.AccuracyWarning, match="lower than that of its controller, 100 Hz"):
        fa.identify(
            fa.varied(arm_of(ONE), flexural_rigidity_factor=1.1),
            closed_loop.isel(time=slice(None, None, 4)),
            [RIGIDITY],
            progress=False,
        )


def test_arms_in_gravity_start_in_equilibrium():
    spec = arm_of(ONE).spec.replace(gravity=(0.0, -9.81))
    arm = fa.Arm(spec)
    start = fa.equilibrium(arm, [0.4])
    torque = start.torque + 0.3 * np.sin(6.0 * np.arange(161) / 200.0)[:, None]
    result = fa.simulate(arm, 0.8, torque=torque, rate=200.0, initial=start.q)
    bench = fa.MeasuredRecord(result, outputs=["joint_angle", "strain"], initial="equilibrium")
    found = fa.identify(
        fa.varied(arm, flexural_rigidity_factor=1.2), bench, [RIGIDITY], progress=False
    )
    assert found[RIGIDITY] == pytest.approx(8.0, rel=1e-4)


@pytest.mark.thorough
def test_failed_runs_are_rejected_steps(monkeypatch):
    """A step into values whose run fails is shortened, and the fit goes on."""
    from flexarm.identification import runs

    simulate, failed = runs.RecordRun.simulate, []

    def fails(self, cases):
        found = simulate(self, cases)
        for k, case in enumerate(cases):
            if case.spec.links[0].flexural_rigidity > 8.4:
                failed.append(case)
                found[k] = "stopped"
        return found

    monkeypatch.setattr(runs.RecordRun, "simulate", fails)
    arm = fa.varied(arm_of(ONE), flexural_rigidity_factor=0.8)
    found = fa.identify(arm, short(), [RIGIDITY], progress=False)
    assert found[RIGIDITY] == pytest.approx(8.0, rel=0.01)
    too_stiff = fa.varied(arm_of(ONE), flexural_rigidity_factor=1.2)
    with pytest.raises(fa.SimulationError, match="no start of the fit can be simulated"):
        fa.identify(too_stiff, short(), [RIGIDITY], progress=False)
    assert failed


@pytest.mark.thorough
def test_a_vector_without_derivatives_ends_the_search_at_the_one_before(monkeypatch):
    from flexarm.identification import fitting

    derivatives, failed = fitting.output_derivatives, []

    def fails(run, space, record, vector, places):
        if vector[0] > 7.0:
            failed.append(vector[0])
            return "stopped"
        return derivatives(run, space, record, vector, places)

    monkeypatch.setattr(fitting, "output_derivatives", fails)
    arm = fa.varied(arm_of(ONE), flexural_rigidity_factor=0.8)
    with pytest.warns(fa.ConvergenceWarning):
        found = fa.identify(arm, short(), [RIGIDITY], progress=False)
    assert failed
    assert not found.converged
    assert 6.4 <= found[RIGIDITY] <= 7.0
    assert np.isfinite(found.parameters["standard_deviation"]).all()
    with pytest.raises(fa.SimulationError, match=r"simulated\. record 1: stopped"):
        fa.identify(arm_of(ONE), short(), [RIGIDITY], progress=False)


@pytest.mark.thorough
def test_outliers_count_little_with_a_robust_loss():
    bench = short()
    data = bench.data.copy(deep=True)
    data["strain"][40:300:20] += 3e-4
    spoiled = fa.MeasuredRecord(data, bench.settings)
    arm = fa.varied(arm_of(ONE), flexural_rigidity_factor=1.1)
    plain, robust = (
        fa.identify(arm, spoiled, [RIGIDITY], loss=loss, progress=False)[RIGIDITY]
        for loss in ("linear", "soft_l1")
    )
    assert abs(robust - 8.0) < 0.02
    assert abs(robust - 8.0) < abs(plain - 8.0)


@pytest.mark.thorough
def test_filters_of_the_instruments_do_not_bias_the_estimates():
    """A record that has passed a filter, fitted with and without telling so."""
    bench = short()
    slow = fa.Filter("low_pass", cutoff=10.0, order=2, recorded=True)
    from flexarm.identification.record import Path

    data = bench.data.copy(deep=True)
    every = np.ones(bench.times.size, dtype=bool)
    own = Path(bench.times, every, 0.0, [fa.Filter("low_pass", cutoff=10.0, order=2)])
    data["strain"][:, 0] = own.measured(data["strain"].values[:, 0])
    free = [RIGIDITY, "links[0].gauges[0].distance"]
    told = fa.MeasuredRecord(data, bench.settings.replace(filters={"strain": [slow]}))
    found = fa.identify(arm_of(ONE), told, free, progress=False)
    plain = fa.MeasuredRecord(data, bench.settings)
    with pytest.warns(fa.ConvergenceWarning):  # the noise of the strain changes in every round
        wrong = fa.identify(arm_of(ONE), plain, free, progress=False)
    assert found[free[1]] == pytest.approx(1e-3, rel=0.01)
    assert abs(wrong[free[1]] / 1e-3 - 1.0) > 0.02


def test_progress_shows_the_fit_of_each_channel(capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fa.identify(arm_of(ONE), short(end=0.3), [RIGIDITY], progress=True)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("evaluation 1: ")
    assert "joint_angle_1" in lines[0]
    assert "strain_1" in str(found)


@pytest.mark.thorough
def test_a_record_in_wrong_units_is_reported():
    """Degrees read as radians: the best rigidity is far off."""
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5)])
    times = np.arange(101) / 100.0
    run = fa.simulate(arm, 1.0, torque=0.5 * np.sin(3.0 * times)[:, None], rate=100.0)
    wrong = run[["torque", "joint_angle"]].copy()
    wrong["joint_angle"] = np.rad2deg(wrong["joint_angle"])
    with (
        pytest.warns(fa.AccuracyWarning, match=r"joint_angle_1 of record 1 .*Check units"),
        pytest.warns(fa.IdentifiabilityWarning, match="do not determine the flexural rigidity"),
    ):
        fa.identify(arm, wrong, free=["links[0].flexural_rigidity"])


def test_a_record_without_torque_determines_nothing():
    given = short(end=0.5)
    still = fa.MeasuredRecord(given.data.drop_vars("torque"), given.settings.replace(input="none"))
    with pytest.warns() as caught:
        found = fa.identify(arm_of(ONE), still, [RIGIDITY, "payload.mass"], progress=False)
    (sentence,) = found.undetermined
    text = "determine the flexural rigidity of link 1 and mass of the payload: their standard"
    assert text in sentence
    assert np.all(found.parameters["standard_deviation"] > 10.0 * found.parameters["estimate"])
    texts = [str(one.message) for one in caught]
    assert any("No torque, current or voltage drives record 1." in text for text in texts)


def test_an_unknown_parameter_of_a_result_names_the_nearest():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fa.identify(arm_of(ONE), short(end=0.1), ["payload.mass"], iterations=1)
    with pytest.raises(fa.InputError, match=r"have no 'payload.mas'. Did you mean 'payload.mass'"):
        found["payload.mas"]
    with pytest.raises(fa.InputError, match=r"Known: payload.mass\."):
        found["x"]
