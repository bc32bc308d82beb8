"""Constructors of controllers, made from the declared parameters."""

import functools
import inspect
import pickle

import numpy as np
import pytest
import xarray as xr
from rigid_loops import rigid_arm

import flexarm as fa
from flexarm.model.drives import CONTROLLED


def test_arguments_by_position_and_by_name_are_equal():
    by_position = fa.JointPD([8.0, 3.0], 0.8, 0.004, np.sin)
    by_name = fa.JointPD(
        feedforward=np.sin, sample_time=0.004, derivative=0.8, proportional=[8.0, 3.0]
    )
    for made in (by_position, by_name):
        assert made.sample_time == 0.004
        assert made.feedforward is np.sin
        np.testing.assert_array_equal(made.proportional, [8.0, 3.0])
    assert list(inspect.signature(fa.JointPD).parameters) == [
        "proportional",
        "derivative",
        "sample_time",
        "feedforward",
    ]


@pytest.mark.parametrize(
    "value",
    [3.0, 3, np.float32(3.0), np.array(3.0), [3.0, 3.0], (3, 3.0), xr.DataArray([3.0, 3.0])],
    ids=str,
)
def test_values_for_each_joint_become_an_array(value):
    made = fa.Adaptive(rigid_arm(), 2.0, value, 0.1)
    assert made.damping.dtype == np.float64
    np.testing.assert_array_equal(made.damping, [3.0, 3.0])


def test_defaults_for_each_joint_become_an_array():
    arm = rigid_arm()
    made = fa.SlidingMode(arm, 1.0, 0.1)
    np.testing.assert_array_equal(made.disturbance, [0.0, 0.0])
    # 1 % of the torque for a quarter of the squared rate, which the sample time limits.
    rate = 0.0064 / made.sample_time
    inertia = np.diag(arm.mass_matrix([0.0, 0.0]))
    np.testing.assert_allclose(made.reaching, 0.01 * inertia * rate**2 / 4.0, rtol=1e-9)


def test_object_does_not_share_the_array_of_its_caller():
    gains = np.array([8.0, 3.0])
    made = fa.JointPD(gains, gains)
    gains[:] = 0.0
    np.testing.assert_array_equal(made.proportional, [8.0, 3.0])


def test_problems_of_values_lists_and_objects_are_reported_together():
    with pytest.raises(fa.InputError) as caught:
        fa.DisturbanceObserver("arm", "PD", [1.0, -1.0], compensation=2.0)
    names = [problem.name for problem in caught.value.problems]
    assert names == ["arm", "inner", "cutoff[1]", "compensation"]
    with pytest.raises(fa.InputError) as caught:
        fa.Adaptive(rigid_arm(), [1.0] * 3, -1.0, 0.1)
    assert [problem.name for problem in caught.value.problems] == ["damping", "bandwidth"]


def test_file_and_constructor_report_the_same_rule():
    kind = CONTROLLED["hybrid_force"]
    with pytest.raises(fa.InputError) as of_file:
        kind(frequency=-1.0, touch_force="much")
    with pytest.raises(fa.InputError) as of_class:
        fa.HybridForce(rigid_arm(), frequency=-1.0, touch_force="much")
    rules = [[(p.name, p.rule) for p in e.value.problems] for e in (of_file, of_class)]
    assert rules[0] == rules[1]
    assert len(rules[0]) == 2


class Own(fa.JointPD):
    """A controller of a user, whose annotations declare attributes."""

    seen: int
    log: "NameOfAnotherModule"  # noqa: F821

    def __init__(self, gain):
        super().__init__(gain, 0.1 * gain)
        self.seen = 0


def test_subclass_of_a_user_has_its_own_constructor():
    made = Own(10.0)
    assert made.proportional == 10.0
    assert made.derivative == 1.0
    assert list(inspect.signature(Own).parameters) == ["gain"]
    assert Own.__doc__ == "A controller of a user, whose annotations declare attributes."


def test_docstring_has_every_argument_with_its_unit():
    text = inspect.getdoc(fa.HybridForce)
    assert text.index("Position control") < text.index("Args:") < text.index("Raises:")
    for name in inspect.signature(fa.HybridForce).parameters:
        assert f"\n    {name}: " in text
    assert "force_integral: Integral gain of the force error" in text
    assert "(N s/m)" in text


@pytest.mark.parametrize("kind", ["lqg", "estimator"])
def test_drives_can_be_pickled(kind):
    inner = {"inner": {"kind": "lqg"}} if kind == "estimator" else {"posture": [0.1]}
    drive = CONTROLLED[kind](**inner)
    assert pickle.loads(pickle.dumps(drive)) == drive


def test_an_update_around_that_of_a_base_class_is_called_in_loops():
    """``functools.wraps`` copies attributes, so that a mark on a function would follow it."""

    class Silent(fa.JointPD):
        @functools.wraps(fa.JointPD.update)
        def update(self, t, measurement, reference):
            return np.zeros(2)

    arm = rigid_arm()
    quiet = fa.simulate(arm, 0.02, controller=Silent(8.0, 0.8, 0.004), initial=[0.3, -0.2])
    np.testing.assert_array_equal(quiet.torque, 0.0)
    law = Silent(8.0, 0.8, 0.004)
    law.update = lambda t, measurement, reference: np.ones(2)
    np.testing.assert_array_equal(fa.simulate(arm, 0.02, controller=law).torque, 1.0)
