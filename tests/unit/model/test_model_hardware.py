"""Instruments: the names of their readings."""

import pytest

from flexarm.base.errors import ModelError
from flexarm.model import Instrument


@pytest.mark.parametrize(
    ("instrument", "labels"),
    [
        (Instrument("joint_angle"), ("joint_angle",)),
        (Instrument("joint_angle", rate_cutoff=50.0), ("joint_angle", "joint_rate")),
        (Instrument("strain", name="gauge"), ("gauge",)),
        (Instrument("strain", rate_cutoff=9.0), ("strain", "strain_rate")),
        (Instrument("strain", name="gauge", rate_cutoff=9.0), ("gauge", "gauge_rate")),
        (Instrument("strain", rate_cutoff=9.0, rate_name="speed"), ("strain", "speed")),
    ],
)
def test_rate_has_a_separate_name(instrument, labels):
    assert instrument.labels == labels


def test_names_are_identifiers():
    """They become variables of results, and attributes of measurements."""
    assert Instrument("tip", name="camera_2").label == "camera_2"
    for name in ("my camera", "tip/2", "2nd", "a-b"):
        with pytest.raises(ModelError, match="name must be a word of letters, digits and under"):
            Instrument("tip", name=name)
