"""Answers of any object that acts as a controller: wrong ones end the run with its results."""

import numpy as np
import pytest

import flexarm as fa
from conformance.controller_examples import two_links


@pytest.fixture
def arm():
    return two_links()


class Failing:
    """Returns a constant torque, and from 10 ms on the given answer."""

    sample_time = 0.005

    def __init__(self, answer):
        self.answer = answer

    def reset(self):
        pass

    def update(self, t, measurement, reference):
        return self.answer if t >= 0.01 else np.array([0.1, -0.1])


@pytest.mark.parametrize(
    ("answer", "word"),
    [
        (np.array([np.nan, 0.0]), "nan"),
        (np.array([0.0, np.inf]), "inf"),
        (np.zeros(3), "shape"),
        (0.5, "shape"),
        (None, "shape"),
        ("full speed", "full speed"),
        (np.array([1j, 0.0]), "shape"),
    ],
    ids=["nan", "infinity", "too many", "a number", "nothing", "words", "complex"],
)
def test_wrong_answer_ends_the_run_with_time_and_partial_result(arm, answer, word):
    with pytest.raises(
        fa.SimulationError, match=r"controller returned an unusable value"
    ) as caught:
        fa.simulate(arm, 1.0, controller=Failing(answer), rate=1000.0)
    error = caught.value
    assert error.time == pytest.approx(0.01)
    assert word in str(error)
    assert "t = 0.01 s" in str(error)
    q, qd = error.state
    assert q.shape == qd.shape == (arm.dof,)
    assert error.result.sizes["time"] == 11
    assert np.all(np.isfinite(error.result.q.values))
    np.testing.assert_array_equal(error.result.q.values[-1], q)
    assert "controller" in error.result.attrs["failure"]


def test_wrong_answer_at_the_first_sample(arm):
    class Never(Failing):
        def update(self, t, measurement, reference):
            return [np.nan, np.nan]

    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 1.0, controller=Never(None))
    assert caught.value.time == 0.0
    assert caught.value.state is not None


def test_exception_of_the_controller_is_reported_and_chained(arm):
    class Broken(Failing):
        def update(self, t, measurement, reference):
            raise ZeroDivisionError("gain schedule")

    with pytest.raises(fa.SimulationError, match="ZeroDivisionError: gain schedule") as caught:
        fa.simulate(arm, 1.0, controller=Broken(None))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_any_object_with_the_three_members_is_a_controller(arm):
    class Minimal:
        sample_time = 0.01

        def reset(self):
            self.count = 0

        def update(self, t, measurement, reference):
            self.count += 1
            return [0.1, 0.0]

    controller = Minimal()
    method = {"integrator": "dormand_prince_8"}
    result = fa.simulate(arm, 0.055, controller=controller, **method)
    assert controller.count == 6  # the last torque lasts half a sample time
    steady = fa.simulate(arm, 0.055, torque=lambda t: [0.1, 0.0], **method)
    # Steps end at every hundredth of a second in one run only: the tolerance of the run.
    np.testing.assert_allclose(result.q.values, steady.q.values, rtol=0, atol=1e-8)
