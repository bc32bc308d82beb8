"""Proposals for a force on a surface: settings of the laws, and the tip along the surface."""

from __future__ import annotations

import pytest
from proposal_requirements import needs_of

import flexarm as fa
from arms import chain
from flexarm.planning.proposals.candidates import candidates_of
from flexarm.planning.proposals.design import _best
from flexarm.planning.proposals.requirements import case_of


def geared_links():
    """Return two tubes of aluminium behind elastic gears."""
    joints = [
        fa.Joint(rotor_inertia=1.5e-4, gear_ratio=100.0, stiffness=15e3, damping=8.0),
        fa.Joint(rotor_inertia=5e-5, gear_ratio=100.0, stiffness=5e3, damping=3.0, mass=2.5),
    ]
    rod = {"flexural_rigidity": [6090.0, 2350.0], "mass_per_length": [0.814, 0.49]}
    return chain((1.0, 0.8), joints, **rod, elements=1, damping=0.01, payload=2.0)


def wiping(**options):
    """Return the requirements of a force on an upright wall, with the drive of a machine."""
    instruments = [
        fa.Instrument("joint_angle", resolution=4.8e-7, rate_cutoff=100.0),
        fa.Instrument("contact_force", noise=0.05, delay=1e-3),
    ]
    hardware = fa.Hardware(instruments, motors=fa.Motors(delay=1e-3, time_constant=2e-3))
    places = {"start": [1.2, 0.4], "end": [1.2, 0.8]}
    return needs_of(geared_links(), "force", force=20.0, hardware=hardware, **places, **options)


def test_hybrid_force_is_tried_with_the_default_integral_of_the_law():
    """Behind elastic gears all faster integrals are unstable."""
    needs = wiping()
    hybrid = candidates_of(needs)[0]
    assert hybrid.name == "hybrid force"
    usual = hybrid.drives[0]["normal_damping"]
    drives = [drive for drive in hybrid.drives if drive["normal_damping"] == usual]
    refusals = []
    for drive in drives:
        (found,) = _best(needs, case_of(needs), [hybrid._replace(drives=(drive,))])[0].values()
        refusals.append(found.refusal)
    assert refusals == ["", *["is unstable"] * 3]
    law = fa.HybridForce(needs.arm, delay=drives[0]["delay"])
    assert drives[0]["force_integral"] == pytest.approx(law.force_integral, rel=0.05)  # rounded
