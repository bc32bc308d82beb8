"""Batches of runs with controllers of users: copies, failures, vectorized controllers."""

import numpy as np
import pytest

import flexarm as fa
from conformance.controller_examples import SAMPLE_TIME
from loop_runs import ARM, CHANNELS, MOTION, RATE, SHORT, STARTS, Integral, compare

pytestmark = pytest.mark.compiled


class Failing(Integral):
    """It raises an exception in runs that start above an angle."""

    def update(self, t, measurement, reference):
        if t > 0.02 and measurement.joint_angle[0] > 0.43:
            raise RuntimeError("too far")
        return super().update(t, measurement, reference)


def test_a_python_controller_that_raises(executed):
    controller = Failing()
    own = {"controller": controller, "reference": MOTION}
    batch = fa.simulate_batch(ARM, initial=STARTS, channels=CHANNELS, threads=1, **own, **SHORT)
    bad = np.flatnonzero(batch["failure"] != "")
    assert list(bad) == [k for k in range(11) if k not in executed]
    assert 0 < bad.size < 11
    for k in bad:
        with pytest.raises(fa.SimulationError, match="RuntimeError: too far") as failed:
            fa.simulate(ARM, initial=STARTS[k], **own, **SHORT)
        assert batch["failure"][k] == str(failed.value)
    compare(batch, executed[:2], **{key: lambda k, v=value: v for key, value in own.items()})


@pytest.mark.parametrize(
    "answer", [[np.nan, 0.0], [0.0], None, "torque"], ids=["NaN", "shape", "None", "text"]
)
def test_a_python_controller_that_returns_no_torque(answer, executed):
    class Wrong(Integral):
        def update(self, t, measurement, reference):
            return answer if t > 0.02 else [0.0, 0.0]

    own = {"controller": [Wrong(), Integral()], "reference": MOTION}
    batch = fa.simulate_batch(ARM, **own, **SHORT)
    assert executed == [1]
    assert "the controller returned an unusable value" in batch["failure"].values[0]
    assert batch["end_time"][0] == pytest.approx(0.024)


def test_the_objects_of_the_user_keep_their_state(executed):
    controller = Integral()
    controller.reset()
    fa.simulate_batch(ARM, controller=controller, reference=MOTION, initial=STARTS, **SHORT)
    assert len(executed) == 11
    assert controller.calls == 0
    # Loops with contacts are executed alone.
    floor = fa.Contact(fa.Wall((0.0, -5.0), (0.0, 1.0)), 1e4)
    own = {"reference": MOTION, "initial": STARTS[:2], **SHORT}
    fa.simulate_batch(ARM, controller=controller, contacts=[floor], **own)
    assert len(executed) == 11
    assert controller.calls == 0


def test_a_vectorized_python_controller(executed):
    calls = []

    class Vectorized:
        sample_time, vectorized = SAMPLE_TIME, True

        def reset(self):
            self.sum = 0.0

        def update(self, t, measurement, reference):
            calls.append(np.shape(measurement.joint_angle))
            error = reference.joint_angle(t) - measurement.joint_angle
            self.sum = self.sum + self.sample_time * error
            return 5.0 * error + 20.0 * self.sum

    own = {"reference": MOTION, "channels": CHANNELS, "initial": STARTS, "threads": 1, **SHORT}
    batch = fa.simulate_batch(ARM, controller=Vectorized(), **own)
    assert set(calls) == {(11, 2)}
    assert len(calls) == 13
    other = fa.simulate_batch(ARM, controller=Integral(), **own)
    np.testing.assert_array_equal(batch["tip"], other["tip"])

    class Derived(Vectorized):
        """A class with its own ``update`` is not vectorized, if it does not say so."""

        def update(self, t, measurement, reference):
            return super().update(t, measurement, reference)

    calls.clear()
    batch = fa.simulate_batch(ARM, controller=Derived(), **own)
    assert set(calls) == {(2,)}
    np.testing.assert_array_equal(batch["tip"], other["tip"])
    assert len(executed) == 33


@pytest.mark.parametrize("raises", [False, True])
def test_a_vectorized_python_controller_that_fails_for_some_runs(raises, executed):
    class Partly:
        sample_time, vectorized = SAMPLE_TIME, True

        def reset(self):
            pass

        def update(self, t, measurement, reference):
            angle = measurement.joint_angle
            far = (angle[..., :1] > 0.43) & (t > 0.02)
            if raises and far.any():
                raise ValueError("too far")
            return np.where(far, np.nan, reference.joint_angle(t) - angle)

    own = {"controller": Partly(), "reference": MOTION}
    batch = fa.simulate_batch(ARM, initial=STARTS, channels=CHANNELS, threads=1, **own, **SHORT)
    bad = np.flatnonzero(batch["failure"] != "")
    assert 0 < bad.size < 11
    assert len(executed) == (0 if raises else 11 - bad.size)
    reason = "ValueError: too far" if raises else "an unusable value"
    assert all(reason in text for text in batch["failure"].values[bad])
    compare(batch, (0, 1), **{key: lambda k, v=value: v for key, value in own.items()})


def test_controllers_that_share_a_part(executed):
    """Both would advance the same integral, if they were not copied."""
    inner = Integral()

    class Around:
        sample_time = SAMPLE_TIME

        def __init__(self, factor):
            self.factor = factor

        def reset(self):
            inner_of(self).reset()

        def update(self, t, measurement, reference):
            return self.factor * inner_of(self).update(t, measurement, reference)

    def inner_of(around):
        return around.inner

    controllers = [Around(1.0), Around(0.5)]
    for one in controllers:
        one.inner = inner
    batch = fa.simulate_batch(
        ARM,
        controller=controllers,
        reference=MOTION,
        initial=STARTS[:2],
        channels=CHANNELS,
        **SHORT,
    )
    assert len(executed) == 2
    compare(batch, (0, 1), controller=lambda k: controllers[k], reference=lambda k: MOTION)


class _NotCopied(Integral):
    def __deepcopy__(self, memo):
        raise TypeError("it owns a device")


@pytest.mark.parametrize(
    "other",
    [
        {"controller": _NotCopied()},
        {"hardware": fa.Hardware([fa.Instrument("joint_angle"), fa.Instrument("torque")])},
        {"contacts": [fa.Contact(fa.Wall((0.0, -5.0), (0.0, 1.0)), 1e4)]},
        {"integrator": "gauss_6", "step": 1e-3},
        {"channels": ["joint_force"]},
    ],
    ids=["copy", "torque", "contacts", "method", "forces"],
)
def test_other_runs_are_executed_one_at_a_time(other, executed):
    own = {"controller": Integral(), "reference": MOTION, **other, **SHORT}
    batch = fa.simulate_batch(ARM, initial=STARTS[:2], **own)
    assert executed == []
    del own["channels" if "channels" in own else "rate"]
    own["rate"] = RATE
    single = fa.simulate(ARM, initial=STARTS[1], **own)
    name = "joint_force" if "joint_force" in batch else "tip"
    np.testing.assert_array_equal(batch[name][1], single[name])
