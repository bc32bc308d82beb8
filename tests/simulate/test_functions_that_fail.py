"""Functions of time that raise: the run ends with the time, the reason and a partial result."""

import numpy as np
import pytest

import flexarm as fa

ARM = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
END = 0.3


def torque(t):
    if t > END:
        raise ValueError("the table ends")
    return [0.1]


class Vectorized:
    vectorized = True

    def __call__(self, t):
        if np.any(t > END):
            raise IndexError("beyond the table")
        return np.full((len(t), 1), 0.1)


OPTIONS = {
    "torque": {"torque": torque},
    "vectorized torque": {"torque": Vectorized()},
    "base_acceleration": {"base_acceleration": lambda t: [*torque(t), 0.0]},
    "Load.factor": {"loads": [fa.Load(1, (1.0, 0.0), factor=lambda t: torque(t)[0])]},
}


@pytest.mark.parametrize("name", OPTIONS)
def test_failure_has_time_and_partial_result(name):
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(ARM, 1.0, rate=100.0, **OPTIONS[name])
    error = caught.value
    assert error.time == pytest.approx(END, abs=1e-12)  # found by bisection, to rounding
    assert f"{name.split()[-1]} failed with" in error.reason
    assert isinstance(error.__cause__, ValueError | IndexError)
    assert error.result.sizes["time"] == 31
    assert error.result.attrs["ended_by"] == "failure"
    assert error.result.attrs["failure"] == str(error)
    alone = fa.simulate(ARM, END, rate=100.0, **OPTIONS[name])
    # tolerance of the two runs
    np.testing.assert_allclose(error.result.q, alone.q, rtol=0.0, atol=1e-9)


def test_function_that_always_fails_leaves_no_result():
    with pytest.raises(fa.SimulationError, match="torque failed with ZeroDivisionError") as caught:
        fa.simulate(ARM, 1.0, torque=lambda t: [1 / 0])
    assert caught.value.time == 0.0
    assert caught.value.result is None


def test_errors_of_flexarm_are_not_wrapped():
    def wrong(t):
        return fa.rigid_torque(ARM, "motion")(t)

    with pytest.raises(fa.InputError, match="motion must be a motion"):
        fa.simulate(ARM, 1.0, torque=wrong)


def test_prescribed_angle_that_fails_is_reported():
    moved = fa.PrescribedAngle(lambda t: 1 / 0, lambda t: 0.0, lambda t: 0.0)
    with pytest.raises(fa.SimulationError, match=r"prescribed\[1\].* ZeroDivisionError"):
        fa.simulate(ARM, 1.0, prescribed={1: moved})
