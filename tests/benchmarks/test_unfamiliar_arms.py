"""The bench of designs for unfamiliar arms draws arms of all kinds, runs, and counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import unfamiliar_arms as bench


def row(refusal: str = "", **run: object) -> dict[str, object]:
    usual = {"settled": 0.5, "vibration": 0.2, "unstable": False, "warned": False}
    return {"refusal": refusal, "runs": [] if refusal else [usual | run]}


def test_sixteen_arms_have_all_numbers_of_links_drives_and_gravities() -> None:
    cases = [bench.draw(seed) for seed in range(16)]
    kinds = {
        (
            case.arm.n_joints,
            any(case.arm.spec.gravity),
            case.arm.spec.joints[0].gear_ratio > 1.0,
        )
        for case in cases
    }
    assert len(kinds) == 16
    assert bench.draw(3).arm.spec == cases[3].arm.spec != bench.draw(19).arm.spec
    reaches = [bench.draw(seed).arm.reach for seed in range(30)]
    assert 0.29 < min(reaches) < 0.4
    assert 12.0 < max(reaches) < 15.1
    for case in cases:  # motors hold the arm with twice the payload, stretched out
        heavy = bench.fa.varied(case.arm, payload_factor=2.0)
        bias = heavy.bias_force(heavy.rest(np.zeros(heavy.n_joints)), np.zeros(heavy.dof))
        held = np.abs(bias[heavy.joint_index])
        assert (held < case.hardware.motors.torque_limit).all()


def test_summary_counts_successes_and_warnings() -> None:
    rows = [
        row(),
        row(settled=3.0),
        row(unstable=True, vibration=9.0),
        row(warned=True),
        row(refusal="No candidate is stable"),
    ]
    assert bench.summary(rows) == (
        "5 arms, 1 refused; 4 runs of the other arms: 2 within the requirement, 1 unstable; "
        "warnings: 1 missed, 1 false; error over the requirement: median 1.8, worst 9"
    )


def test_an_interrupted_bench_goes_on_from_its_rows(tmp_path) -> None:
    place = tmp_path / "rows.jsonl"
    assert bench.rows_in(place) == {}
    place.write_text('{"seed": 3, "kind": "four links"}\n{"seed": 5, "kind": "two links"}\n')
    assert sorted(bench.rows_in(place)) == [3, 5]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 4, 8])
def test_designs_settle_on_all_plants(seed: int) -> None:
    """One link: without gravity, with it, and with gears and friction."""
    measured = bench.measure(seed)
    assert measured["refusal"] == ""
    assert len(measured["runs"]) == 2 + bench.PLANTS
    for run in measured["runs"]:
        assert not run["unstable"]
        assert not run["warned"]
        assert max(run["settled"], run["vibration"]) < 1.0
