"""Own controllers in exported C: functions that are possible, and steps that are refused."""

import threading

import numpy as np
import pytest

import flexarm as fa
from bridges.c_code_tools import make
from bridges.test_c_controllers import OwnController, heavy
from conformance.controller_examples import SAMPLE_TIME, joint_pd
from flexarm.bridges.c_code.traced_law import traced_controller


class Functions(OwnController):
    """All functions of NumPy that the page lists."""

    def step(self, memory, readings, inputs):
        angle, rate = readings.joint_angle, readings.joint_rate
        small = 0.5 * np.tanh(angle)
        torque = np.arcsin(small) + np.arccos(small) + np.arctan(rate) + np.arctanh(small)
        torque += np.arctan2(rate, angle - 2.0) + np.tan(small) + np.sinh(small) + np.cosh(rate)
        torque += np.log(2.0 + np.abs(angle)) + np.sign(angle - 0.05) + np.sqrt(np.exp(small))
        torque += np.clip(np.sin(angle), -0.2, 0.2) + np.where(rate > 0.0, np.cos(rate), 0.5)
        torque += np.minimum(angle, rate) * np.maximum(angle, 0.1)
        # The same of numbers instead of arrays.
        torque[0] += np.arctan2(rate[0], 2.0) + np.log(1.0 + angle[1] ** 2) + np.tan(small[1])
        return memory, torque


class Complementary(OwnController):
    """Two conditions of which one is true."""

    def step(self, memory, readings, inputs):
        angle = readings.joint_angle
        if angle[0] > 0.0:
            gain = 1.0
        if angle[0] <= 0.0:
            gain = 2.0
        if angle[1] >= 0.05:
            added = 0.1
        if angle[1] < 0.05:
            added = 0.2
        return memory, gain * angle + added


class Plans(OwnController):
    """A plan that the exported code computes."""

    exports_plan = True

    def planned(self, t, reference):
        ahead = reference.joint_angle(t) + 0.1 * np.sin(reference.joint_rate(t))
        return {"reference_angle": ahead}


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [Functions, Complementary, Plans])
def test_recorded_run(kind, tmp_path):
    fa.export_c(heavy(), tmp_path, controller=kind())
    done = make(tmp_path, "test")
    assert done.returncode == 0, done.stdout + done.stderr
    # Only the plan has more inputs of the code than of the step.
    assert ("reference_rate" in (tmp_path / "arm.h").read_text()) == (kind is Plans)


class Own(fa.Controller):
    sample_time = SAMPLE_TIME


class Counts(Own):
    k = 0

    def step(self, memory, readings, inputs):
        self.k += 1
        return memory, readings.joint_angle * (1.0 if self.k > 10 else 2.0)


class Shifts(Own):
    def reset(self):
        super().reset()
        self.line = [0.0, 1.0, 2.0]

    def step(self, memory, readings, inputs):
        self.line = [*self.line[1:], self.line[0]]
        return memory, readings.joint_angle * self.line[0]


class Last(Own):
    def reset(self):
        super().reset()
        self.last = np.zeros(2)
        self.started = False

    def step(self, memory, readings, inputs):
        torque = readings.joint_angle - self.last
        if self.started:
            self.last = 1.0 * readings.joint_angle
        self.started = True
        return memory, torque


class Grows(Own):
    def initial_memory(self, readings, inputs):
        return {"line": np.zeros(1)}

    def step(self, memory, readings, inputs):
        line = np.append(memory["line"], readings.joint_angle[0])
        return {"line": line}, readings.joint_angle + line[0]


class Draws(Own):
    def step(self, memory, readings, inputs):
        Draws.calls = getattr(Draws, "calls", 0) + 1
        angle = readings.joint_angle
        return memory, angle if angle[0] > 0.1 * Draws.calls else 2.0 * angle


class Indexes(Own):
    def step(self, memory, readings, inputs):
        torque = 1.0 * readings.joint_angle
        torque[torque > 0.0] = 1.0
        return memory, torque


class Items(Own):
    def step(self, memory, readings, inputs):
        return memory, np.full(2, readings.joint_angle[0].item())


class Unbound(Own):
    def step(self, memory, readings, inputs):
        if readings.joint_angle[0] > 0.0:
            torque = readings.joint_angle
        return memory, torque


class Halves(Own):
    def step(self, memory, readings, inputs):
        value = readings.joint_angle[0]
        while value > 0.1:
            value = 0.5 * value
        return memory, np.array([value, value])


class Searches(Own):
    """Of each condition, one side leaves the loop."""

    def step(self, memory, readings, inputs):
        value = readings.joint_angle[0]
        while True:
            value = 0.5 * value
            if value < 0.1:
                return memory, np.array([value, value])


class Repeats(Own):
    """The condition stays the same."""

    def step(self, memory, readings, inputs):
        while readings.joint_angle[0] > 0.1:
            pass
        return memory, readings.joint_angle


class Three(Own):
    def step(self, memory, readings, inputs):
        return memory, np.full(3, readings.joint_angle[0])


class Number(Own):
    def step(self, memory, readings, inputs):
        return memory, readings.joint_angle[0]


class LooksAhead(Plans, Own):
    def planned(self, t, reference):
        return {"reference_angle": reference.joint_angle(t + 0.05)}


class Swings(Plans, Own):
    def planned(self, t, reference):
        return {"reference_angle": reference.joint_angle(t) + np.sin(3.0 * t)}


REASONS = {
    LooksAhead: "plans by the reference at another time",
    Swings: "plans by the time itself",
    Counts: "changes attributes",
    Shifts: "changes attributes",
    Last: "changes attributes",
    Grows: "changes the names or the sizes of its memory",
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


def test_exports_in_two_threads():
    """An export that ends leaves ``min`` of another one as it is."""
    entered, other_ended = threading.Event(), threading.Event()

    class Slow(Own):
        def step(self, memory, readings, inputs):
            entered.set()
            other_ended.wait(1.0)  # the other export has to wait for this one
            return memory, np.full(2, min(readings.joint_angle[0], 0.1))

    def other():
        entered.wait()
        traced_controller(heavy(), joint_pd())
        other_ended.set()

    thread = threading.Thread(target=other)
    thread.start()
    found = traced_controller(heavy(), Slow())
    thread.join()
    assert "fmin" in str(found.functions[0].function.expand()(*found.functions[0].function.sx_in()))
