"""Numbers of the README, measured."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from docs_pages import ROOT, text_of

import flexarm as fa
from arms import table_one_arm

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}


class Torque:
    """One period of a sine on each joint, then zero."""

    breaks = (1.0,)

    def __call__(self, t: float) -> np.ndarray:
        return np.array([4.0, 1.5]) * np.sin(2 * np.pi * t) if t <= 1.0 else np.zeros(2)


def table_one(theory: str = "linear", gravity: tuple[float, float] = (0.0, 0.0), **mesh) -> fa.Arm:
    return table_one_arm(theory=theory, gravity=gravity, **mesh)


def largest_tip_error(arm: fa.Arm, solution: str) -> float:
    stored = json.loads((ROOT / "tests" / "data" / "table_one_tip.json").read_text())
    start = arm.rest([np.pi / 4, -np.pi / 2])
    result = fa.simulate(arm, 2.0, torque=Torque(), initial=start, rate=50.0, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(result.time, stored["time"])
    return float(np.max(np.hypot(*(result.tip.values - stored[solution]).T)))


def stated(pattern: str) -> list[float]:
    """Numbers of the README, with their rounding."""
    found = re.search(pattern, text_of("README.md"))
    assert found is not None, f"the README no longer says {pattern!r}"
    return [float(number) for number in found.groups()]


def test_error_of_the_papers_theory() -> None:
    (bound,) = stated(r"tip within (\S+) m \|")
    assert bound / 10 < largest_tip_error(table_one(), "linear") < bound


def test_error_of_the_exact_beam_in_segments() -> None:
    second, linear = stated(r"tip within (\S+) mm \(second order\), (\S+) mm \(linear\)")
    mesh = {"elements": 8, "modes": 4}
    # The stated bounds are the errors rounded up.
    found = 1e3 * largest_tip_error(table_one("second_order", **mesh), "exact")
    assert 0.7 * second < found < second
    found = 1e3 * largest_tip_error(table_one(**mesh), "exact")
    assert 0.9 * linear < found < linear


def test_energy_drift() -> None:
    (drift, size) = stated(r"energy constant to (\S+) J, with a kinetic energy of up to (\S+) J")
    arm = table_one(gravity=(0.0, -9.81))
    # links bend by 11 %, which does not affect the energy
    with pytest.warns(fa.LargeDeflectionWarning):
        result = fa.simulate(
            arm, 10.0, initial=arm.rest([0.3, -0.5]), rate=100.0, rtol=1e-10, atol=1e-12
        )
    total = result.kinetic_energy + result.strain_energy + result.gravity_energy
    assert float(abs(total - total[0]).max()) < drift
    assert float(result.kinetic_energy.max()) == pytest.approx(size, abs=0.5)


def test_cantilever_frequency() -> None:
    elements, error, factor = stated(r"Cantilever of (\d+) .*error of (\S+); (\S+) times")

    def high(count: int) -> float:
        beam = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=count)
        found = 2 * np.pi * fa.modes(fa.Arm(links=[beam])).frequency_hz[0]
        return float(found / 3.516015268500 - 1.0)  # (beta L)^2 of a uniform clamped-free beam

    assert high(int(elements)) == pytest.approx(error, rel=0.1)
    assert high(int(elements)) / high(2 * int(elements)) == pytest.approx(factor, rel=0.02)


def test_tolerances_of_the_comparison_with_the_oracle() -> None:
    """The stated bounds are those that the comparison asserts."""
    mass, accelerations = stated(r"mass matrices agree to (\S+), accelerations to (\S+) \|")
    folder = ROOT / "tests" / "oracle_comparison"
    text = (folder / "test_forward_dynamics_oracle.py").read_text(encoding="utf-8")
    assert f"exact / scale, rtol=0, atol={mass:.0e})".replace("e-0", "e-") in text
    assert f"max({accelerations:.0e}, EPSILON * number)" in text
