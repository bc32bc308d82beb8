"""Warnings of records whose times are probably in milliseconds."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.identification.record import check_records
from flexarm.identification.runs import RecordRun, warn_of_work
from flexarm.identification.space import Space, check_free

pytestmark = pytest.mark.compiled


def warned(factor):
    """Return the warnings for a record of 3 s whose times are multiplied by ``factor``."""
    link = fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=0.5, elements=2, modes=2)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)])
    result = fa.simulate(arm, 3.0, torque=lambda t: [np.sin(20.0 * t)], rate=1000.0)
    scaled = result.assign_coords(time=factor * result.time)
    records = check_records("records", scaled)
    options = {"integrator": "dormand_prince_8"}
    runs = [RecordRun(name, record, arm, options) for name, record in records.items()]
    space = Space(arm, None, check_free(["links[0].flexural_rigidity"]), records)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_work(runs, space)
    return [str(one.message) for one in caught]


def test_a_record_in_milliseconds_warns_before_the_fit():
    assert warned(1.0) == []
    (text,) = warned(1000.0)
    assert "lasts 3000 s with a sample every 1 s" in text
    assert text.endswith("these may be milliseconds")


def test_a_file_in_milliseconds_without_a_unit_stops_before_the_fit(tmp_path):
    link = fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=0.5, elements=2, modes=2)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)])
    times = np.arange(0, 3000)
    lines = [f"{t},{np.sin(0.02 * t)},0.0" for t in times]
    path = tmp_path / "bench.csv"
    path.write_text("t,torque_1,joint_angle_1\n" + "\n".join(lines))
    free, method = ["links[0].flexural_rigidity"], {"integrator": "dormand_prince_8"}
    with pytest.raises(fa.InputError, match='Give time_unit="ms", or "s" if they are right'):
        fa.identify(arm, fa.read_record(path), free, progress=False, **method)
    assert "assumed" not in fa.read_record(path, time_unit="ms").data["time"].attrs


@pytest.mark.thorough
def test_estimates_in_another_unit_warn():
    """Times in milliseconds that the default method simulates at once: an inertia is 1e6 times."""
    link = fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.5, elements=2, modes=2)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1, damping=0.1)])
    times = np.arange(51) / 100.0
    result = fa.simulate(arm, 0.5, torque=np.sin(12.0 * times)[:, None], rate=100.0)
    record = result[["torque", "joint_angle"]].assign_coords(time=1000.0 * times)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fa.identify(arm, record, ["joints[0].hub_inertia"], progress=False)
    texts = [str(message.message) for message in caught]
    assert any("hub_inertia" in text and "milliseconds" in text for text in texts), texts
