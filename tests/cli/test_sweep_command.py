"""``flexarm sweep`` and ``flexarm compare`` of a study with samples."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.main import app

STUDY = """\
flexarm: 1
arm:
  links: [{length: 0.8, flexural_rigidity: 40.0, mass_per_length: 0.5, elements: 1}]
  joints: [{hub_inertia: 0.05}]
  payload: {mass: 0.1}
motions:
  move: {kind: joint, start: [0.2], end: [0.3], duration: 0.04}
drives:
  torque alone: {kind: rigid_inverse_dynamics}
vary:
  payload.mass: {kind: values, values: [0.1, 0.2, -1.0]}
samples: {method: grid}
run: {duration: 0.05, rate: 200}
"""

pytest.importorskip("zarr", reason="it comes with the extra: pip install 'flexarm[cluster]'")


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return path


def call(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments], env={"COLUMNS": "100"})


def test_sweep_prints_statistics_and_keeps_results(path, tmp_path):
    done = call("sweep", path, "--workers", 1, "--verify", "--plot", tmp_path / "a.png")
    assert done.exit_code == 0, done.output
    assert "Along move: median / 95 % quantile" in done.output
    assert "0 (0-84)" in done.output  # none of two possible runs: Clopper and Pearson
    assert (
        "torque alone on as believed along move: 1 of 3 runs are infeasible and not in the rates, "
        "the first of sample 2: payload.mass must be at least 0"
    ) in done.output.replace("\n", " ")
    assert "3 samples repeated: identical" in done.output
    assert (tmp_path / "a.png").stat().st_size > 1000
    table = fa.read_study(tmp_path / "study.zarr")
    assert table["payload.mass"].values.tolist() == [0.1, 0.2, -1.0]


@pytest.mark.parametrize("key", ["payload.mass", "links[0].flexural_rigidity"])
def test_set_finds_keys_that_are_paths(path, key):
    path.write_text(STUDY.replace("payload.mass", f'"{key}"'))
    done = call("check", path, "--set", f"vary.{key}.values=[0.3]")
    assert done.exit_code == 0, done.output
    done = call("check", path, "--set", f"vary.{key}.value=[0.3]")
    assert f"vary.{key}.value is not a known key" in done.output.replace("\n", " ")


def test_a_study_without_variation_gives_a_notice(path):
    varied = STUDY.split("vary:")[0]
    path.write_text(f"{varied}run: {{duration: 0.05, rate: 200}}\n")
    done = call("sweep", path, "--workers", 1)
    assert done.exit_code == 0, done.output
    assert "warning: the study has one sample. Add `vary` and `samples`" in done.output


@pytest.mark.thorough
def test_existing_results_are_continued_on_request_only(path):
    assert call("sweep", path, "--workers", 1).exit_code == 0
    again = call("sweep", path, "--workers", 1)
    assert again.exit_code == 2
    assert "Continue it with resume=True (--resume)" in again.output
    assert call("sweep", path, "--workers", 1, "--resume").exit_code == 0


def test_limits_count_as_failures(path):
    done = call("sweep", path, "--workers", 1, "--limit", "tip_error_peak=1e-9")
    assert "100 (16-100)" in done.output  # two of two possible runs
    unused = path.with_name("unused.zarr")
    wrong = call("sweep", path, "--workers", 1, "--out", unused, "--limit", "tip=1")
    assert wrong.exit_code == 2
    assert not unused.exists()
    assert "--limit must be one of" in wrong.output
    wrong = call("sweep", path, "--workers", 1, "--out", unused, "--limit", "tip_error_peak")
    assert "must be a metric and a number" in wrong.output


def test_different_repetition_is_a_failure(path, monkeypatch):
    monkeypatch.setattr(fa.Study, "verify", lambda *_: [1])
    done = call("sweep", path, "--workers", 1, "--verify")
    assert done.exit_code == 1
    assert "samples 1 of the store differ" in done.output


@pytest.mark.thorough
def test_compare_prints_ratios_to_the_nominal_runs(path, tmp_path):
    out = tmp_path / "table.nc"
    done = call("compare", path, "--workers", 1, "--out", out, "--limit", "tip_error_rms=0.042")
    assert done.exit_code == 0, done.output
    study = fa.Study(path)
    nominal = 1e3 * study.nominal()["tip_error_rms"].item()
    errors = 1e3 * study.run(workers=1)["tip_error_rms"].values.ravel()[:2]
    assert errors[0] == nominal  # the first mass is that of the file
    median, high = np.quantile(errors, [0.5, 0.95])
    row = done.output.split("torque alone")[1].split()
    assert row[2:9] == [
        *(f"{nominal:.3g}", f"{median:.3g}", "/", f"{high:.3g}"),
        *(f"{median / nominal:.3g}", "/", f"{high / nominal:.3g}"),
    ]
    assert "50 (1.3-99)" in done.output  # the heavier payload exceeds the limit
    with xr.open_dataset(out) as table:
        assert np.isnan(table["tip_error_peak"].values.ravel()).tolist() == [False, False, True]


def test_wrong_paths_are_reported_with_their_lines(path):
    path.write_text(STUDY.replace("payload.mass:", "payload.mas:"))
    for command in ("check", "sweep"):
        done = call(command, path)
        assert done.exit_code == 2
        assert f"{path}:11: vary must be the path of a number of the arm" in done.output.replace(
            "\n", ""
        )


def test_check_counts_the_runs(path):
    assert "samples      3, grid: payload.mass" in call("check", path).output


def test_sobol_samples_that_are_not_balanced_are_reported(path):
    values = "{kind: values, values: [0.1, 0.2, -1.0]}"
    sobol = STUDY.replace(values, "{kind: uniform, low: 0.0, high: 0.1}")
    for count, heard in ((6, True), (4, False)):
        path.write_text(sobol.replace("method: grid", f"method: sobol, count: {count}"))
        done = call("sweep", path, "--workers", 1, "--out", path.with_name(f"{count}.zarr"))
        assert done.exit_code == 0
        text = "warning: samples.count 6 is not a power of two"
        assert (text in done.output) == heard


def test_limits_require_samples(path):
    path.write_text(STUDY.split("vary:")[0] + "run: {duration: 0.05, rate: 200}\n")
    done = call("compare", path, "--limit", "tip_error_rms=0.042")
    assert done.exit_code == 2
    assert "--limit requires a study with samples" in done.output


@pytest.mark.thorough
def test_sweep_prints_the_probabilities_of_rare_failures(path):
    rare = "rare_failures: {samples: 100, limits: {tip_error_peak: 1.0e-9}}\n"
    plan = STUDY.index("samples:")
    without = STUDY[:plan] + STUDY[STUDY.index("\n", plan) + 1 :]
    path.write_text(without + rare)
    done = call("sweep", path)
    assert done.exit_code == 0, done.output
    assert "Along move: rare failures" in done.output
    assert "0.96 - 1 " in done.output  # every possible payload exceeds the limit
    assert not path.with_suffix(".zarr").exists()
