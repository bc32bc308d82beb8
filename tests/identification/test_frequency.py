"""Frequency responses and modes from records: python-control, closed forms, known noise."""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import chirp

import flexarm as fa
from arms import chain
from flexarm.identification.frequency.fit import assurance

pytestmark = pytest.mark.compiled

RATE = 200.0


def one_link(**changes):
    """Return a damped link on a free joint."""
    link = {
        "length": 0.8,
        "flexural_rigidity": 8.0,
        "mass_per_length": 0.35,
        "elements": 3,
        "damping": fa.RayleighDamping(stiffness_coefficient=8e-4),
        "gauges": [fa.Gauge(station=0.06, distance=1e-3)],
    }
    joint = fa.Joint(hub_inertia=changes.pop("hub_inertia", 0.02), damping=0.2)
    return fa.Arm(links=[fa.Link(**link | changes)], joints=[joint], payload=fa.Payload(mass=0.15))


def two_links():
    rod = {"flexural_rigidity": [22.0, 6.0], "mass_per_length": 0.4, "elements": 1}
    damping = fa.RayleighDamping(stiffness_coefficient=2e-3)
    joints = [fa.Joint(hub_inertia=0.03, damping=0.4), fa.Joint(hub_inertia=0.01, damping=0.1)]
    return chain((0.7, 0.5), joints, damping=damping, gauge=(0.05, 1e-3), **rod)


def run(arm, torque, duration, rate=RATE):
    samples = torque.samples(rate, duration)
    return fa.simulate(
        arm, duration, torque=samples, rate=rate, torque_interpolation="hold", progress=False
    )


def measured(result, outputs=("joint_angle", "strain"), **settings):
    return fa.MeasuredRecord(result, interpolation="hold", outputs=outputs, **settings)


def from_control(arm, hertz, outputs=("joint_angle", "strain")):
    """Return the response (F, outputs, inputs) of the linear model, by python-control."""
    control = pytest.importorskip("control")
    model = fa.linearize(arm, outputs=list(outputs))
    system = control.ss(model.A, model.B, model.C, model.D)
    return np.moveaxis(system(2j * np.pi * hertz, squeeze=False), -1, 0)


@pytest.fixture(scope="module")
def shaken():
    """An arm, a multisine of 0.5 to 30 Hz, and a result in steady state but for its drift."""
    arm, torque = one_link(), fa.multisine(4.0, (0.5, 30.0), 0.003, rise=0.5)
    return arm, torque, run(arm, torque, 32.0)


def test_a_multisine_has_its_lines_its_peak_and_a_low_crest(shaken):
    _, torque, _ = shaken
    times = np.arange(4000) * 4.0 / 4000
    steady = torque(times + 4.0)[:, 0]
    lines = np.abs(np.fft.rfft(steady)) / 2000
    assert np.flatnonzero(lines > 1e-9).tolist() == list(range(2, 121))
    np.testing.assert_allclose(lines[2:121], lines[2], rtol=1e-9)
    # The peak is found on a grid of 16 points for each period of the highest sine.
    assert np.abs(steady).max() == pytest.approx(0.003, rel=0.02)
    # Phases at random have a crest factor of 3 to 4.
    assert np.abs(steady).max() / np.sqrt(np.mean(steady**2)) < 1.9
    assert torque(0.0) == 0.0
    assert torque.breaks == (0.5,)
    np.testing.assert_array_equal(torque.samples(100.0, 1.0), torque(np.arange(101) / 100.0))
    assert np.ptp(torque(np.array([7.3, 11.3]))) < 1e-15


def test_a_multisine_response_is_that_of_the_linear_model(shaken):
    arm, torque, result = shaken
    found = fa.frequency_response(measured(result), period=4.0, start=20.0)
    np.testing.assert_allclose(found.frequency_hz, torque.frequency_hz)
    assert found.inputs == ("torque_1",)
    assert found.outputs == ("joint_angle_1", "strain_1")
    exact = from_control(arm, found.frequency_hz)
    # Images of the zero-order hold at 170 Hz and above, and motion that is not quite small.
    np.testing.assert_allclose(found.response, exact, rtol=0.02)
    assert np.median(np.abs(found.response / exact - 1.0)) < 1.5e-3
    assert found.coherence.min() > 0.999


def test_a_wrong_period_is_reported(shaken):
    _, _, result = shaken
    with pytest.warns(fa.AccuracyWarning, match=r"do not repeat after the period of 3 s: .* %"):
        fa.frequency_response(measured(result), period=3.0, start=20.0)


def test_delays_and_recorded_filters_are_removed(shaken):
    _, _, result = shaken
    plain = fa.frequency_response(measured(result), period=4.0, start=20.0)
    late = result[["torque", "joint_angle", "strain"]].copy(deep=True)
    late["strain"][1:] = result["strain"].values[:-1]
    slow = fa.Filter("low_pass", cutoff=15.0, order=2)
    from flexarm.identification.record import Path

    path = Path(late["time"].values, np.ones(late.sizes["time"], bool), 0.0, [slow])
    late["strain"][:, 0] = path.measured(late["strain"].values[:, 0])
    recorded = slow.replace(recorded=True)
    settings = {"delays": {"strain": 1.0 / RATE}, "filters": {"strain": [recorded]}}
    found = fa.frequency_response(measured(late, **settings), period=4.0, start=20.0)
    # The transient of the filter has decayed; the period is exact.
    np.testing.assert_allclose(found.response, plain.response, rtol=1e-6)
    wrong = fa.frequency_response(measured(late), period=4.0, start=20.0)
    assert np.abs(wrong.response[-1, 1, 0] / plain.response[-1, 1, 0] - 1.0) > 0.5


def test_a_drift_from_period_to_period_is_removed(shaken):
    """A joint without friction keeps turning."""
    _, _, result = shaken
    turning = result[["torque", "joint_angle", "strain"]].copy(deep=True)
    turning["joint_angle"][:, 0] += 0.4 + 0.02 * turning["time"].values
    found = fa.frequency_response(measured(turning), period=4.0, start=20.0)
    plain = fa.frequency_response(measured(result), period=4.0, start=20.0)
    np.testing.assert_allclose(found.response, plain.response, rtol=1e-6)


def noisy(result, seed, deviations):
    random = np.random.default_rng(seed)
    data = result[["torque", *deviations]].copy(deep=True)
    for name, deviation in deviations.items():
        data[name] = data[name] + deviation * random.standard_normal(data[name].shape)
    return data


def test_the_stated_deviations_are_those_of_the_noise(shaken):
    _, _, result = shaken
    exact = fa.frequency_response(measured(result), period=4.0, start=20.0)
    scores = []
    for seed in range(10):
        data = noisy(result, seed, {"joint_angle": 2e-6, "strain": 2e-8})
        found = fa.frequency_response(measured(data), period=4.0, start=20.0)
        assert found.averages == 3.0
        scores.append(np.abs(found.response - exact.response) ** 2)
        variance = found.deviation**2
        assert found.coherence.min() < 0.999
    # Mean of 10 x 119 squared errors over the mean of 119 variances of 2 degrees of freedom each:
    # a relative deviation of 0.03 and 0.07.
    ratio = np.mean(scores, axis=(0, 1)) / np.mean(variance, axis=0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)


def test_one_average_has_no_coherence(shaken):
    _, _, result = shaken
    data = noisy(result, 0, {"strain": 1e-5})
    found = fa.frequency_response(measured(data, ["strain"]), period=4.0, start=28.0)
    assert found.averages == 1.0
    assert np.isnan(found.deviation).all()
    assert np.isnan(found.coherence).all()
    assert "coherence unknown>" in repr(found)
    # The noise hides all but the resonances.
    with pytest.warns(fa.AccuracyWarning, match=r"strain_1 to torque_1 \(.* %\); 100 %"):
        assert found.modes(1).fit.max() < 50.0


def test_voltages_are_inputs():
    """The response to the voltage is that to the torque at standstill, times its constant."""
    winding = fa.Winding(torque_constant=0.04, resistance=1.5)
    spec = one_link(elements=1).spec
    joint = spec.joints[0].replace(winding=winding, gear_ratio=5.0)
    arm = fa.Arm(spec.replace(joints=[joint]))
    volts = fa.multisine(1.0, (2.0, 20.0), 0.2, rise=0.2).samples(RATE, 4.0)
    given = {"rate": RATE, "torque_interpolation": "hold", "progress": False}
    result = fa.simulate(arm, 4.0, torque=arm.motor_torque(volts), **given)
    data = result[["strain"]].assign(voltage=result["torque"].copy(data=volts))
    found = fa.frequency_response(measured(data, ["strain"]), period=1.0, start=2.0)
    assert found.inputs == ("voltage_1",)
    torque = fa.frequency_response(measured(result, ["strain"]), period=1.0, start=2.0)
    factor = 5.0 * 0.04 / 1.5
    np.testing.assert_allclose(found.response, factor * torque.response, rtol=1e-9)


def test_sweeps_are_transformed_in_segments():
    arm, rate, duration = one_link(), 400.0, 60.0
    times = np.arange(int(duration * rate) + 1) / rate
    sweep = 0.003 * chirp(times, 0.5, duration, 30.0)[:, None]
    given = {"rate": rate, "torque_interpolation": "hold", "progress": False}
    result = fa.simulate(arm, duration, torque=sweep, **given)
    found = fa.frequency_response(measured(result, ["strain"]), segment=10.0, band=(3.0, 25.0))
    exact = from_control(arm, found.frequency_hz, ["strain"])
    # Leakage of Hann's window at resonances: the decay time is 0.6 s, a segment 10 s.
    errors = np.abs(found.response / exact - 1.0)
    assert errors.max() < 0.1
    assert np.median(errors) < 0.02
    assert found.coherence.min() > 0.95
    modes = found.modes(2)
    exact = vibrations(fa.modes(arm, joints="free"))[0]
    np.testing.assert_allclose(modes.frequency_hz, exact, rtol=2e-3)


def test_two_joints_need_two_experiments():
    arm = two_links()
    torque = fa.multisine(2.0, (0.5, 30.0), [0.004, 0.001], rise=0.5)
    records = [measured(run(arm, one, 16.0)) for one in torque.orthogonal()]
    found = fa.frequency_response(records, period=2.0, start=10.0)
    assert found.response.shape == (60, 4, 2)
    exact = from_control(arm, found.frequency_hz)
    size = np.abs(exact).max(axis=(0, 2))[:, None]
    assert np.max(np.abs(found.response - exact) / size) < 0.01
    model = fa.modes(arm, joints="free")
    compared = found.modes(2, band=(1.5, 30.0)).compare(model)
    assert compared["match"].values.tolist() == [3, 4]
    assert np.all(np.diag(compared["mac"].sel(model=[3, 4])) > 0.999)
    # Dampers of 10 and 20 %: the second rigid pole is approximated by powers of s.
    assert np.abs(compared["frequency_error"]).max() < 0.1
    assert np.abs(compared["damping_error"]).max() < 0.5
    with pytest.raises(fa.InputError, match=r"do not distinguish .* Multisine.orthogonal"):
        fa.frequency_response(records[0], period=2.0, start=10.0)


def vibrations(model):
    """Return moduli (Hz) and damping ratios of the eigenvalues of the first two vibrations."""
    size = np.abs(model.eigenvalues[1:3])
    return size / (2.0 * np.pi), -model.eigenvalues[1:3].real / size


def test_modes_are_those_of_the_model(shaken):
    arm, _, result = shaken
    model = fa.modes(arm, joints="free")
    found = fa.frequency_response(measured(result), period=4.0, start=20.0).modes(
        2, band=(1.0, 30.0)
    )
    assert found.fit.min() > 99.5
    exact = vibrations(model)
    # The motion is not quite small, and the hold has images.
    np.testing.assert_allclose(found.frequency_hz, exact[0], rtol=2e-4)
    np.testing.assert_allclose(found.damping_ratio, exact[1], rtol=5e-3)
    np.testing.assert_allclose(found.poles, model.eigenvalues[1:3], rtol=5e-4)
    compared = found.compare(model)
    assert compared["match"].values.tolist() == [2, 3]
    assert np.all(np.diag(compared["mac"].sel(model=[2, 3])) > 0.9999)
    assert np.all(np.abs(compared["frequency_error"]) < 0.02)
    wrong = found.compare(fa.modes(one_link(flexural_rigidity=16.0), joints="free"))
    np.testing.assert_allclose(wrong["frequency_error"].values > 20.0, True)


@pytest.mark.thorough
def test_deviations_of_modes_cover_their_errors(shaken):
    arm, _, result = shaken
    hertz, damping = vibrations(fa.modes(arm, joints="free"))
    scores = []
    for seed in range(12):
        data = noisy(result, seed, {"joint_angle": 4e-6, "strain": 4e-8})
        response = fa.frequency_response(measured(data), period=4.0, start=20.0)
        found = response.modes(2, band=(1.0, 30.0))
        scores += [
            (found.frequency_hz - hertz) / found.frequency_deviation,
            (found.damping_ratio - damping) / found.damping_deviation,
        ]
    # 48 numbers, from deviations with 4 degrees of freedom in each line.
    size = np.sqrt(np.mean(np.square(scores)))
    assert 0.6 < size < 1.6


def test_a_clamped_free_link_has_the_frequencies_of_the_textbook():
    """A hub of a million times the inertia of the link is a clamp."""
    inertia = 0.35 * 0.8**3 / 3.0
    spec = one_link(hub_inertia=1e6 * inertia, elements=12, modes=5).spec
    arm = fa.Arm(spec.replace(payload=fa.Payload(mass=0.0)))
    torque = fa.multisine(2.0, (1.0, 90.0), 1e3, rise=0.5)
    result = run(arm, torque, 28.0, 800.0)
    found = fa.frequency_response(measured(result, ["strain"]), period=2.0, start=24.0).modes(3)
    roots = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])
    exact = roots**2 / (2.0 * np.pi * 0.8**2) * np.sqrt(8.0 / 0.35)  # cos x cosh x = -1
    # The vibrations from the start have decayed to a thousandth; the third mode is at the end of
    # the band, and the images of the zero-order hold are near.
    np.testing.assert_allclose(found.frequency_hz[:2], exact[:2], rtol=5e-4)
    np.testing.assert_allclose(found.frequency_hz[2], exact[2], rtol=2e-3)
    # Half the stiffness coefficient times the frequency.
    np.testing.assert_allclose(found.damping_ratio, 8e-4 * np.pi * exact, rtol=1e-2)


def test_outputs_that_do_not_move_have_no_weight():
    """At a joint angle of pi/2 the tip moves along x, and along y by rounding only."""
    arm = one_link()
    q = arm.rest([np.pi / 2.0])
    torque = fa.multisine(4.0, (0.5, 30.0), 0.003, rise=0.5)
    samples = torque.samples(RATE, 24.0)
    given = {"rate": RATE, "torque_interpolation": "hold", "progress": False}
    result = fa.simulate(arm, 24.0, torque=samples, initial=q, **given)
    data = noisy(result, 1, {"joint_angle": 0.0, "strain": 0.0, "tip": 1e-7})
    model = fa.modes(arm, q=q, joints="free")
    response = fa.frequency_response(
        measured(data, ["joint_angle", "strain", "tip"]), period=4.0, start=12.0
    )
    with pytest.warns(fa.AccuracyWarning, match=r"tip_y to torque_1 \("):
        found = response.modes(2, band=(1.0, 30.0))
    mac = found.compare(model)["mac"].sel(model=[2, 3])
    assert np.all(np.diag(mac) > 0.999)
    # The size is that of the channel, also if the record has only the axis that does not move.
    across = measured(data.isel(axis=[1]), ["joint_angle", "strain", "tip"])
    response = fa.frequency_response(across, period=4.0, start=12.0)
    assert response.outputs == ("joint_angle_1", "strain_1", "tip_y")
    with pytest.warns(fa.AccuracyWarning, match=r"tip_y to torque_1 \("):
        mac = response.modes(2, band=(1.0, 30.0)).compare(model)["mac"].sel(model=[2, 3])
    without = fa.frequency_response(measured(data), period=4.0, start=12.0)
    expected = without.modes(2, band=(1.0, 30.0)).compare(model)["mac"].sel(model=[2, 3])
    np.testing.assert_allclose(mac, expected, atol=1e-3)  # noise of the tip


def test_modes_that_do_not_move_the_outputs_are_not_compared(shaken):
    arm, _, result = shaken
    outputs = measured(result, ["joint_angle", "joint_rate"])
    found = fa.frequency_response(outputs, period=4.0, start=20.0).modes(2, band=(1.0, 30.0))
    with pytest.raises(fa.InputError, match="modes do not move any of the outputs"):
        found.compare(fa.modes(arm))


def test_equal_shapes_have_an_assurance_of_one():
    random = np.random.default_rng(3)
    first = random.standard_normal((3, 4)) + 1j * random.standard_normal((3, 4))
    np.testing.assert_allclose(np.diag(assurance(first, (2.0 - 1j) * first)), 1.0)
    assert assurance(np.array([[1.0, 0.0]]), np.array([[0.0, 2.0], [1.0, 1.0]])).tolist() == [
        [0.0, pytest.approx(0.5)]
    ]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"period": 4.0, "segment": 2.0}, "segment cannot be combined with period"),
        ({"period": 3.9999}, "a whole number of them, at 200 Hz"),
        ({"period": 4.0, "start": 30.0}, "leave a whole period"),
        ({"segment": 100.0}, "segment must have"),
        ({"start": 100.0}, "start must leave at least 8 samples in the record of 32 s, got 100"),
        ({"band": (30.0, 1.0)}, "band must be ascending"),
        ({"records": []}, "must not be empty"),
        ({"period": 4.0, "start": 20.0, "band": (50.0, 60.0)}, "no frequency that is excited"),
    ],
)
def test_wrong_arguments_of_a_response(shaken, arguments, text):
    given = {"records": measured(shaken[2]), **arguments}
    with pytest.raises(fa.InputError, match=text):
        fa.frequency_response(**given)


def test_records_must_agree(shaken):
    _, _, result = shaken
    own = measured(result)
    other = fa.MeasuredRecord(result, interpolation="cubic")
    with pytest.raises(fa.InputError) as error:
        fa.frequency_response({"a": own, "b": measured(result, ["strain"]), "c": other})
    assert [problem.name for problem in error.value.problems] == ["b", "c", "c"]
    gaps = result[["torque", "strain"]].copy(deep=True)
    gaps["strain"][5] = np.nan
    with pytest.raises(fa.InputError, match="strain_1 has missing samples"):
        fa.frequency_response(measured(gaps, ["strain"]))
    free = xr.Dataset({"joint_angle": result["joint_angle"]})
    with pytest.raises(fa.InputError, match="record 1 has no torque, current or voltage"):
        fa.frequency_response(free)


def test_wrong_arguments_of_modes(shaken):
    response = fa.frequency_response(measured(shaken[2], ["strain"]), period=4.0, start=20.0)
    with pytest.raises(fa.InputError, match="at least 10 frequencies for 2 modes"):
        response.modes(2, band=(3.0, 5.0))
    with pytest.raises(fa.InputError, match="band must be ascending"):
        response.modes(1, band=(30.0, 1.0))
    with pytest.raises(fa.InputError, match="at least two outputs"):
        response.modes(1).compare(fa.modes(shaken[0], joints="free"))
