"""Wrong arguments of an arm's methods: too large numbers, too few stations."""

import numpy as np
import pytest

import flexarm as fa

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
LINK = fa.Link(length=1.0, elements=2, **ROD)
ARM = fa.Arm(links=[LINK, LINK], theory="second_order", gravity=(0.0, -9.81))
HUGE, ZERO, NONE = np.full(ARM.dof, 1e300), np.zeros(ARM.dof), np.zeros(2)

CALLS = {
    "forward_dynamics": (HUGE, ZERO, NONE),
    "inverse_dynamics": (HUGE, ZERO, ZERO),
    "inverse_dynamics_many": ([HUGE], [ZERO], [ZERO]),
    "joint_reactions": (HUGE, ZERO, ZERO),
    "mass_matrix": (HUGE,),
    "stiffness_matrix": (HUGE,),
    "bias_force": (ZERO, HUGE),
    "derivatives": (HUGE, ZERO, NONE),
    "energy": (ZERO, HUGE),
    "tip": (HUGE,),
    "tip_velocity": (HUGE, HUGE),
    "shape": (HUGE,),
}


@pytest.mark.parametrize("method", CALLS)
def test_numbers_too_large_to_compute_with_are_rejected(method):
    with pytest.raises(fa.InputError) as caught:
        getattr(ARM, method)(*CALLS[method])
    assert str(caught.value) == (
        f"Arm.{method}: the result is not finite. The largest number given is 1e+300."
    )


@pytest.mark.parametrize("stations", [0, -3, 1, 2.0, "many", None])
def test_shape_needs_two_stations_at_least(stations):
    with pytest.raises(fa.InputError, match=r"Arm\.shape: stations must be a whole number from 2"):
        ARM.shape(ZERO, stations)
    assert ARM.shape(ZERO, np.int64(2)).shape == (2, 2, 2)


def test_shape_does_not_depend_on_earlier_calls():
    q = ARM.rest([0.3, -0.4])
    q[1] = 0.02
    other = fa.Arm(ARM.spec)
    for stations in (5, 9, 9, 5):
        found = ARM.shape(q, stations)
        np.testing.assert_array_equal(found, fa.Arm(ARM.spec).shape(q, stations))
        found[:] = np.nan  # the caller may change its array
    np.testing.assert_array_equal(ARM.shape(q, 5), other.shape(q, 5))
