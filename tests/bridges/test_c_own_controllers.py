"""Own controllers in exported C: functions that are possible, and laws that are refused."""

import threading
from enum import Enum

import numpy as np
import pytest

import flexarm as fa
from bridges.c_code_tools import make
from bridges.test_c_controllers import OwnController, heavy
from conformance.controller_examples import SAMPLE_TIME, joint_pd
from flexarm.bridges.c_code.laws.traced_controller import traced_controller


class Functions(OwnController):
    """All functions of NumPy that the page lists."""

    memory = ()

    def update(self, t, measurement, reference):
        angle, rate = measurement.joint_angle, measurement.joint_rate
        small = 0.5 * np.tanh(angle)
        torque = np.arcsin(small) + np.arccos(small) + np.arctan(rate) + np.arctanh(small)
        torque += np.arctan2(rate, angle - 2.0) + np.tan(small) + np.sinh(small) + np.cosh(rate)
        torque += np.log(2.0 + np.abs(angle)) + np.sign(angle - 0.05) + np.sqrt(np.exp(small))
        torque += np.clip(np.sin(angle), -0.2, 0.2) + np.where(rate > 0.0, np.cos(rate), 0.5)
        torque += np.minimum(angle, rate) * np.maximum(angle, 0.1)
        # The same of numbers instead of arrays.
        torque[0] += np.arctan2(rate[0], 2.0) + np.log(1.0 + angle[1] ** 2) + np.tan(small[1])
        return torque


class Complementary(OwnController):
    """Two conditions of which one is true."""

    memory = ()

    def update(self, t, measurement, reference):
        angle = measurement.joint_angle
        if angle[0] > 0.0:
            gain = 1.0
        if angle[0] <= 0.0:
            gain = 2.0
        if angle[1] >= 0.05:
            added = 0.1
        if angle[1] < 0.05:
            added = 0.2
        return gain * angle + added


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [Functions, Complementary])
def test_recorded_run(kind, tmp_path):
    fa.export_c(heavy(), tmp_path, controller=kind())
    done = make(tmp_path, "test")
    assert done.returncode == 0, done.stdout + done.stderr


class Own(fa.Controller):
    sample_time = SAMPLE_TIME

    def reset(self):
        pass


class Waves(Own):
    memory = ()

    def update(self, t, measurement, reference):
        return measurement.joint_angle * np.sin(5.0 * t)


class Waits(Own):
    memory = ()

    def update(self, t, measurement, reference):
        return measurement.joint_angle if t > 1.0 else np.zeros(2)


class Remembers(Own):
    memory = ("before",)

    def update(self, t, measurement, reference):
        self.before = t
        return measurement.joint_angle


class Counts(Own):
    memory = ()
    k = 0

    def update(self, t, measurement, reference):
        self.k += 1
        return measurement.joint_angle * (1.0 if self.k > 100 else 2.0)


class Shifts(Own):
    memory = ()

    def reset(self):
        self.line = [0.0, 1.0, 2.0]

    def update(self, t, measurement, reference):
        self.line = [*self.line[1:], self.line[0]]
        return measurement.joint_angle * self.line[0]


class Side(Enum):
    LEFT, RIGHT = 1, 2


class Switches(Own):
    """The attribute ``kept`` has one of two values."""

    memory = ()
    kept, values = None, ()

    def reset(self):
        self.kept = self.values[0]

    def update(self, t, measurement, reference):
        factor = 1.0 if repr(self.kept) == repr(self.values[0]) else 2.0
        if measurement.joint_angle[0] > 0.0:
            self.kept = self.values[1]
        return measurement.joint_angle * factor


class Creates(Own):
    """Only one path creates the attribute ``z``, the last by name."""

    memory = ()

    def update(self, t, measurement, reference):
        factor = 2.0 if hasattr(self, "z") else 1.0
        if measurement.joint_angle[0] > 0.0:
            self.z = 1.0
        return measurement.joint_angle * factor


class Last(Own):
    memory = ()

    def reset(self):
        self.last = np.zeros(2)
        self.started = False

    def update(self, t, measurement, reference):
        torque = measurement.joint_angle - self.last
        if self.started:
            self.last = 1.0 * measurement.joint_angle
        self.started = True
        return torque


class Follows(Own):
    memory = ()

    def reset(self):
        self.last = None

    def update(self, t, measurement, reference):
        now = measurement.joint_angle
        last = np.zeros(2) if self.last is None else self.last
        self.last = np.ones(2) if self.last is None else now
        return now - last


class Grows(Own):
    memory = ("line",)

    def reset(self):
        self.line = np.zeros(1)

    def update(self, t, measurement, reference):
        self.line = np.append(self.line, measurement.joint_angle[0])
        return measurement.joint_angle + self.line[0]


class Draws(Own):
    memory = ()

    def update(self, t, measurement, reference):
        Draws.calls = getattr(Draws, "calls", 0) + 1
        angle = measurement.joint_angle
        return angle if angle[0] > 0.1 * Draws.calls else 2.0 * angle


class Indexes(Own):
    memory = ()

    def update(self, t, measurement, reference):
        torque = 1.0 * measurement.joint_angle
        torque[torque > 0.0] = 1.0
        return torque


class Items(Own):
    memory = ()

    def update(self, t, measurement, reference):
        return np.full(2, measurement.joint_angle[0].item())


class Unbound(Own):
    memory = ()

    def update(self, t, measurement, reference):
        if measurement.joint_angle[0] > 0.0:
            torque = measurement.joint_angle
        return torque


class Halves(Own):
    memory = ()

    def update(self, t, measurement, reference):
        value = measurement.joint_angle[0]
        while value > 0.1:
            value = 0.5 * value
        return np.array([value, value])


class Searches(Own):
    """Of each condition, one side leaves the loop."""

    memory = ()

    def update(self, t, measurement, reference):
        value = measurement.joint_angle[0]
        while True:
            value = 0.5 * value
            if value < 0.1:
                return np.array([value, value])


class Repeats(Own):
    """The condition stays the same."""

    memory = ()

    def update(self, t, measurement, reference):
        while measurement.joint_angle[0] > 0.1:
            pass
        return measurement.joint_angle


class Three(Own):
    memory = ()

    def update(self, t, measurement, reference):
        return np.full(3, measurement.joint_angle[0])


class Number(Own):
    memory = ()

    def update(self, t, measurement, reference):
        return measurement.joint_angle[0]


REASONS = {
    Waves: "depends on the time t",
    Waits: "depends on the time t",
    Remembers: "depends on the time t",
    Counts: "changes 'k' between samples",
    Shifts: "changes 'line' between samples",
    Creates: "changes 'z' in a condition",
    Last: "changes '(started|last)' between samples",
    Follows: "changes 'last' between samples",
    Grows: "changes the size of its memory",
    Draws: "other conditions when it is evaluated again",
    Indexes: "with numbers what symbols cannot",
    Items: "item",
    Unbound: "torque",
    Halves: "too many conditions on one path",
    Searches: "too many conditions on one path",
    Repeats: "too many conditions on one path",
    Three: r"returns torques of shape \(3,\) instead of \(2,\)",
    Number: r"returns torques of shape \(\) instead of \(2,\)",
}


@pytest.mark.sampled("Waves", "Counts", "Last", "Draws", "Unbound", "Number")
@pytest.mark.parametrize("kind", REASONS)
def test_refused_with_the_reason(kind, tmp_path):
    with pytest.raises(fa.InputError, match=f"closed form, got {kind.__name__}.*{REASONS[kind]}"):
        fa.export_c(heavy(), tmp_path / "new", controller=kind())
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    "values",
    [
        ("hold", "move"),
        (Side.LEFT, Side.RIGHT),
        (np.zeros(2), np.ones(2)),
        (np.array([True]), np.array([False])),
        ([1.0], [2.0]),
        ({"a": 1.0}, {"a": 2.0}),
        (np.float64(1.0), np.float64(2.0)),
    ],
    ids=lambda values: type(values[0]).__name__,
)
def test_undeclared_attributes_of_all_types(values):
    controller = Switches()
    controller.values = values
    with pytest.raises(fa.InputError, match="changes 'kept' in a condition"):
        traced_controller(heavy(), controller)


@pytest.mark.parametrize(
    "around",
    [
        lambda inner: fa.DisturbanceObserver(heavy(), inner, 0.2),
        lambda inner: fa.RepetitiveControl(inner, 10 * SAMPLE_TIME, [2.0, 0.8], cutoff=80.0),
    ],
)
@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (fa.HybridForce, "HybridForce inside it controls the tip"),
        (fa.LQG, "LQG inside it follows a nominal motion"),
        (fa.Composite, "Composite inside it follows a nominal motion"),
    ],
)
def test_controllers_that_are_not_exported_inside_another(around, kind, words):
    inside = kind(heavy(), sample_time=SAMPLE_TIME)
    with pytest.raises(fa.InputError, match=words):
        traced_controller(heavy(), around(inside))


def test_exports_in_two_threads():
    """An export that ends leaves ``min`` of another one as it is."""
    entered, other_ended = threading.Event(), threading.Event()

    class Slow(Own):
        memory = ()

        def update(self, t, measurement, reference):
            entered.set()
            other_ended.wait(1.0)  # the other export has to wait for this one
            return np.full(2, min(measurement.joint_angle[0], 0.1))

    def other():
        entered.wait()
        traced_controller(heavy(), joint_pd())
        other_ended.set()

    thread = threading.Thread(target=other)
    thread.start()
    found = traced_controller(heavy(), Slow())
    thread.join()
    assert "fmin" in str(found.functions[0].function.expand()(*found.functions[0].function.sx_in()))
