"""Constants of links from columns of section properties, which may be lists."""

from __future__ import annotations

import numpy as np

from flexarm.arm.beams import BeamTable, link_constants, rigid_constants


def flexible_link(
    x,
    flexural_rigidity,
    mass_per_length,
    rotary_inertia_per_length,
    *,
    shear_rigidity=None,
    elements,
    modes=None,
):
    columns = [x, flexural_rigidity, mass_per_length, rotary_inertia_per_length]
    if shear_rigidity is not None:
        columns.append(shear_rigidity)
    return link_constants(BeamTable(*np.array(columns, dtype=float)), elements, modes)


def rigid_link(x, mass_per_length, rotary_inertia_per_length, elements=1):
    columns = np.array([x, np.ones(len(x)), mass_per_length, rotary_inertia_per_length])
    return rigid_constants(BeamTable(*columns), elements)
