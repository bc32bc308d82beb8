"""Linear models in files for MATLAB and other programs."""

import json

import numpy as np
import pytest
from scipy.io import loadmat

import flexarm as fa


@pytest.fixture(scope="module")
def model():
    arm = fa.Arm(
        links=[fa.Link(length=1.0, flexural_rigidity=2.0, mass_per_length=1.0, elements=1)]
    )
    return fa.linearize(arm, inputs=["torque", "tip_moment"], outputs=["tip"])


def test_matlab_file_has_matrices_and_names(model, tmp_path):
    fa.save_linear(model, tmp_path / "arm.mat")
    read = loadmat(tmp_path / "arm.mat")
    for name in ("A", "B", "C", "D", "mass", "damping", "stiffness"):
        np.testing.assert_array_equal(read[name], getattr(model, name))
    assert [str(cell[0]) for cell in read["inputs"].ravel()] == ["torque[1]", "tip_moment"]
    assert [str(cell[0]) for cell in read["output_units"].ravel()] == ["m", "m"]
    assert read["q"].shape == (3, 1)


def test_json_file_has_matrices_and_names(model, tmp_path):
    fa.save_linear(model, tmp_path / "arm.json")
    read = json.loads((tmp_path / "arm.json").read_text())
    np.testing.assert_array_equal(read["A"], model.A)
    assert read["states"] == list(model.states)
    assert read["state_units"][:2] == ["rad", "m kg^0.5"]


def test_other_formats_are_rejected(model, tmp_path):
    with pytest.raises(fa.InputError, match=r"end in .mat or .json"):
        fa.save_linear(model, tmp_path / "arm.csv")


@pytest.mark.parametrize("wrong", [None, np.eye(2), "arm.mat"])
def test_wrong_object_is_rejected_before_a_folder_is_created(wrong, tmp_path):
    with pytest.raises(fa.InputError, match="save_linear: model must be a LinearModel"):
        fa.save_linear(wrong, tmp_path / "new" / "arm.mat")
    assert list(tmp_path.iterdir()) == []


def test_every_saving_function_creates_missing_folders(model, tmp_path):
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=2.0, mass_per_length=1.0)])
    fa.save_linear(model, tmp_path / "a" / "arm.mat")
    fa.save_arm(arm, tmp_path / "b" / "arm.yaml")
    separation = fa.linearize_along(arm, fa.joint_motion(arm, [0.0], [0.5], 1.0), rate=10.0)
    separation.save(tmp_path / "c" / "along.npz")
    made = sorted(path.name for path in tmp_path.rglob("*.*"))
    assert made == ["along.npz", "arm.mat", "arm.yaml"]
    with pytest.raises(fa.InputError, match="path must be in a writable folder"):
        separation.save(tmp_path / "a" / "arm.mat" / "along.npz")
