"""Exports of an arm whose friction has bristles or holds: they warn, or refuse and name it."""

import warnings

import pytest

import flexarm as fa
from bridges.c_code_tools import make
from bristled_joints import RUBBING
from flexarm.base.errors import AccuracyWarning


def rubbing(**friction):
    link = fa.Link(length=0.5, mass_per_length=0.4, flexural_rigidity=15.0, modes=2)
    joints = [fa.Joint(hub_inertia=0.01, friction=fa.Friction(**(friction or RUBBING))), fa.Joint()]
    return fa.Arm(links=[link, link], joints=joints)


def to_jax(arm, folder):
    pytest.importorskip("jax", reason="JAX is not installed: fa.to_jax was not tried")
    fa.to_jax(arm)


#: Exports that have the friction as a function of the rate.
WARNING = {
    "casadi": lambda arm, folder: fa.to_casadi(arm),
    "jax": to_jax,
    "c": lambda arm, folder: fa.export_c(arm, folder / "c"),
    "fmu": lambda arm, folder: fa.export_fmu(arm, folder / "arm.fmu"),
    "matlab": lambda arm, folder: fa.export_mat(arm, folder / "arm.mat"),
}
REFUSING = {
    "mjcf": lambda arm, folder: fa.export_mjcf(arm, folder / "arm.xml"),
    "urdf": lambda arm, folder: fa.export_urdf(arm, folder / "arm.urdf"),
    "exudyn": lambda arm, folder: fa.export_exudyn(arm, folder / "arm.py"),
}


@pytest.mark.thorough_cases("c", "fmu")
@pytest.mark.parametrize("name", WARNING)
def test_exports_warn(name, tmp_path):
    with pytest.warns(AccuracyWarning, match="Bristles"):
        WARNING[name](rubbing(), tmp_path)


@pytest.mark.thorough_cases("c", "fmu")
@pytest.mark.filterwarnings("ignore:.*has the damper in brackets:flexarm.FlexarmWarning")
@pytest.mark.parametrize("name", WARNING)
def test_exports_of_friction_that_holds_warn_once(name, tmp_path):
    with pytest.warns(AccuracyWarning, match=r"arm.joints\[0\]: the exported model") as caught:
        WARNING[name](rubbing(coulomb=0.5), tmp_path)
    assert sum("creeps where it sticks" in str(one.message) for one in caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        WARNING[name](rubbing(coulomb=0.5, smoothing_rate=0.01), tmp_path)


@pytest.mark.parametrize("name", REFUSING)
def test_exports_refuse(name, tmp_path):
    with pytest.raises(fa.InputError, match="friction"):
        REFUSING[name](rubbing(), tmp_path)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.base.errors.FlexarmWarning")
def test_c_code_passes_its_test(tmp_path):
    fa.export_c(rubbing(), tmp_path)
    done = make(tmp_path, "test")
    assert done.returncode == 0, done.stdout + done.stderr
