"""Conversions of arguments, and wrong arguments."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.assembly.surfaces import arc_of

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


def test_numpy_booleans_are_accepted():
    assert arc_of(fa.RoundWall((0, 0), 2.0, inside=np.True_))[0] == -0.5


@pytest.mark.parametrize("length", [1e200, 1e-200])
def test_normal_may_have_any_length(length):
    _, _, normal = arc_of(fa.Wall((0.0, 0.0), (0.0, length)))
    np.testing.assert_array_equal(normal, [0.0, 1.0])


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
