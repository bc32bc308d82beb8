"""Conversions of arguments, and wrong arguments."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.actions.contacts import arc_of

LINK = fa.Link(
    length=1.0,
    flexural_rigidity=20.0,
    mass_per_length=0.5,
    elements=1,
    gauges=[fa.Gauge(station=0.1, distance=0.005)],
)
ARM = fa.Arm(links=[LINK])


def test_payload_may_be_none():
    assert fa.Arm(links=[LINK], payload=None).spec == ARM.spec


def test_lists_are_accepted_as_arrays():
    q = [0.1, 0.2, 0.3]
    padded = ARM.padded(q)
    np.testing.assert_array_equal(padded, ARM.padded(np.array(q)))
    assert padded.dtype == np.float64
    np.testing.assert_array_equal(ARM.unpadded(padded.tolist()), q)
    np.testing.assert_array_equal(ARM.padded_torque([0.4]), [0.4])
    states = ARM.padded([q, [0.0] * 3])[None]
    np.testing.assert_array_equal(ARM.strains(states.tolist()), ARM.strains(states))


def test_complex_numbers_keep_their_type():
    assert ARM.padded(np.array([1j, 0.0, 0.0])).dtype == np.complex128


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ARM.padded([0.1]), r"vector must be numbers of shape \(\.\.\., 3\)"),
        (lambda: ARM.padded("no"), "vector must be numbers"),
        (lambda: ARM.strains(np.zeros((1, 3))), "states must be numbers"),
        (lambda: ARM.tip(np.ma.array([1.0, 0.0, 0.0], mask=[True, False, False])), "masked"),
        (lambda: fa.RoundWall((0, 0), 2.0, inside="no"), "inside must be true or false"),
        (lambda: fa.RoundWall((0, 0), 2.0, inside=1), "inside must be true or false"),
        (lambda: fa.SurfaceTable([0, 1, 2], [0, 0, 0], closed="no"), "closed must be true"),
        (lambda: fa.modes(ARM).curves(amplitude=np.nan), "amplitude must be finite"),
        (lambda: fa.modes("arm"), "modes: arm must be an Arm, got 'arm'"),
        (lambda: fa.modes(fa.Arm), "arm must be an Arm, got the class Arm"),
        (lambda: fa.rigid_torque(ARM, [0.1]), "motion must be a motion"),
        (lambda: fa.write_result({}, "a.nc"), "result must be a result of simulate"),
        (lambda: fa.load_arm(None), "path must be the path of a file, got nothing"),
        (lambda: fa.save_arm(ARM, "/"), "path must be the path of a file"),
        (lambda: fa.simulate(ARM, 0.1, progress="no"), "progress must be True or False"),
        (lambda: fa.simulate(ARM, 0.1, torque=fa.JointPD), "torque must be a function of time"),
        (lambda: fa.step_jacobian(ARM, [0] * 3, [0] * 3, [0], 5e-324), "be greater than 0"),
        (lambda: fa.smoothed([], 1.0), "motion must be a motion"),
        (lambda: fa.JointPID(1.0, 1.0, sag=2), "sag must be True or False"),
        (lambda: fa.varied(None), "varied: arm must be an Arm"),
    ],
)
def test_arguments_of_the_wrong_kind_are_named(call, words):
    with pytest.raises(fa.InputError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_numpy_booleans_are_accepted():
    assert arc_of(fa.RoundWall((0, 0), 2.0, inside=np.True_))[0] == -0.5


@pytest.mark.parametrize("length", [1e200, 1e-200])
def test_normal_may_have_any_length(length):
    _, _, normal = arc_of(fa.Wall((0.0, 0.0), (0.0, length)))
    np.testing.assert_array_equal(normal, [0.0, 1.0])


def test_gauge_with_overflowing_values_is_rejected():
    far = LINK.replace(gauges=[fa.Gauge(station=0.1, distance=1e308)])
    with pytest.raises(fa.InputError, match=r"gauges\.distance must be small enough"):
        fa.Arm(links=[far])


def test_controllers_check_arguments_of_update():
    controller, reading = fa.JointPD(1.0, 0.1), fa.Measurement(joint_angle=np.zeros(1))
    for t, measurement, reference, name in (
        (np.nan, reading, None, "t"),
        (0.0, {"joint_angle": [0.0]}, None, "measurement"),
        (0.0, reading, "line", "reference"),
        (0.0, reading, fa.PrescribedAngle, "reference"),
    ):
        with pytest.raises(fa.InputError, match=rf"JointPD\.update: {name} must"):
            controller.update(t, measurement, reference)


def test_object_with_a_failing_repr_is_rejected_by_its_type():
    class Unhelpful:
        def __repr__(self):
            raise RuntimeError("no")

    with pytest.raises(fa.InputError, match="Unhelpful"):
        ARM.tip(Unhelpful())
