"""Wrong events, functions that fail, and events in results and files."""

import csv

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm
from flexarm.integrate import RungeKutta4


def test_events_of_an_equal_arm_are_accepted():
    event = fa.joint_event(table_one_arm(), 1, 0.05)
    result = fa.simulate(
        table_one_arm(), 0.1, initial_rate=table_one_arm().rest([1, 0]), events=[event]
    )
    assert result.sizes["event"] == 1


def bad(kind):
    """Functions with wrong values at 0.0503 s, between samples, or from 0.0505 s on."""

    def function(t, q, qd):
        if t < 0.0503:
            return 1.0
        return {"raises": lambda: 1 / 0, "nan": lambda: np.nan, "text": lambda: "x"}[kind]()

    return function


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("raises", "the event 'bad' failed with ZeroDivisionError: division by zero"),
        ("nan", "event 'bad': its value must be finite, got nan"),
        ("text", "event 'bad': its value must be a number, got 'x'"),
    ],
)
@pytest.mark.parametrize("loop", ["open", "closed"])
def test_failing_function_ends_the_run_with_time_reason_and_partial_result(kind, reason, loop):
    arm = table_one_arm()
    events = [fa.joint_event(arm, 1, 0.02, name="passed"), fa.Event(bad(kind), name="bad")]
    drive = {"controller": fa.JointPD(0.0, 0.0)} if loop == "closed" else {}
    if loop == "closed":
        drive["reference"] = fa.joint_motion(arm, [0.0, 0.0], [0.0, 0.0], 1.0)
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 0.2, initial_rate=arm.rest([1.0, 0.0]), events=events, **drive)
    error = caught.value
    assert reason in error.reason
    assert error.time == pytest.approx(0.051)  # the first sample at which it fails
    result = error.result
    assert result.time.values[-1] == pytest.approx(0.051)
    assert result.event_name.values.tolist() == ["passed"]
    assert result.attrs["ended_by"] == "failure"
    assert result.attrs["failure"] == str(error)
    np.testing.assert_array_equal(error.state[0], result.q.values[-1])


def test_failure_between_samples_is_reported():
    arm = table_one_arm()

    def function(t, q, qd):
        return 0.047 - t if abs(t - round(t, 2)) < 1e-9 else np.nan

    with pytest.raises(fa.SimulationError, match="its value must be finite") as caught:
        fa.simulate(arm, 0.2, events=[fa.Event(function)], rate=1 / 0.02)
    assert 0.04 < caught.value.time < 0.06
    assert caught.value.result.time.values[-1] == pytest.approx(0.04)


def test_terminal_event_precedes_a_later_failure_of_a_function():
    arm = table_one_arm()
    events = [fa.Event(bad("nan")), fa.joint_event(arm, 1, 0.03, name="end", terminal=True)]
    result = fa.simulate(arm, 0.2, initial_rate=arm.rest([1.0, 0.0]), events=events)
    assert result.attrs["ended_by"] == "end"


def test_terminal_event_precedes_a_later_failure_of_the_run():
    """3 ms are too long a step for this arm, which diverges within some steps."""
    arm = table_one_arm()
    options = {"integrator": RungeKutta4(step=3e-3), "torque": lambda t: [4.0, 1.5]}
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 5.0, **options)
    end = fa.Event(lambda t, q, qd: t - 0.5 * caught.value.time, name="end", terminal=True)
    result = fa.simulate(arm, 5.0, events=[end], **options)
    assert result.attrs["ended_by"] == "end"


def test_functions_may_take_many_samples():
    arm = table_one_arm()
    calls = []

    def angle(t, q, qd):
        calls.append(q.shape)
        assert t.shape == (len(q),)
        assert q.shape == qd.shape == (len(t), arm.dof)
        return q[:, 0] - 0.05

    angle.vectorized = True
    options = {"initial_rate": arm.rest([1.0, 0.0])}
    result = fa.simulate(arm, 0.2, events=[fa.Event(angle)], **options)
    assert max(shape[0] for shape in calls) > 1
    single = fa.simulate(arm, 0.2, events=[fa.Event(lambda t, q, qd: q[0] - 0.05)], **options)
    np.testing.assert_array_equal(result.event_time, single.event_time)

    def late(t, q, qd):
        return np.where(t < 0.0505, 1.0, np.nan)

    late.vectorized = True
    with pytest.raises(fa.SimulationError, match="its value must be finite") as caught:
        fa.simulate(arm, 0.2, events=[fa.Event(late)], **options)
    assert caught.value.time == pytest.approx(0.051)


@pytest.mark.sampled("0.05")
@pytest.mark.parametrize("angle", [0.05, 9.0])
def test_events_are_kept_in_netcdf_and_omitted_from_tables(tmp_path, angle):
    arm = table_one_arm()
    event = fa.joint_event(arm, 1, angle, name="there")
    result = fa.simulate(arm, 0.2, initial_rate=arm.rest([1.0, 0.0]), events=[event])
    assert result.sizes["event"] == (angle < 1.0)
    assert result.event_time.attrs["units"] == "s"
    fa.write_result(result, tmp_path / "run.nc")
    assert fa.read_result(tmp_path / "run.nc").identical(result)
    fa.write_result(result, tmp_path / "run.csv")
    with open(tmp_path / "run.csv", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert len(rows) == 1 + result.sizes["time"]
    assert len({len(row) for row in rows}) == 1
    assert not any("event" in name for name in rows[0])
