"""Reductions of a batch against their definitions, on the channels of single results."""

import numpy as np
import pytest

import flexarm as fa

pytestmark = pytest.mark.compiled

ARM = fa.Arm(
    links=[
        fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.6, elements=1),
        fa.Link(length=0.8, flexural_rigidity=40.0, mass_per_length=0.6, elements=1),
    ],
    gravity=(0.0, -9.81),
)
HOW = {"duration": 0.05, "rate": 400.0, "torque": [[3.0, 1.0]] * 20}


def reduced(**reductions):
    batch = fa.simulate_batch(ARM, reductions=reductions, channels=[], **HOW)
    return batch.isel(run=0), fa.simulate(ARM, **HOW)


def test_definitions():
    own, single = reduced(
        peak=fa.Reduction("peak", "tip_velocity"),
        rms=fa.Reduction("rms", "joint_rate"),
        mean=fa.Reduction("mean", "tip"),
        final=fa.Reduction("final", "tip"),
        residual=fa.Reduction("residual", "tip", after=0.02),
    )
    speed = np.hypot(*single["tip_velocity"].values.T)
    late = single["tip"].values[single["time"].values >= 0.02]
    expected = {
        "peak": speed.max(),
        "rms": np.sqrt((single["joint_rate"].values ** 2).sum(axis=0) / 21),
        "mean": single["tip"].values.sum(axis=0) / 21,
        "final": single["tip"].values[-1],
        "residual": np.hypot(*(late - late.sum(axis=0) / 13).T).max(),
    }
    assert len(late) == 13
    for name, value in expected.items():
        # Rounding errors of sums of 21 numbers.
        np.testing.assert_allclose(own[name], value, rtol=1e-13, err_msg=name)
    dims = {name: own[name].dims for name in expected}
    assert dims == {
        "peak": (), "rms": ("joint",), "mean": ("axis",), "final": ("axis",), "residual": (),
    }  # fmt: skip
    assert own["peak"].attrs == {
        "units": "m/s", "long_name": "largest magnitude of tip_velocity",
    }  # fmt: skip


def test_settling_time():
    own, single = reduced(
        joints=fa.Reduction("settling", "joint_angle", band=2e-2, after=0.01),
        never_outside=fa.Reduction("settling", "joint_angle", band=100.0),
    )
    time, angle = single["time"].values[4:], single["joint_angle"].values[4:]
    for joint in range(2):
        inside = np.abs(angle[:, joint] - angle[-1, joint]) <= 2e-2
        first = next(k for k in range(len(time)) if inside[k:].all())
        assert 0 < first < len(time) - 1
        assert own["joints"].values[joint] == time[first] - time[0]
    np.testing.assert_array_equal(own["never_outside"], [0.0, 0.0])
    assert own["joints"].attrs["units"] == "s"


def test_functions_get_the_channels_of_their_run():
    def work(times, torque, rate):
        return np.trapezoid((torque * rate).sum(axis=1), times)

    own, single = reduced(work=fa.Reduction(work, ("torque", "joint_rate"), after=0.01))
    power = (single["torque"].values * single["joint_rate"].values).sum(axis=1)[4:]
    assert own["work"] == np.trapezoid(power, single["time"].values[4:])
    assert own["work"].dims == ()


def test_a_time_after_the_run():
    """It is refused; a run that an event ends before it has no value."""
    late = {
        "last": fa.Reduction("peak", "tip", after=0.05),
        "none": fa.Reduction("rms", "tip", after=5),
    }
    message = r"^simulate_batch: reductions\['none'\].after must be at most 0.05 s, .* got 5\.$"
    with pytest.raises(fa.InputError, match=message):
        fa.simulate_batch(ARM, reductions=late, channels=[], **HOW)
    end = fa.Event(lambda t, q, qd: t - 0.03, "early", terminal=True)
    peaks = {"peak": fa.Reduction("peak", "joint_rate", after=0.04)}
    batch = fa.simulate_batch(ARM, reductions=peaks, channels=[], events=[end], **HOW)
    assert batch["ended_by"].item() == "early"
    assert np.isnan(batch["peak"].values).tolist() == [[True, True]]


def test_all_samples_count():
    rms = {"reductions": {"rms": fa.Reduction("rms", "torque")}}
    dense = fa.simulate_batch(ARM, **HOW, **rms)
    sparse = fa.simulate_batch(ARM, stride=7, **HOW, **rms)
    assert sparse.sizes["time"] == 3
    np.testing.assert_array_equal(sparse["rms"], dense["rms"])
