"""Frequencies of arms: exact solutions, published link modes, closed forms through hub and payload.

The lambda of a beam is omega L^2 sqrt(mu/EI) = (beta L)^2.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

import flexarm as fa

DATA = Path(__file__).parents[1] / "data"
ARM = json.loads((DATA / "arm_frequencies.json").read_text(encoding="utf-8"))
BEAM = json.loads((DATA / "beam_reference.json").read_text(encoding="utf-8"))
SINGLE = [{"joint": "locked", **case} for case in BEAM["clamped"]]
SINGLE += [{"joint": "free", **case} for case in BEAM["pinned"]]


def label(case):
    return " ".join(f"{k}={v}" for k, v in case.items() if k not in ("beta_L", "rad_per_s"))


def paper_arm(elements, **options):
    section = {key: ARM["links"][key] for key in ("flexural_rigidity", "mass_per_length")}
    links = [
        fa.Link(length=length, elements=count, **section)
        for length, count in zip(ARM["links"]["length"], elements, strict=True)
    ]
    return fa.Arm(links=links, **options)


def frequencies(arm, elbow_degrees, joints, count=5):
    """Return the lowest elastic frequencies (rad/s) for any combination of locked and free
    joints."""
    angles = [0.3, np.deg2rad(elbow_degrees)]  # the direction of the whole arm has no effect
    modes = fa.modes(arm, angles, joints=joints)
    rigid = joints.count("free")
    assert np.all(modes.frequency_hz[:rigid] == 0.0)
    assert np.all(modes.frequency_hz[rigid:] > 0.0)
    assert np.all(np.isnan(modes.damping_ratio[:rigid]))
    return 2 * np.pi * modes.frequency_hz[rigid : rigid + count]


@pytest.mark.parametrize("case", ARM["meshes"], ids=label)
def test_finite_element_meshes_to_all_digits(case):
    found = frequencies(paper_arm(case["elements"]), 90.0, case["joints"])
    # the number of published digits
    np.testing.assert_allclose(found, case["rad_per_s"], rtol=1e-9)


@pytest.mark.sampled(
    "elbow_degrees=0 joints=['locked', 'locked']",
    "elbow_degrees=0 joints=['free', 'locked']",
    "elbow_degrees=0 joints=['free', 'free']",
    "elbow_degrees=90 joints=['locked', 'locked']",
    "elbow_degrees=90 joints=['locked', 'free']",
    "elbow_degrees=90 joints=['free', 'free']",
)
@pytest.mark.parametrize("case", ARM["exact"], ids=label)
def test_frequencies_converge_with_fourth_order(case):
    exact = np.array(case["rad_per_s"])
    meshes = [(8, 6), (16, 12), (32, 24)]
    errors = np.array(
        [
            frequencies(paper_arm(mesh), case["elbow_degrees"], case["joints"]) / exact - 1.0
            for mesh in meshes
        ]
    )
    assert np.all(errors > -2e-10)  # upper bounds, to the published digits
    # beta h is 0.6 at most on the finest mesh: (beta h)^4 / 1440.
    np.testing.assert_allclose(errors[-1], 0.0, atol=1e-4)
    for coarse, fine in pairwise(errors):
        seen = fine > 1e-8  # well above the eleventh digit
        np.testing.assert_allclose(np.log2(coarse[seen] / fine[seen]), 4.0, atol=0.25)
    assert np.any(errors[-1] > 1e-8)


def test_first_frequencies_of_the_arm_to_eight_digits():
    """The coarsest published mesh is accurate to a part in a thousand."""
    exact = next(c for c in ARM["exact"] if c["elbow_degrees"] == 90 and "free" not in c["joints"])
    found = frequencies(paper_arm((64, 48)), 90.0, ["locked", "locked"])
    np.testing.assert_allclose(found[:2], exact["rad_per_s"][:2], rtol=2e-8)
    coarse = frequencies(paper_arm((2, 1)), 90.0, ["locked", "locked"])
    np.testing.assert_allclose(coarse[:2], exact["rad_per_s"][:2], rtol=3e-3)


def test_four_reduced_modes_are_as_accurate_as_the_whole_mesh():
    links = [link.model_copy(update={"modes": 4}) for link in paper_arm((16, 16)).spec.links]
    reduced = frequencies(fa.Arm(links=links), 90.0, ["free", "free"], count=2)
    full = frequencies(paper_arm((16, 16)), 90.0, ["free", "free"], count=2)
    assert np.all(reduced >= full * (1 - 1e-12))
    np.testing.assert_allclose(reduced, full, rtol=1e-3)


@pytest.mark.parametrize("case", SINGLE, ids=label)
def test_one_link_with_hub_and_payload(case):
    """With L = EI = mu = 1, hub, payload mass and inertia are the ratios of the closed form."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=24)
    arm = fa.Arm(
        links=[link],
        joints=[fa.Joint(hub_inertia=case.get("hub", 0.0))],
        payload=fa.Payload(mass=case["tip_mass"], inertia=case["tip_inertia"]),
    )
    exact = np.square(case["beta_L"])[:3]
    found = 2 * np.pi * fa.modes(arm, joints=case["joint"]).frequency_hz
    found = found[1:4] if case["joint"] == "free" else found[:3]
    error = found / exact - 1.0
    # Above the exact ones by at most (beta h)^4 / 1440, less if lumps have a part of the kinetic
    # energy.
    assert np.all(error > -1e-10)
    assert np.all(error < 1.02 * (np.sqrt(exact) / 24) ** 4 / 1440 + 1e-10)


@pytest.mark.parametrize("case", BEAM["rayleigh"], ids=label)
def test_rotary_inertia_of_the_sections(case):
    link = fa.Link(
        length=1.0,
        flexural_rigidity=1.0,
        mass_per_length=1.0,
        rotary_inertia_per_length=case["slenderness"] ** -2,
        elements=48,
    )
    joints = "locked" if case["root"] == "clamped" else "free"
    found = 2 * np.pi * fa.modes(fa.Arm(links=[link]), joints=joints).frequency_hz
    found = found[1:] if joints == "free" else found
    exact = np.array(case["lambda"])
    # Mesh error of the third or fourth mode: (beta h)^4 / 1440 of beta = 11.
    np.testing.assert_allclose(found[: exact.size], exact, rtol=3e-6)


@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_axial_payload_offset_equals_a_longer_arm(offset):
    """A point beyond the tip moves by deflection plus offset times slope."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=8)
    arm = fa.Arm(links=[link], payload=fa.Payload(mass=0.7, inertia=0.02, offset=offset))
    bare = fa.Arm(links=[link])
    q = bare.rest([0.0])
    M, K = bare.mass_matrix(q)[1:, 1:], bare.stiffness_matrix(q)[1:, 1:]
    constants = bare.assembly.links[0]
    moved = constants.P + offset * constants.dP
    M = M + 0.7 * np.outer(moved, moved) + 0.02 * np.outer(constants.dP, constants.dP)
    wanted = np.sqrt(eigh(K, M, eigvals_only=True))
    found = 2 * np.pi * fa.modes(arm).frequency_hz
    np.testing.assert_allclose(found[:6], wanted[:6], rtol=1e-9)


def test_link_modes_of_de_luca_and_siciliano():
    """Both links of their arm, with joints and payload as users describe them.

    Link 1 has at its tip the elbow motor, link 2 (with a printed rotary inertia about the joint of
    0.0083) and the payload.
    """
    for case in BEAM["de_luca_siciliano"]:
        link = fa.Link(
            length=case["length"],
            flexural_rigidity=case["flexural_rigidity"],
            mass_per_length=case["mass_per_length"],
            elements=32,
        )
        payload = fa.Payload(mass=case["tip_mass"], inertia=case["tip_inertia"])
        arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)], payload=payload)
        hertz = fa.modes(arm).frequency_hz[:2]
        np.testing.assert_allclose(hertz, case["exact_hz"], rtol=1e-7)  # mesh error of mode two
        np.testing.assert_allclose(hertz, case["published_hz"], rtol=0, atol=0.0051)


def test_gravity_stiffens_a_hanging_link_and_buckles_a_standing_one():
    """Own weight Gamma = mu g L^3 / EI, second-order theory; Greenhill's buckling weight."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=16)

    def lowest(weight, angle):
        arm = fa.Arm(links=[link], gravity=(0.0, -weight), theory="second_order")
        return fa.modes(arm, [angle]).squared_frequency[0]

    for case in BEAM["own_weight"]["hanging"]:
        found = np.sqrt(lowest(case["weight"], -np.pi / 2))
        assert found == pytest.approx(case["lambda"][0], rel=1e-5)  # mesh error at weight 100
    critical = BEAM["own_weight"]["buckling"]
    assert lowest(0.999 * critical, np.pi / 2) > 0.0 > lowest(1.001 * critical, np.pi / 2)
    unstable = fa.Arm(links=[link], gravity=(0.0, -10.0), theory="second_order")
    assert fa.modes(unstable, [np.pi / 2]).frequency_hz[0] == 0.0
