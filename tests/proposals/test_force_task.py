"""Proposals for a force on a surface: settings of the laws, and the tip along the surface."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from proposal_requirements import needs_of

import flexarm as fa
from arms import chain
from flexarm.planning.proposals.candidates import Assessed, candidates_of
from flexarm.planning.proposals.design import _best, _chosen, _refusal, _table, reasons_of
from flexarm.planning.proposals.requirements import case_of
from flexarm.simulation.run.progress import unreported


def geared_links():
    """Return two tubes of aluminium behind elastic gears."""
    joints = [
        fa.Joint(rotor_inertia=1.5e-4, gear_ratio=100.0, stiffness=15e3, damping=8.0),
        fa.Joint(rotor_inertia=5e-5, gear_ratio=100.0, stiffness=5e3, damping=3.0, mass=2.5),
    ]
    rod = {"flexural_rigidity": [6090.0, 2350.0], "mass_per_length": [0.814, 0.49]}
    return chain((1.0, 0.8), joints, **rod, elements=1, damping=0.01, payload=2.0)


def wiping(arm=None, **options):
    """Return the requirements of a force on an upright wall, with the drive of a machine."""
    instruments = [
        fa.Instrument("joint_angle", resolution=4.8e-7, rate_cutoff=100.0),
        fa.Instrument("contact_force", noise=0.05, delay=1e-3),
    ]
    hardware = fa.Hardware(instruments, motors=fa.Motors(delay=1e-3, time_constant=2e-3))
    more = {"force": 20.0, "hardware": hardware, "start": [1.2, 0.4], "end": [1.2, 0.8]}
    return needs_of(arm or geared_links(), "force", **more, **options)


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


def test_a_tip_that_leaves_its_path_is_not_accepted_whatever_its_force_is():
    needs = wiping()  # a path of 0.4 m, of which the tip may miss 20 mm
    margins = {"gain_margin": 2.0, "phase_margin": 0.5, "delay_margin": 0.1, "damping_ratio": 0.1}
    sound = Assessed(needs, {}, {"disk_margin": 0.5, "growth": -1.0, **margins}, 2)
    names = ["hybrid force", "impedance"]
    found = dict.fromkeys(names, sound)
    listed = [one for one in candidates_of(needs) if one.name in names]

    def table_of(*tips):
        force, tip = np.array([[[3.0], [2.0]], [[tip] for tip in tips]])
        dims = ("candidate", "plant")
        values = {"score": (dims, force), "tip_error_settled": (dims, tip)}
        coords = {"candidate": names, "plant": ["nominal"]}
        return xr.Dataset({**values, "saturation": (dims, 0.0 * tip)}, coords)

    table = table_of(0.019, 0.264)
    assert _chosen(needs, found, table) == "hybrid force"
    assert _refusal(needs, found, table, "hybrid force") == ""
    narrow = sound._replace(margins={**sound.margins, "disk_margin": 0.2})
    assert _chosen(needs, {**found, "hybrid force": narrow}, table) == "hybrid force"
    first, second, *_ = reasons_of(needs, listed, found, table, "hybrid force")
    assert "force at most 3 N, settled error of the tip at most 19 mm, on the" in first
    assert second.startswith(
        "impedance: 2 N, and the tip settles 264 mm from its goal, more than 5%"
    )
    table = table_of(0.021, 0.264)
    assert "settles 264 mm from its goal" in _refusal(needs, found, table, "impedance")
    assert _chosen(needs, found, table_of(0.019, 0.018)) == "impedance"  # with the smaller force


@pytest.mark.thorough
def test_the_table_has_the_sag_of_a_soft_tip_along_the_surface():
    """Weight of the payload that the model lacks over the stiffness of the tip along the wall."""
    arm = fa.Arm(geared_links().spec.replace(gravity=(0.0, -9.81)))
    needs = wiping(arm=arm, payload_uncertainty=0.5)
    impedance = candidates_of(needs)[-1]
    setting = impedance._replace(drives=impedance.drives[:1])
    content = case_of(needs)
    content["plants"] = {name: content["plants"][name] for name in ("nominal", "heavy")}
    found, _ = _best(needs, content, [setting])
    table = _table(needs, content, found, unreported).sel(candidate="impedance")
    law = fa.Impedance(arm, delay=setting.drives[0]["delay"])
    sag = 0.5 * 2.0 * 9.81 / law.tangent_stiffness
    # The damped tip has settled to a hundredth, and the links bend by millimetres.
    assert table.tip_error_settled.sel(plant="heavy") == pytest.approx(sag, rel=0.03)
    assert table.tip_error_settled.sel(plant="nominal") < needs.farthest < sag
