"""Bias of estimates by the mesh, from records without noise."""

import numpy as np
import pytest

import flexarm as fa
from data.bench_records import TWO
from identification.benches import FREE, MESH, NOISE, arm_of, record, truth

pytestmark = pytest.mark.compiled


def bias(elements):
    """Return the errors (parameters,) of estimates, in deviations that noise would cause."""
    free = FREE[TWO.name]
    noise = {channel: NOISE[channel] for channel in ("joint_angle", "strain")}
    clean = record(TWO.name, None, noise=noise, end=1.0)
    arm = arm_of(TWO, elements)
    deviations = fa.identifiability(arm, clean, free).parameters["standard_deviation"].values
    found = fa.identify(arm, clean, free, progress=False)
    return np.array([found[path] - truth(TWO, path) for path in free]) / deviations


@pytest.mark.thorough
def test_gauges_near_the_gauss_points_of_their_elements_bias_no_estimate():
    """A bias of 0.3 deviations lowers the coverage of an interval from 95 % to 94 %."""
    assert np.abs(bias(MESH[TWO.name])).max() < 0.3


@pytest.mark.thorough
def test_a_finer_mesh_with_a_gauge_elsewhere_biases_an_estimate():
    """Gauge 2 at 30 % of its element: a bias of 0.9 lowers the coverage to 85 %."""
    assert np.abs(bias((3, 3))).max() > 0.9
