"""Exported Kalman filters against the filters in Python."""

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.c_code_tools import Library, make
from flexarm.bridges.c_code.observer import exported_observer
from flexarm.bridges.c_code.recording import estimates, record_observer
from flexarm.cli.main import app
from unit.control.test_extended_kalman import ACCELEROMETER, ENCODER, STRAIN, two_links

#: The torque of joint 2 is less certain, so that an exchange of joints shows.
NOISE = {"torque_noise": [0.1, 0.3], "sample_time": 1e-3}
CAMERA = fa.Instrument(fa.Sensor("position", link=2, name="camera"), noise=1e-3)


def joints_only():
    """An arm with a rigid last link and without gravity, whose payload is known."""
    spec = two_links().spec
    links = [spec.links[0], fa.Link(length=0.6, mass_per_length=0.5, flexible=False)]
    return fa.ExtendedKalmanFilter(
        fa.Arm(spec.replace(links=links, gravity=(0.0, 0.0))), [ENCODER], **NOISE
    )


#: Filters, by a name for the test.
FILTERS = {
    "linear_readings": lambda: fa.ExtendedKalmanFilter(
        two_links(), [STRAIN, ENCODER], payload_deviation=0.03, payload_drift=0.01, **NOISE
    ),
    "accelerometer_and_camera": lambda: fa.ExtendedKalmanFilter(
        two_links(offset=(0.05, 0.02)),
        [ENCODER, ACCELEROMETER, STRAIN, CAMERA],
        payload_deviation=0.02,
        **NOISE,
    ),
    "no_gravity": joints_only,
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(FILTERS))
def test_recorded_run(name, tmp_path):
    observer = FILTERS[name]()
    fa.export_c(observer.arm, tmp_path, observer=observer)
    for cc in ("gcc", "clang"):
        make(tmp_path, "clean")
        done = make(tmp_path, "test", cc)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "observer " in done.stdout


@pytest.mark.thorough
def test_estimates_and_covariance(tmp_path):
    """Estimates of a longer run, and the covariance in the memory, to 1e-12 of the largest.

    The filter forgets rounding errors at the pace at which it forgets its start, so they do not add
    up. An arm with other modes than that of the filter may be exported beside it.
    """
    observer, samples = FILTERS["linear_readings"](), 120
    other = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=0.5, flexible=False)] * 2)
    fa.export_c(other, tmp_path, observer=observer)
    library, n = Library(tmp_path), observer.arm.dof
    assert library.macros["observer_dof"] == n
    assert library.macros["observer_time"] == 1e-3
    inputs, expected = record_observer(exported_observer(other, observer), samples)
    memory, found = np.zeros(int(library.macros["observer_memory"])), []
    for k in range(samples):
        readings, torque = inputs["readings"][k].copy(), inputs["last_torque"][k].copy()
        outputs = [np.zeros(n), np.zeros(n), np.zeros(1), np.zeros(1)]
        given = [readings, torque] if k else [readings]
        library("observer_update" if k else "observer_start", *given, memory, *outputs)
        found.append(np.concatenate(outputs))
    parts = np.split(np.arange(2 * n + 2), [n, 2 * n, 2 * n + 1])
    for part in parts:
        wanted = expected[:, part]
        limit = 1e-12 * np.abs(wanted).max()
        np.testing.assert_allclose(np.array(found)[:, part], wanted, rtol=0, atol=limit)
    assert np.ptp(expected[:, -2]) > 1e-3  # the payload is estimated
    estimates(observer, inputs)  # which leaves the filter as it was
    observer.reset()
    for k in range(samples):
        if k:
            observer.predict(inputs["last_torque"][k])
        strain, angle = inputs["readings"][k].reshape(2, 2)
        observer.correct(fa.Measurement(strain=strain, joint_angle=angle))
    P = observer._parts[0].P
    deviation = np.sqrt(np.diag(P))
    both = memory[2 * n + 1 :].reshape(P.shape) / np.outer(deviation, deviation)
    # The smallest eigenvalue of the correlations is 1e-6, which amplifies rounding.
    np.testing.assert_allclose(both, P / np.outer(deviation, deviation), rtol=0, atol=1e-10)


def unknown_rigidity(arm):
    path = "links[0].flexural_rigidity"
    return fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], parameters={path: 1.0})


def disturbed(arm):
    return fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], disturbance_deviation=0.1)


def biased(arm):
    return fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], bias_deviation={"strain": 1e-5})


def late(arm):
    return fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN.replace(delay=0.01)])


def uncertain(arm):
    return fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], payload_deviation=0.1)


@pytest.mark.parametrize(
    ("create", "words"),
    [
        (lambda arm: fa.UnscentedKalmanFilter(arm, [ENCODER]), "ExtendedKalmanFilter.*eigenvect"),
        (lambda arm: fa.MovingHorizonEstimator(arm, [ENCODER]), "ExtendedKalmanFilter.*optimisa"),
        (lambda arm: "filter", "be an ExtendedKalmanFilter, got 'filter'"),
        (unknown_rigidity, r"no parameters.*\. The code estimates .* only"),
        (disturbed, r"no parameters, disturbance torques or biases\. The code estimates .* only"),
        (biased, r"no parameters, disturbance torques or biases"),
        (late, r"have instruments without a delay or a sample_time, got strain"),
        (uncertain, r"at most 0\.0\d+ kg, got 0\.1\. Above it"),
    ],
)
def test_filters_that_are_not_exported(create, words, tmp_path):
    arm, folder = two_links(), tmp_path / "new"
    with pytest.raises(fa.InputError, match=words):
        fa.export_c(arm, folder, observer=create(arm))
    assert not folder.exists()


def test_filter_of_an_arm_with_other_joints(tmp_path):
    one = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=5.0, mass_per_length=0.5)])
    with pytest.raises(fa.InputError, match="1 joint"):
        fa.export_c(one, tmp_path, observer=fa.ExtendedKalmanFilter(two_links(), [ENCODER]))


def test_sample_time_after_a_change():
    """The steps are those of the filter after its next reset, and the filter keeps its estimate."""
    observer = FILTERS["linear_readings"]()
    observer.correct(fa.Measurement(strain=[1e-5, 0.0], joint_angle=[0.1, 0.2]))
    before = observer.q
    observer.sample_time = 0.02
    found = exported_observer(observer.arm, observer)
    assert found.sample_time == 0.02
    np.testing.assert_array_equal(observer.q, before)
    steps = found.filter._step.steps
    observer.reset()
    assert steps == observer._step.steps > 5


def test_filter_of_a_controller_has_its_sample_time():
    filters = FILTERS["linear_readings"]()
    law = fa.EstimatorController(filters, fa.JointPD(20.0, 3.0, 0.004))
    assert exported_observer(filters.arm, law.estimator).sample_time == 0.004


def test_widest_payload_is_the_limit(tmp_path):
    arm = two_links()
    with pytest.raises(fa.InputError, match="at most") as caught:
        fa.export_c(
            arm, tmp_path, observer=fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=1.0)
        )
    widest = float(str(caught.value).split("at most ")[1].split()[0])
    for factor, count in ((0.99, 1), (1.01, 25)):
        found = fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=factor * widest)
        found.correct(fa.Measurement(joint_angle=[0.0, 0.0]))
        assert (len(found._parts) == 1) == (count == 1)


@pytest.mark.thorough
def test_scenario_with_an_estimator(tmp_path):
    folder = tmp_path / "my-arm"
    assert CliRunner().invoke(app, ["init", str(folder)]).exit_code == 0
    path = folder / "scenario.yaml"
    path.write_text(
        path.read_text().split("drive:")[0]
        + "drive:\n  kind: estimator\n  estimator: {torque_noise: 0.5}\n"
        "  inner: {kind: joint_pd, proportional: 100, derivative: 10, sample_time: 0.002}\n"
        "hardware:\n  instruments:\n    - {signal: joint_angle, noise: 1e-4}\n"
        "run: {duration: 0.1}\n"
    )
    out = tmp_path / "c"
    found = CliRunner().invoke(app, ["export", "c", str(path), "--out", str(out)])
    assert found.exit_code == 0, found.output
    assert "with the controller JointPD" in found.output
    assert "with the observer ExtendedKalmanFilter" in found.output
    header = (out / "arm.h").read_text()
    assert "#define ARM_OBSERVER_TIME 0.002" in header
    assert "arm_controller_update" in header
    done = make(out, "test")
    assert done.returncode == 0, done.stdout + done.stderr
