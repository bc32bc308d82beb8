"""Exported controllers that damp vibration, along references that compute their own bending."""

import numpy as np
import pytest

import flexarm as fa
from bridges.test_c_controllers import DAMPING, LAWS, InC, heavy


class Beside(fa.Controller):
    """A controller that damps vibration, with its torques in C, with and without correction."""

    def __init__(self, controller, with_, without):
        self.controller, self.in_c = controller, (with_, without)
        self.sample_time, self.torques = controller.sample_time, []

    def requirements(self, arm, reference):
        return self.controller.requirements(arm, reference)

    def reset(self):
        for one in (self.controller, *self.in_c):
            one.reset()

    def update(self, t, measurement, reference):
        in_c, ahead = self.in_c, getattr(self.controller.inner, "feedforward", None)
        for one in in_c:
            one.added = [np.array(ahead(t + 0.5 * self.sample_time))] if ahead else []
        in_c[0].added.insert(0, self.controller.strain_correction(t, reference))
        in_c[1].added.insert(0, None)
        torque = self.controller.update(t, measurement, reference)
        found = [one.update(t, measurement, reference) for one in in_c]
        self.torques.append([torque, *found])
        return torque


@pytest.mark.thorough
@pytest.mark.parametrize("name", DAMPING)
def test_reference_that_computes_its_bending(name, tmp_path):
    """The recorded run along a quasi-static reference, with its strains as input."""
    arm, controller = heavy(), LAWS[name]()
    fa.export_c(arm, tmp_path, controller=controller)
    motion = fa.joint_motion(arm, [0.1, 0.6], [0.4, 0.3], 0.5)
    reference = fa.quasi_static_reference(arm, motion)
    readings = ["joint_angle", "joint_rate", "strain"]
    references = ["joint_angle", "joint_rate", "joint_acceleration"]
    both = [InC(tmp_path, readings, references) for _ in range(2)]
    beside = Beside(controller, *both)
    fa.simulate(arm, 0.8, controller=beside, reference=reference, initial=reference.initial)
    wanted, found, static = np.moveaxis(beside.torques, 1, 0)
    largest = np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * largest)
    assert np.abs(static - wanted).max() > 1e-3 * largest
    times = np.linspace(-0.1, 0.9, 5)
    rows = controller.strain_correction(times, reference)
    one = controller.strain_correction(times[2], reference)
    np.testing.assert_allclose(rows[2], one, rtol=0, atol=1e-15)
    assert not controller.strain_correction(times, motion).any()
    with pytest.raises(fa.InputError, match="t must be a time"):
        controller.strain_correction("now", reference)
    with pytest.raises(fa.InputError, match="joint_angle"):
        controller.strain_correction(0.0, None)
