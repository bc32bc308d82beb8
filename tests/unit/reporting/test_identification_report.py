"""The page of an identification, from its result and from its file."""

import re
import warnings
from functools import cache

import numpy as np
import pytest
import xarray as xr

import flexarm as fa

FREE = ["links[0].flexural_rigidity", "joints[0].hub_inertia", "joints[0].mass"]


def arm():
    gauge = {"station": 0.1, "distance": 0.002}
    link = {"length": 0.5, "flexural_rigidity": 8.0, "mass_per_length": 0.4, "elements": 1}
    joint = fa.Joint(hub_inertia=0.02, mass=0.3)
    return fa.Arm(links=[{**link, "gauges": [gauge]}], joints=[joint])


@cache
def found():
    """Return an identification with a gap, a parameter without effect, and a validation."""
    torque = fa.multisine(0.25, (4.0, 24.0), 0.2, rise=0.05).samples(200.0, 0.5)
    result = fa.simulate(arm(), 0.5, torque=torque, rate=200.0, rtol=1e-7)
    random = np.random.default_rng(0)
    records = []
    for _ in range(2):
        data = result[["torque", "joint_angle", "strain"]].copy(deep=True)
        data["joint_angle"] = data["joint_angle"] + 1e-4 * random.standard_normal((101, 1))
        data["strain"] = data["strain"] + 1e-6 * random.standard_normal((101, 1))
        data["strain"][30:40] = np.nan
        records.append(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.IdentifiabilityWarning)
        return fa.identify(
            arm(), {"<bench>": records[0]}, FREE, validation=records[1], progress=False
        )


@pytest.mark.thorough
def test_the_page_has_estimates_fits_and_statements():
    page = fa.report(found(), title="A & B", notes="a < b")
    assert page.startswith("<!DOCTYPE html>")
    for text in ("A &amp; B", "a &lt; b", "&lt;bench&gt;", "validation 1, not fitted"):
        assert text in page
    assert "<bench>" not in page
    for path, _, estimate, *_ in found().rows():
        assert re.search(rf"{re.escape(path)}</th><td>.*</td><td>{estimate}</td>", page)
    assert "The data do not determine the mass of joint 1" in page
    assert "Correlations of the estimates" in page
    assert page.count("<svg") == 5
    assert "<image" not in page  # the page allows no pixel images
    assert "http://" not in re.sub(r'(xmlns[:a-z]*|rdf:\w+)="[^"]*"', "", page.split("<svg")[0])
    assert "<script" not in page
    assert len(page.encode()) < 1_000_000


@pytest.mark.thorough
def test_a_file_has_the_same_page(tmp_path):
    path = tmp_path / "found.nc"
    fa.write_result(found().to_dataset(), path)
    again = fa.read_result(path)
    assert fa.report(again, title="x") == fa.report(found(), title="x")
    restored = fa.Identification.from_dataset(again)
    assert restored.arm.spec == found().arm.spec
    assert restored.noise == found().noise
    xr.testing.assert_allclose(restored.histories["<bench>"], found().histories["<bench>"])
    assert str(restored) == str(found())


def test_a_record_with_a_controller_keeps_its_history(tmp_path):
    motion = fa.joint_motion(arm(), [0.0], [0.3], 0.2)
    pd = fa.JointPD([6.0], [0.6], sample_time=0.01)
    result = fa.simulate(arm(), 0.3, controller=pd, reference=motion, rate=100.0)
    record = fa.MeasuredRecord(result, outputs=["joint_angle"], controller=pd, reference=motion)
    own = fa.identify(arm(), record, FREE[1:2], progress=False)
    path = tmp_path / "found.nc"
    fa.write_result(own.to_dataset(), path)
    again = fa.read_result(path)
    restored = fa.Identification.from_dataset(again)
    xr.testing.assert_equal(restored.histories["record 1"], own.histories["record 1"])
    assert restored.histories["record 1"]["driven"].shape == (31, 0)
    assert fa.report(again, title="x") == fa.report(own, title="x")


@pytest.mark.thorough
def test_a_file_keeps_the_version_that_computed_it():
    stored = found().to_dataset().assign_attrs(flexarm_version="0.0.7")
    restored = fa.Identification.from_dataset(stored)
    assert restored.to_dataset().attrs["flexarm_version"] == "0.0.7"
    page = fa.report(stored)
    assert "Report of an identification by flexarm 0.0.7" in page
    assert f'content="flexarm {found().flexarm_version}"' in page  # what wrote the page
    assert found().flexarm_version == fa.__version__


def test_wrong_arguments(tmp_path):
    with pytest.raises(fa.InputError, match="may be path, title and notes"):
        fa.report(found(), magnify=2.0)
    with pytest.raises(fa.InputError, match="does not contain an identification"):
        fa.Identification.from_dataset(xr.Dataset())
    with pytest.raises(fa.InputError, match="contains a damaged identification"):
        fa.Identification.from_dataset(xr.Dataset(attrs={"identification": "{}"}))
    with pytest.raises(fa.InputError, match=r"\.nc"):
        fa.write_result(found().to_dataset(), tmp_path / "found.csv")
