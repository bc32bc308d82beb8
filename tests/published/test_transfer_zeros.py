"""From a motor's torque to its encoder: poles are the hub's frequencies, zeros the clamped ones.

They interlace, as between any force and the displacement that it works on.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa

DATA = Path(__file__).parents[1] / "data"
BEAM = json.loads((DATA / "beam_reference.json").read_text(encoding="utf-8"))
CLAMPED = np.square(BEAM["clamped"][0]["beta_L"])
HUBS = [case for case in BEAM["pinned"] if case["hub"] > 0.0 and case["tip_mass"] == 0.0]


def lowest(values, count):
    """Frequencies on the imaginary axis, each once, ascending; rigid-body poles left out."""
    assert np.abs(values.real).max() < 1e-4 * np.abs(values).max()
    return np.sort(values.imag[values.imag > 1e-2])[:count]


@pytest.mark.parametrize("case", HUBS, ids=lambda case: f"hub={case['hub']}")
def test_from_torque_to_encoder(case):
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=12)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=case["hub"])])
    system = fa.linearize(arm).to_control()
    zeros, poles = lowest(system.zeros(), 3), lowest(system.poles(), 3)
    # Of the mesh: (beta h)^4 / 1440, 1.3e-4 in the third.
    np.testing.assert_allclose(zeros, CLAMPED[:3], rtol=2e-4)
    np.testing.assert_allclose(poles, np.square(case["beta_L"][:3]), rtol=2e-4)
    together = [value for pair in zip(zeros, poles, strict=True) for value in pair]
    assert all(low < high for low, high in pairwise(together))
