"""Reference values of the gallery, recomputed without the package."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from exact_beam import RitzBeam, TangentAngle, two_link_frequencies
from gallery.references import DATA, history, reference
from gallery.two_link import LENGTHS, ROD
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.signal import lsim
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc, jv

#: Accuracy of Ritz's method with sixteen polynomials, and of the last printed digits.
CLOSE = {"rtol": 2e-10, "atol": 0.0}


def values(file, group):
    return reference(file, group).values


def test_every_group_states_its_source():
    for path in DATA.glob("*.json"):
        for group in json.loads(path.read_text(encoding="utf-8")):
            source = reference(path.stem, group).source
            assert source.cite
            assert len(source.full) > 40, (path.name, group)


def test_plain_beams():
    clamped = values("beams", "clamped")["lambda"]
    np.testing.assert_allclose(RitzBeam("clamped").frequencies()[:4], clamped, **CLOSE)
    free = values("beams", "free")["beta_L"]
    found = RitzBeam("free", 20).frequencies(rigid=2)[:4]
    np.testing.assert_allclose(np.sqrt(found), free, **CLOSE)


def test_one_element_in_closed_form():
    exact = np.sqrt(612 + 96 * np.sqrt(39) * np.array([-1, 1]))
    np.testing.assert_allclose(values("beams", "hermite_mesh")["1"], exact, rtol=2e-11)


@pytest.mark.parametrize("group", ["hub", "payload", "hub_and_payload"])
def test_beams_with_bodies(group):
    for case in values("beams", group):
        bodies = {key: case.get(key, 0.0) for key in ("hub", "tip_mass", "tip_inertia")}
        root = "pinned" if "hub" in case else "clamped"
        found = RitzBeam(root, 20, **bodies).frequencies(rigid=root == "pinned")
        np.testing.assert_allclose(np.sqrt(found[:4]), case["beta_L"], err_msg=str(case), **CLOSE)


@pytest.mark.parametrize(("group", "shear"), [("rayleigh", 0.0), ("timoshenko", 3.12)])
def test_thick_beams(group, shear):
    for case in values("beams", group):
        r2 = case["slenderness"] ** -2
        beam = RitzBeam(case["root"], 18, rotary=r2, shear=shear * r2)
        found = beam.frequencies(rigid=case["root"] == "pinned")[: len(case["lambda"])]
        # The shear stiffness at slenderness 200 is large, so its matrices are accurate to 1e-9.
        np.testing.assert_allclose(found, case["lambda"], rtol=2e-9, err_msg=str(case))


def test_rotating_beam():
    for lag, flap in zip(values("rotating", "lag"), values("rotating", "flap"), strict=True):
        gamma = lag["gamma"]
        beam = RitzBeam("clamped", 18, tension=lambda s, g=gamma: g**2 * (1 - s**2) / 2)
        np.testing.assert_allclose(beam.frequencies()[:3], flap["lambda"], rtol=5e-10)
        np.testing.assert_allclose(beam.frequencies(spin=gamma)[:3], lag["lambda"], rtol=5e-10)


def test_rotating_beam_on_a_hub():
    for case in values("rotating", "hub_radius"):
        gamma, radius = case["gamma"], case["radius"]
        beam = RitzBeam(
            "clamped",
            18,
            tension=lambda s, g=gamma, r=radius: g**2 * ((1 - s**2) / 2 + r * (1 - s)),
        )
        np.testing.assert_allclose(beam.frequencies(spin=gamma)[:3], case["lambda"], rtol=5e-10)


def test_own_weight_and_the_mast():
    for case in values("gravity", "hanging"):
        beam = RitzBeam("clamped", 18, tension=lambda s, g=case["weight"]: g * (1 - s))
        np.testing.assert_allclose(beam.frequencies()[:3], case["lambda"], rtol=5e-10)
    zero = brentq(lambda x: jv(-1 / 3, x), 1.5, 2.2, xtol=1e-15)
    assert values("gravity", "buckling") == pytest.approx(9 / 4 * zero**2, rel=1e-13)


def test_two_link_frequencies():
    for case in values("two_link", "exact"):
        found = two_link_frequencies(
            np.radians(case["elbow_deg"]),
            case["first"],
            case["second"],
            LENGTHS,
            ROD["flexural_rigidity"],
            ROD["mass_per_length"],
        )
        np.testing.assert_allclose(found[:3], case["omega"], rtol=3e-10, err_msg=str(case))


def test_link_modes():
    # The first link carries elbow motor, second link about the joint, and payload.
    carried = 0.1 + 0.2 * 0.5**3 / 3 + 0.1 * 0.5**2 + 0.0005
    exact, published = values("link_modes", "exact"), values("link_modes", "published")
    assert exact[0]["tip_inertia"] == pytest.approx(carried, rel=1e-11)
    for case, printed in zip(exact, published, strict=True):
        beam = RitzBeam(
            length=0.5,
            rigidity=1.0,
            mass=0.2,
            tip_mass=case["tip_mass"],
            tip_inertia=case["tip_inertia"],
        )
        found = beam.frequencies()[:2] / (2 * np.pi)
        np.testing.assert_allclose(found, case["hertz"], **CLOSE)
        np.testing.assert_allclose(found, printed["hertz"], rtol=0.0, atol=0.0051)


def test_large_deflection_by_elliptic_integrals():
    def load(slope):
        p2 = (1 + math.sin(slope)) / 2
        start = math.asin(1 / math.sqrt(2 * p2))
        return (ellipk(p2) - ellipkinc(start, p2)) ** 2

    for case in values("statics", "bisshopp_drucker"):
        slope = brentq(lambda a, w=case["load"]: load(a) - w, 1e-3, 1.5, xtol=1e-15)
        p2, root = (1 + math.sin(slope)) / 2, math.sqrt(case["load"])
        start = math.asin(1 / math.sqrt(2 * p2))
        deflection = 1 - 2 * (ellipe(p2) - ellipeinc(start, p2)) / root
        draw_in = 1 - math.sqrt(2 * math.sin(slope)) / root
        found = [deflection, draw_in, slope]
        known = [case["deflection"], case["draw_in"], case["slope"]]
        np.testing.assert_allclose(found, known, rtol=0.0, atol=0.6e-9)


def test_two_link_sag_from_beam_formulas():
    (a, b), EI = LENGTHS, ROD["flexural_rigidity"]
    w = ROD["mass_per_length"] * 9.81
    force, moment = w * b, w * b**2 / 2
    elbow = w * a**4 / (8 * EI) + force * a**3 / (3 * EI) + moment * a**2 / (2 * EI)
    slope = w * a**3 / (6 * EI) + force * a**2 / (2 * EI) + moment * a / EI
    tip = elbow + slope * b + w * b**4 / (8 * EI)
    known = values("statics", "two_link_sag")
    found = [known["elbow_sag"], known["elbow_slope"], known["tip_sag"]]
    np.testing.assert_allclose(found, [elbow, slope, tip], rtol=0.0, atol=0.6e-10)


def test_step_of_torque_by_modes():
    beam = RitzBeam("pinned", 48, hub=0.1)
    inverse, shapes = eigh(beam.M, beam.K + 10.0 * beam.M)  # the low modes are accurate
    squared, shapes = 1 / inverse[::-1] - 10.0, (shapes / np.sqrt(inverse))[:, ::-1]
    force = shapes.T @ beam.root_turn  # unit torque on the root
    known = values("slewing", "step")
    for name, t in (("half", 0.5), ("one", 1.0)):
        response = np.full_like(squared, t**2 / 2)
        response[1:] = (1 - np.cos(np.sqrt(squared[1:]) * t)) / squared[1:]
        q = shapes @ (force * response)
        angle = beam.root_turn @ q
        deflection = beam.tip @ q - angle
        assert angle == pytest.approx(known[f"angle_{name}"], abs=1e-9)
        assert deflection == pytest.approx(known[f"deflection_{name}"], abs=1e-9)
    assert values("slewing", "mean") == pytest.approx(-11 / 120 / (0.1 + 1 / 3), abs=5e-9)


def spin_rate(t):
    return 0.4 * (t - 15 / (2 * math.pi) * math.sin(2 * math.pi * t / 15))


def spin_acceleration(t):
    return 0.4 * (1 - math.cos(2 * math.pi * t / 15))


@pytest.mark.sampled("softened")
@pytest.mark.parametrize("group", ["stiffened", "softened"])
def test_spin_up_of_the_linear_beam(group):
    tension = (lambda s: (100 - s**2) / 2 * 1.2) if group == "stiffened" else (lambda s: 0 * s)
    beam = RitzBeam("clamped", 6, length=10.0, rigidity=1.4e4, mass=1.2)
    spun = RitzBeam("clamped", 6, length=10.0, rigidity=1.4e4, mass=1.2, tension=tension)
    _, X = eigh(beam.K, beam.M)
    K, G = X.T @ beam.K @ X, X.T @ (spun.K - beam.K - beam.axis_mass) @ X
    moment, tip = X.T @ beam.moment, beam.tip @ X

    def rates(t, state):
        q, qd = state[:6], state[6:]
        return np.append(qd, -(K + spin_rate(t) ** 2 * G) @ q - moment * spin_acceleration(t))

    known = values("spin_up", group)
    times = {"v5": 5.0, "v75": 7.5, "v10": 10.0} | (
        {"extreme": known["extreme_time"]} if group == "stiffened" else {}
    )
    run = solve_ivp(
        rates, (0, 10), np.zeros(12), "DOP853", dense_output=True, rtol=1e-9, atol=1e-11
    )
    for name, t in times.items():
        # Six polynomials give seven digits.
        assert tip @ run.sol(t)[:6] == pytest.approx(known[name], rel=3e-7), name


def test_spin_up_of_the_exact_beam():
    known = values("spin_up", "elastica")
    beam = TangentAngle(5, 10.0, 1.4e4, 1.2, prescribed=(spin_rate, spin_acceleration))
    times = [5.0, known["extreme_time"], 7.5]
    found = beam.tips(times, rtol=1e-8)[:, 1]
    # Five polynomials give seven digits.
    wanted = [known["v5"], known["extreme"], known["v75"]]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-7)


@pytest.mark.thorough
def test_falling_pendulum():
    beam = TangentAngle(8, 1.0, 2.0, 0.2, gravity=9.81)
    known = values("pendulum", "falling")[:2]
    found = beam.tips([case["t"] for case in known], rtol=1e-8)
    # Eight polynomials here, sixteen in the reference, because the release at the pin excites high
    # modes.
    np.testing.assert_allclose(found, [case["tip"] for case in known], rtol=0.0, atol=1e-5)


def test_four_bar():
    """Angles by intersecting circles in the complex plane; times by the energy equation."""
    lengths, masses = np.array([0.3, 0.9, 0.7]), np.array([0.3, 0.72, 0.42])

    def loop(angle):
        """Return unit vectors of the links and their rates for a crank at 1 rad/s."""
        crank = np.exp(1j * angle)
        span = 1.0 - 0.3 * crank
        length = abs(span)
        turn = math.acos((0.9**2 + length**2 - 0.7**2) / (2 * 0.9 * length))
        coupler = span / length * np.exp(1j * turn)
        rocker = (0.3 * crank + 0.9 * coupler - 1.0) / 0.7
        columns = [0.9 * coupler, -0.7 * rocker]
        matrix = [[part(1j * c) for c in columns] for part in (np.real, np.imag)]
        right = [-part(0.3j * crank) for part in (np.real, np.imag)]
        return np.array([crank, coupler, rocker]), np.append(1.0, np.linalg.solve(matrix, right))

    def energies(angle):
        """Return half the inertia and the potential of gravity at an angle of the crank."""
        units, rates = loop(angle)
        roots = np.array([0.0, 0.3 * units[0], 1.0])
        speeds = np.array([0.0, 0.3j * units[0], 0.0]) + 0.5j * lengths * units * rates
        kinetic = 0.5 * masses @ (abs(speeds) ** 2 + (lengths * rates) ** 2 / 12)
        return kinetic, 9.81 * masses @ (roots + 0.5 * lengths * units).imag

    kinetic, potential = energies(0.0)
    total = kinetic * 9.0**2 + potential

    def slowness(angle):
        kinetic, potential = energies(angle)
        return math.sqrt(kinetic / (total - potential))

    for case in values("mechanisms", "four_bar"):
        time = quad(slowness, 0.0, case["crank"], epsabs=1e-13, epsrel=1e-13, limit=200)[0]
        assert time == pytest.approx(case["t"], abs=1e-11)
        known = np.exp(1j * np.array([case[name] for name in ("crank", "coupler", "rocker")]))
        np.testing.assert_allclose(loop(case["crank"])[0], known, rtol=0.0, atol=2e-12)


def test_rigid_pendulum_on_a_cart():
    """Horizontal momentum is zero; the substitution of the angle removes the singular start."""
    known = values("mechanisms", "cart")
    cart, rod, gravity = 2.0, 1.0, 9.81

    def slowness(u):  # the rod has fallen by the angle u^2
        inertia = rod / 3 - (rod / 2 * math.sin(u * u)) ** 2 / (cart + rod)
        fall = np.sinc(u * u / np.pi) * rod * gravity  # 2 m g l sin(u^2) / u^2
        return 2.0 * math.sqrt(inertia / fall)

    half = quad(slowness, 0.0, math.sqrt(math.pi / 2), epsabs=1e-14, epsrel=1e-14)[0]
    assert 2.0 * half == pytest.approx(known["time"], abs=1e-11)
    assert known["displacement"] == pytest.approx(rod / (cart + rod), abs=1e-11)


def test_free_flyer():
    rod = {"length": 3.372, "rigidity": 100.6, "mass": 2.82}
    ends = 5.18 * rod["mass"] * rod["length"]
    beam = RitzBeam("free", 18, root_mass=ends, tip_mass=ends, **rod)
    found = beam.frequencies(rigid=2)[:4]
    np.testing.assert_allclose(found, values("mechanisms", "free_flyer"), **CLOSE)


@pytest.mark.thorough
def test_flexible_pendulum_on_a_cart():
    known = values("mechanisms", "flexible_cart")[:2]
    beam = TangentAngle(8, 1.0, 2.0, 0.2, gravity=9.81, moving="x", carried=0.1)
    motion = beam.run([case["t"] for case in known], rtol=1e-8)
    tips = beam.tips_of(motion)
    # Eight polynomials here, fourteen in the reference, as for the pendulum on a pin.
    np.testing.assert_allclose(tips, [case["tip"] for case in known], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(motion[:, -1], [c["cart"] for c in known], rtol=0.0, atol=1e-5)


def test_flying_spaghetti():
    beam = TangentAngle(14, 10.0, 100.0, 1.0, moving="xy", rotary=10.0, load=(8.0, 0.0, -80.0))
    motion = beam.run([2.5], rtol=1e-8, start=math.atan2(8.0, -6.0))
    known = values("mechanisms", "spaghetti")
    # The load acts suddenly, so that the error decreases slowly with the number of polynomials.
    for found, name in ((motion[:, -2:] + [6.0, 0.0], "root"), (beam.tips_of(motion), "tip")):
        shift = [6.0, 0.0] if name == "tip" else [0.0, 0.0]
        np.testing.assert_allclose(found[0] + shift, known[name], rtol=0.0, atol=3e-3)


def test_histories_are_complete():
    for name in ("exact", "linear_fine", "linear_paper"):
        columns = history(f"two_link_{name}")
        np.testing.assert_allclose(columns["t"], np.arange(201) / 100, atol=1e-12)
        assert set(columns) == {"t", "theta1", "theta2", "tipx", "tipy", "defl1", "defl2"}


def test_beam_values_equal_those_of_the_beam_tests():
    """Two files have the same numbers, one for users and one for the tests of the beams."""
    path = Path(__file__).parents[1] / "data" / "beam_reference.json"
    other = json.loads(path.read_text(encoding="utf-8"))
    assert values("beams", "payload") == other["clamped"][1:]
    assert values("beams", "rayleigh") == other["rayleigh"]
    pinned = {
        (case["hub"], case.get("tip_mass", 0.0), case.get("tip_inertia", 0.0)): case["beta_L"]
        for case in [*values("beams", "hub"), *values("beams", "hub_and_payload")]
    }
    for case in other["pinned"]:
        assert pinned[case["hub"], case["tip_mass"], case["tip_inertia"]] == case["beta_L"]


def spring_model(body, panel, stiffness, damping):
    """Return A and B of two bodies on a spring; states: both angles, both rates."""
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2] = np.array([-stiffness, stiffness, -damping, damping]) / body
    A[3] = np.array([stiffness, -stiffness, damping, -damping]) / panel
    return A, np.array([[0.0], [0.0], [1.0 / body], [0.0]])


@pytest.mark.sampled("0")
@pytest.mark.parametrize("number", range(8))
def test_laboratory_arm(number):
    known = values("control", "laboratory")
    L, inertia = known["length"], (known["bar_mass"] / 3 + known["tip_mass"]) * known["length"] ** 2
    stiffness = (2 * np.pi * known["locked_hz"]) ** 2 * inertia
    A, B = spring_model(known["hub_inertia"], inertia, stiffness, 0.0)
    ratio, constant = known["gear_ratio"], known["torque_constant"]
    per_volt = ratio * constant / known["resistance"]
    A[2, 2] -= per_volt * ratio * constant / known["hub_inertia"]
    run = known["runs"][number]
    K1, K2, K3, K4 = run["gains"]
    gains = np.array([[K1 - L * K2, L * K2, K3 - L * K4, L * K4]])
    t = np.arange(0.0, 1.2, 0.001)
    outputs = np.array([[1.0, 0, 0, 0], [-L, L, 0, 0]])
    loop = (A - per_volt * B @ gains, per_volt * K1 * B, outputs, np.zeros((2, 1)))
    angle, deflection = lsim(loop, np.ones_like(t), t)[1].T
    # Every printed digit.
    assert t[np.argmax(np.abs(angle - 1) < 0.05)] == pytest.approx(run["time"], abs=1e-9)
    assert 100 * np.max(np.abs(deflection)) == pytest.approx(run["deflection"], abs=0.0051)


def test_state_feedback_of_the_panel():
    known = values("control", "panel_state")
    A, B = spring_model(*(known[name] for name in ("body", "panel", "stiffness", "damping")))
    loop = A - B @ np.array([known["gains"]])
    np.testing.assert_allclose(np.poly(A)[1:], known["open"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.poly(loop)[1:], known["closed"], rtol=0, atol=5.1e-5)
    steady = -np.linalg.solve(loop, B)[1, 0]
    assert 1 / steady == pytest.approx(known["reference_gain"], abs=2e-4)


def test_nested_loops_of_the_panel():
    known = values("control", "panel_cascade")
    A, B = spring_model(*(known[name] for name in ("body", "panel", "stiffness", "damping")))
    (kp, kd), (outer_kp, outer_kd) = known["inner"], known["outer"]
    loop = A - B @ np.array([[kp, kp * outer_kp, kd, kp * outer_kd]])
    steady = -kp * outer_kp * np.linalg.solve(loop, B)[1, 0]
    assert steady == pytest.approx(known["steady"], abs=5e-5)
    slow = min(np.linalg.eigvals(loop), key=abs)
    assert abs(slow) == pytest.approx(0.44, abs=5e-3)
    assert -slow.real / abs(slow) == pytest.approx(0.35, abs=5e-3)
    # The printed equations for the gains, which miss a factor, with a damping ratio of 0.707.
    k, b, omega, ratio = known["stiffness"], known["damping"], 0.22, 0.707
    matrix = [[k, -known["panel"] * b], [b, k - 2 * b * ratio * omega]]
    right = [-k + known["panel"] * omega**2, -b + 2 * known["panel"] * ratio * omega]
    np.testing.assert_allclose(np.linalg.solve(matrix, right), known["outer"], rtol=2e-4)
