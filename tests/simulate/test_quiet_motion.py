"""An arm that turns without bending: its step is limited by the samples between ends of steps."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate.steps import LONGEST
from flexarm.simulation.run.tolerance import fastest_frequency


@pytest.mark.parametrize("integrator", ["dormand_prince_8"])
def test_samples_between_long_steps(integrator):
    link = fa.Link(length=1.0, mass_per_length=3.0, flexural_rigidity=60.0)
    arm = fa.Arm(links=[link])
    rates = arm.rest([1.2])
    result = fa.simulate(arm, 0.5, initial_rate=rates, rtol=1e-10, integrator=integrator)
    turned = 1.2 * result.time.values
    # Rounding, times its amplification over seven radians of the fastest mode.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], turned, rtol=0, atol=1e-9)
    assert abs(result.link_tip_deflection.values).max() < 1e-9
    fastest = fastest_frequency(arm, arm.padded(np.stack([rates * 0, rates])))
    assert result.steps >= 0.5 * fastest / LONGEST
