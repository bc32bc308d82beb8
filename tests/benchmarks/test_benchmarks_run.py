"""Every benchmark runs once with a small problem. Times are not checked."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks.arms import chain, moving_state
from benchmarks.figures import best
from benchmarks.first_run import First
from benchmarks.limit import Limit, compiler
from benchmarks.work_precision import Point, fastest, measure

import flexarm as fa
from benchmarks import (
    environments,
    first_run,
    forward_dynamics,
    long_chain,
    pictures,
    programs,
    raw,
    report,
    rollouts,
    startup,
    table_one,
    whole_call,
)
from flexarm.integrate import INTEGRATORS


@pytest.fixture(scope="module")
def points() -> list[Point]:
    """Measure flexarm's integrators and every installed peer over a tenth of a second."""
    own = table_one.own_entries(rtol=(1e-4,), steps=(2.5e-4,), duration=0.1)
    entries = [entry for entry in own if "segments" not in entry.setting]
    entries += table_one.default_entries(duration=0.1)
    entries += table_one.peer_entries(duration=0.1, quick=True)
    found, failed = measure(entries, table_one.truths(0.1), repeats=1)
    assert not failed
    return found


@pytest.mark.thorough
def test_all_programs_compute_the_same_motion(points: list[Point]) -> None:
    """The tip moves by 40 mm here."""
    for point in points:
        # The coarsest peers have errors of 1e-4 m over the whole two seconds.
        assert point.error < 1e-4, point
        assert 0.0 < point.seconds <= point.total
        if point.program in ("CasADi CVODES", "JAX"):
            # These programs solve the equations of the reference, so only their steps cause errors.
            assert point.error < 1e-6, point


@pytest.mark.thorough
def test_every_integrator_is_measured(points: list[Point]) -> None:
    settings = " ".join(point.setting for point in points if point.program == "flexarm")
    assert [name for name in INTEGRATORS if name not in settings] == []


@pytest.mark.thorough
@pytest.mark.parametrize("peer", programs.PEERS)
def test_every_installed_peer_is_measured(points: list[Point], peer: str) -> None:
    if peer in programs.missing():
        pytest.skip(f"{peer} is not installed: its benchmark was not tried")
    assert peer in {point.program for point in points}


@pytest.mark.sampled("second_order")
@pytest.mark.skipif(compiler() is None, reason="no C++ compiler: the limit was not measured")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_limit_program_computes_the_same_accelerations(theory: str) -> None:
    arm = chain(2, theory=theory)
    forward_dynamics.checked_limit(arm, *moving_state(arm))
    heavier = fa.Arm(links=arm.spec.links, theory=theory, gravity=(0.0, -9.81))
    limit = Limit(heavier, *moving_state(arm))
    limit.compile_time_sizes(1)
    far = np.abs(heavier.unpadded(limit.acceleration) - arm.forward_dynamics(*moving_state(arm)))
    assert far.max() > 1.0  # gravity has an effect


def test_limit_program_rejects_fixed_joints() -> None:
    arm = fa.Arm(links=chain(2).spec.links, joints=[fa.Joint(), fa.Joint(fixed=True)])
    with pytest.raises(ValueError, match="free joints"):
        Limit(arm, *moving_state(arm))


def test_forward_dynamics_with_and_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    comparison = forward_dynamics.compare("second_order", calls=2, repeats=1)
    assert (comparison.limit is None) == (compiler() is None)
    assert all(value is None or value > 0.0 for value in comparison[1:])
    monkeypatch.setattr(forward_dynamics, "compiler", lambda: None)
    assert forward_dynamics.compare("second_order", calls=2, repeats=1).limit is None


@pytest.mark.thorough
def test_measurements_are_written_to_the_page(tmp_path: Path, points: list[Point]) -> None:
    case = long_chain.short(3, 0.02)
    chain, failed = measure(list(long_chain.entries(case)), long_chain.truth(case), repeats=1)
    assert all("rk4" in sentence for sentence in failed), failed
    # Compiling for the sizes takes a minute and changes no digit.
    beside, failed = raw.beside_peers(points, repeats=1, duration=0.1, specialized=False)
    assert not failed
    own = [point for point in beside if point.program == raw.PROGRAM]
    assert max(point.error for point in own) < 1e-4
    measured = report.Measured(
        imports=startup.import_seconds(repeats=1),
        help=startup.help_seconds(repeats=1),
        runs={name: startup.Wait(1.0, 1.0) for name in ("paper", "run")},
        first=[First(first_run.ALONE[0], startup.Wait(2.0, 1.5), startup.Wait(20.0, 12.5))],
        memory=startup.memory_megabytes(seconds=0.01),
        comparisons=[forward_dynamics.Comparison("linear", 0.1, 0.1, 10.0, 50.0, None, None)],
        links=forward_dynamics.scaling_in_links(counts=(2, 256), repeats=1),
        modes=forward_dynamics.scaling_in_modes(counts=(2, 8), repeats=1),
        table_one=points,
        raw=[*own, *(point for point in points if point.program != "flexarm")],
        many=[rollouts.Rollouts("flexarm, lanes, 2 threads", "rk4", "exact beams", 1e-4, 900.0)],
        learning=environments.environments(count=8, steps=2, repeats=1),
        chain=chain,
        closed=[("flexarm, rtol 0.001", 1e-4, 0.01), ("Exudyn, 4 elements", 1e-4, 0.5)],
        controllers={("joint_pd", ""): 5.0},
        simulations=whole_call.simulations(repeats=1, duration=0.1),
        calls=whole_call.microseconds(repeats=1, calls=1),
        pictures=pictures.waits(duration=0.1, links=2, repeats=1),
    )
    assert all(math.isfinite(value) and value > 0 for value in measured.links.values())
    report.write(tmp_path, measured)

    page = (tmp_path / "index.md").read_text(encoding="utf-8")
    assert re.search(r"\| flexarm, \w+, [34] modes, (rtol|step) [\d.e-]+.* \|", page)
    assert re.search(r"\| auto, 4 modes, default arguments: rtol \S+, atol \S+ m \|", page)
    assert "| `joint_pd` | 5 |" in page
    assert "| 256 |" in page
    assert re.search(r"\| torque samples, 100 per second \| \d.* \| \d.* \| \d.* \| 2 \|", page)
    assert re.search(r"\| `Arm.forward_dynamics` \| [\d.e+]+ \| 8 \|", page)
    for _, steps, whole, beside in measured.simulations:
        assert 0.0 < steps < whole
        assert 0.0 < beside < whole
    assert re.search(r"\| vector, 8, 2 threads \| [\d,]+ \| [\d.]+ \|", page)
    assert "| single |" in page
    assert "| `flexarm paper` | 2.00 | 1.50 | 20.00 | 12.50 | 15 |" in page
    assert re.search(r"\| exact beams \| \S+ \| steps \| \w+, [34] modes, (step|rtol) .*: ", page)
    assert "no compiler here" in page
    assert re.search(r"\| animation of 0.1 s, mp4 \| [\d.]+ \| [\d.]+ \| 10 \|", page)
    assert re.search(r"\| preview of 3 s, .* \| [\d.]+ \| [\d.]+ \| 0.05 \|", page)
    assert re.search(r"\| report of a minute, 2 links \| [\d.]+ \| [\d.]+ \| 2 \|", page)
    for figure in ("scaling.png", "work-precision.png", "chain.png"):
        assert (tmp_path / figure).stat().st_size > 10_000, figure


def test_specialized_entries_have_small_errors() -> None:
    """The size-specific compilation itself is left out, because it takes a minute."""
    entries = table_one.specialized_entries(rtol=(1e-4,), duration=0.1, specialized=False)
    found, failed = measure(list(entries), table_one.truths(0.1), repeats=1)
    assert not failed
    assert [point.truth for point in found] == [table_one.PAPER, table_one.EXACT]
    assert max(point.error for point in found) < 1e-4


@pytest.mark.thorough
def test_warm_runs_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """`flexarm paper` is called with `--help`; its figures are tested in `tests/cli`."""
    least = startup._least
    without = lambda command, n: least([*command, *["--help"] * ("paper" in command)], n)  # noqa: E731
    monkeypatch.setattr(startup, "_least", without)
    waits = startup.warm_runs(repeats=1)
    assert len(waits) == 2
    assert all(0.0 < wait.processor < 600.0 for wait in waits.values())


def test_fastest_returns_the_fastest_accurate_point() -> None:
    slow, fast, wrong = (
        Point("p", "s", "t", error, seconds, seconds)
        for error, seconds in ((1e-6, 3.0), (1e-5, 2.0), (1e-2, 1.0))
    )
    assert fastest([slow, fast, wrong], "t", 1e-4) == fast
    assert fastest([slow, fast, wrong], "t", 1e-5 / 2) == slow
    assert fastest([slow], "another", 1.0) is None


def test_best_returns_the_points_that_no_other_dominates() -> None:
    points = [
        Point("p", name, "t", error, seconds, seconds)
        for name, error, seconds in (
            ("slow", 1e-6, 3.0),
            ("slower", 1e-6, 4.0),
            ("fast", 1e-4, 1.0),
            ("as fast", 1e-3, 1.0),
            ("between", 1e-3, 2.0),
        )
    ]
    assert [point.setting for point in best(points)] == ["fast", "slow"]


def test_table_of_ratios_of_steps_and_whole_calls() -> None:
    """The table compares the fastest sufficiently accurate run of each program; the ratio is the
    peer's time over that of flexarm."""
    truth, level, *_ = raw.LEVELS[1]
    named = [
        (raw.PROGRAM, "good", 0.5, 2e-3, 9e-3),
        (raw.PROGRAM, "easy to call", 0.5, 3e-3, 7e-3),
        (raw.PROGRAM, "wrong", 2.0, 1e-3, 1e-3),
        ("Peer", "good", 1.0, 7e-2, 8.4e-2),
        ("Peer", "wrong", 2.0, 1e-2, 1e-2),
    ]
    points = [Point(who, what, truth, share * level, *times) for who, what, share, *times in named]
    rows = [line for line in report.raw_table(points).splitlines() if f"{level:.1e}" in line]
    assert "| steps | good: 2 | Peer, good: 70 | 35 | 100 |" in rows[0]
    assert "| whole call | easy to call: 7 | Peer, good: 84 | 12 | 30 |" in rows[1]
    assert "| none | none |  |" in report.raw_table([])


def test_table_of_ratios_of_the_chain() -> None:
    """The table has flexarm's fastest run that is at least as accurate as MuJoCo's, or none."""
    named = [
        ("flexarm", "good", 1e-4, 2e-3),
        ("flexarm", "wrong", 1e-2, 1e-3),
        ("MuJoCo", "1 bar", 1e-3, 5e-2),
        ("MuJoCo", "2 bars", 1e-5, 1.0),
        ("Exudyn", "cables", 1e-4, 3e-3),
    ]
    points = [Point(*one[:2], long_chain.TIGHT, *one[2:], one[3]) for one in named]
    rows = report.chain_table(points).splitlines()[2:]
    assert rows == [
        "| 1.0e-03 | good: 2 | 1 bar: 50 | 25 | 20 |",
        "| 1.0e-05 | none | 2 bars: 1e+03 |  | 20 |",
    ]


def test_table_of_default_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each default call is beside the fastest whole call of a peer that is at least as accurate."""
    monkeypatch.setattr(programs, "missing", lambda: ["Drake", "Exudyn"])
    default = f"auto, 4 modes, {programs.DEFAULTS}: rtol 1e-07, atol 2e-09 m"
    named = [
        ("flexarm", default, 2e-5, 1e-2, 2e-2),
        ("flexarm", "tuned", 1e-5, 1e-3, 2e-3),
        ("Peer", "slow to call", 1e-5, 1e-3, 9e-2),
        ("Peer", "good", 2e-5, 5e-2, 6e-2),
        ("Peer", "wrong", 3e-5, 1e-3, 1e-3),
    ]
    points = [Point(*one[:2], table_one.EXACT, *one[2:]) for one in named]
    assert report.user_table(points).splitlines()[2:] == [
        f"| {default} | 2.0e-05 | 20 | flexarm |  |  |",
        "|  | 2.0e-05 | 60 | Peer | good | 3 |",
        "",
        "Not installed in this run: Drake, Exudyn.",
    ]
    monkeypatch.setattr(programs, "missing", list)
    assert "Not installed" not in report.user_table(points)


def test_labels_have_both_tolerances() -> None:
    labels = [entry.setting for entry in (*table_one.default_entries(), *table_one.peer_entries())]
    labels += [entry.setting for entry in table_one.own_entries()]
    with_one = [label for label in labels if "rtol" in label]
    assert len(with_one) > 10
    assert all("atol" in label for label in with_one)


def test_tables_have_a_column_for_each_theory_and_a_table_for_each_solution() -> None:
    found = [
        forward_dynamics.Comparison(theory, 0.2, 0.3, 10.0, 50.0, limit, limit)
        for theory, limit in (("linear", None), ("second_order", 0.1))
    ]
    first, _, *rows = report._comparison_table(found).splitlines()
    assert first.count("ratio") == 2
    assert len(rows) == 6
    assert rows[0].endswith("| no compiler here |  | 0.1 | 1 |")
    points = [
        Point(who, "setting", truth, 1e-7, 1e-3, 2e-3)
        for who in ("flexarm", "Peer")
        for truth in (table_one.EXACT, table_one.PAPER)
    ]
    text = report._level_table(points)
    assert text.count("Against ") == 2
    assert text.count("| Peer, setting | 1 | 2 | 1 |") == sum(map(len, report.LEVELS.values()))
