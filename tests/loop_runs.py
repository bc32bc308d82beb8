"""Runs with controllers that the tests of batches compare with single runs."""

import numpy as np

import flexarm as fa
from conformance.controller_examples import SAMPLE_TIME, two_links

ARM = two_links()
MOTION = fa.joint_motion(ARM, [0.4, 0.1], [0.5, 0.0], 0.4)
STARTS = np.array([ARM.rest([0.4 + 0.01 * k, 0.1 - 0.01 * k]) for k in range(11)])
DURATION, RATE = 0.05, 400.0
SHORT = {"duration": DURATION, "rate": RATE}
CHANNELS = ["tip", "torque", "torque_command", "strain"]


class Integral:
    """A user's controller with a state, of one run at a time."""

    sample_time = SAMPLE_TIME

    def reset(self):
        self.sum, self.calls = np.zeros(2), 0

    def update(self, t, measurement, reference):
        self.calls += 1
        error = reference.joint_angle(t) - measurement.joint_angle
        self.sum += self.sample_time * error
        return 5.0 * error + 20.0 * self.sum


def compare(batch, runs, arm=ARM, **own):
    """Compare runs of a batch with single results; items of ``own`` are functions of the run."""
    for k in runs:
        given = {name: value(k) for name, value in own.items()}
        single = fa.simulate(arm, initial=STARTS[k], **given, **SHORT)
        for name in CHANNELS:
            np.testing.assert_array_equal(batch[name][k], single[name], err_msg=name)
        found = [single.attrs["unstable_loop"], single.attrs["warning"]]
        assert batch["warning"][k] == " ".join(filter(None, found))
        for name in ("steps", "evaluations", "integrator", "ended_by", "failure"):
            assert batch[name][k] == single.attrs[name], name
        growth = batch["loop_growth"].values[k] if "loop_growth" in batch else np.nan
        np.testing.assert_array_equal(growth, single.attrs.get("loop_growth", np.nan))
