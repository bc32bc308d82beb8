"""Records of joints that slide: units of length and force, and results that are read back."""

import numpy as np
import pandas as pd
import pytest

import flexarm as fa
from flexarm.identification.inspection import inspected
from flexarm.identification.record import Label, slides_of

TIMES = np.arange(50) / 100.0
ANGLE = 10.0 * np.sin(8.0 * TIMES)  # degrees
FORCE = np.cos(5.0 * TIMES)


def test_slides_are_in_metres_and_newtons(tmp_path):
    path, position = tmp_path / "bench.csv", np.where(TIMES < 0.25, 0.1, 6.5) + 20.0 * TIMES
    columns = {"joint_angle_1 [mm]": 1e3 * position, "torque_1 [kN]": FORCE / 1e3}
    columns |= {"joint_angle_2 [deg]": ANGLE, "torque_2": FORCE}
    pd.DataFrame({"t": TIMES, **columns}).to_csv(path, index=False)
    data = fa.read_record(path).data
    # As given, although the step of 6.4 m is about two pi.
    np.testing.assert_allclose(data["joint_angle"][:, 0], position, rtol=1e-12)
    np.testing.assert_allclose(data["joint_angle"][:, 1], np.deg2rad(ANGLE), rtol=1e-12)
    np.testing.assert_allclose(data["torque"], np.stack([FORCE, FORCE], axis=1), rtol=1e-12)
    assert data["joint_angle"].units == "rad or m"
    assert data["torque"].units == "N m or N"
    checked, sentences = inspected("bench", fa.MeasuredRecord(data))
    assert not [text for text in sentences if "whole turn" in text]
    np.testing.assert_array_equal(checked.data["joint_angle"][:, 1], data["joint_angle"][:, 1])
    assert slides_of(checked.data) == {Label("joint_angle", 1), Label("torque", 1)}
    pd.DataFrame({"t": TIMES, "joint_angle_1": position}).to_csv(path, index=False)
    with pytest.raises(fa.InputError, match=r"'rad', or 'm' of a sliding joint\.$"):
        fa.read_record(path)
    pd.DataFrame({"t": TIMES, "tip_x [N]": FORCE}).to_csv(path, index=False)
    with pytest.raises(fa.InputError, match=r"be a unit of its channel \(m, cm, mm, um\)"):
        fa.read_record(path)


@pytest.mark.parametrize("kind", ["csv", "nc"])
def test_results_of_slides_are_read_back(kind, tmp_path):
    link = fa.Link(length=0.5, mass_per_length=2.0, flexible=False)
    slide = fa.Joint(kind="prismatic")
    for joints in ([slide], [slide, fa.Joint()]):
        arm = fa.Arm(links=[link] * len(joints), joints=joints)
        result = fa.simulate(arm, 0.2, torque=np.tile([5.0, 0.3][: len(joints)], (201, 1)))
        path = tmp_path / f"slide.{kind}"
        fa.write_result(result, path)
        data = fa.read_record(path).data
        for name in ("joint_angle", "torque"):
            np.testing.assert_allclose(data[name], result[name], rtol=1e-12, atol=1e-15)
            assert data[name].units == result[name].units
