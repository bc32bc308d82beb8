"""``flexarm identify``: the example, wrong files, and what it prints."""

from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.main import app

BENCH = Path(__file__).parents[2] / "examples" / "bench"


def write(folder, **changes):
    """Write a study of one parameter next to a short copy of the example's record."""
    lines = (BENCH / "multisine.csv").read_text().splitlines()
    (folder / "short.csv").write_text("\n".join(lines[:120]))
    (folder / "arm.yaml").write_text((BENCH / "arm.yaml").read_text())
    text = (BENCH / "identify.yaml").read_text().replace("multisine.csv", "short.csv")
    text = text.partition("validation:")[0] + 'free: ["joints[0].hub_inertia"]\n'
    for old, new in changes.items():
        text = text.replace(old, new)
    path = folder / "study.yaml"
    path.write_text(text)
    return path


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "100"})


@pytest.mark.thorough
@pytest.mark.compiled
def test_estimates_are_printed_and_saved(tmp_path):
    out, result = tmp_path / "found.yaml", tmp_path / "found.nc"
    done = invoke("identify", write(tmp_path), "--out", out, "--result", result)
    assert done.exit_code == 0, done.output
    assert f"result in {result}" in done.output
    done_report = invoke("report", result)
    assert done_report.exit_code == 0, done_report.output
    page = result.with_suffix(".html").read_text(encoding="utf-8")
    assert page == fa.report(fa.read_result(result), title="found")
    for option in (("--magnify", "2"), ("--rigid",)):
        refused = invoke("report", result, "--out", tmp_path / "other.html", *option)
        assert refused.exit_code == 2
        assert "may be path, title and notes" in refused.stderr
        assert not (tmp_path / "other.html").exists()
    for text in ("joints[0].hub_inertia", "whiteness", "strain_1", f"arm in {out}"):
        assert text in done.output
    found = fa.load_arm(out).spec.joints[0].hub_inertia
    assert 0.02 < found < 0.025  # from 0.025 towards 0.02, with dampings that remain wrong
    assert f"{found:.5g}" in done.output


@pytest.mark.thorough
@pytest.mark.compiled
def test_prediction_errors_in_a_file(tmp_path):
    path = write(tmp_path)
    fit = "fit: {method: prediction_error, torque_noise: 0.05, iterations: 3}\n"
    path.write_text(path.read_text() + fit)
    result = tmp_path / "found.nc"
    done = invoke("identify", path, "--result", result, "--quiet")
    assert done.exit_code == 0, done.output
    found = fa.Identification.from_dataset(fa.read_result(result))
    assert found.method == "prediction_error"
    assert found.torque_noise.tolist() == [0.05]
    path.write_text(path.read_text().replace("0.05", "-0.05"))
    assert "fit.torque_noise" in invoke("identify", path).output


def test_the_example_is_valid():
    from flexarm.identification.identify import PreparedIdentification

    prepared = PreparedIdentification(BENCH / "identify.yaml", BENCH)
    assert len(prepared.study.free) == 5
    assert list(prepared.study.validation) == ["check"]


@pytest.mark.parametrize(
    ("old", "new", "line", "text"),
    [
        (
            "bridge",
            "brigde",
            9,
            "names the column 'brigde', which is missing. Did you mean 'bridge'?",
        ),
        ("short.csv", "shrot.csv", 5, "does not exist"),
        ("torque_1", "torqeu_1", 6, "must be the name of a measured channel"),
        ("hold", "held", 10, "must be one of 'cubic', 'linear', 'hold'"),
        ("remove_mean", "low_pass", 12, "cutoff is required for low_pass"),
        ("records:", "recods:", 3, "is not a known key"),
    ],
)
def test_problems_have_their_lines(old, new, line, text, tmp_path):
    done = invoke("identify", write(tmp_path, **{old: new}))
    assert done.exit_code == 2
    assert text in done.output
    assert f"study.yaml:{line}" in done.output or old in ("torque_1", "records:"), done.output


def test_problems_of_records_name_the_key(tmp_path):
    path = write(tmp_path)
    record = next(iter(yaml.safe_load(path.read_text())["records"]))
    angles = f"  {record}:\n    initial_angle: [0.1, 0.2, 0.3, 0.4]\n"
    path.write_text(path.read_text().replace(f"  {record}:\n", angles))
    done = invoke("identify", path)
    assert done.exit_code == 2
    assert f"records.{record}.initial_angle must have one angle for each of the" in done.output
    assert "study.yaml:" in done.output
    short = tmp_path / "short.csv"
    short.write_text("\n".join(short.read_text().splitlines()[:3]))
    assert f"records.{record} has fewer than 4 samples" in invoke("identify", path).output


def test_wrong_parameters_name_the_key(tmp_path):
    done = invoke("identify", write(tmp_path, hub_inertia="hub_inerta"))
    assert done.exit_code == 2
    assert "did you mean hub_inertia?" in done.output


def test_check_reads_records_and_compares_them_with_the_arm(tmp_path):
    done = invoke("check", BENCH / "identify.yaml")
    assert done.exit_code == 0, done.output
    for text in ("records: multisine", "at 200 Hz, torque", "strain_1", "ok"):
        assert text in done.output
    path = write(tmp_path)
    record = next(iter(yaml.safe_load(path.read_text())["records"]))
    angles = f"  {record}:\n    initial_angle: [0.1, 0.2]\n"
    path.write_text(path.read_text().replace(f"  {record}:\n", angles))
    done = invoke("check", path)
    assert done.exit_code == 2
    assert f"records.{record}.initial_angle must have one angle for each of the" in done.output
    assert "study.yaml:" in done.output


@pytest.mark.parametrize(
    ("fit", "text"),
    [
        ("{method: prediction_error, loss: huber}", "huber cannot be combined with prediction"),
        ("{torque_noise: 0.1}", "torque_noise requires method='prediction_error'"),
        ("{integrator: nonsense}", "nonsense"),
    ],
)
def test_check_refuses_settings_that_the_fit_refuses(fit, text, tmp_path):
    path = write(tmp_path)
    path.write_text(path.read_text() + f"fit: {fit}\n")
    for command in ("check", "identify"):
        done = invoke(command, path)
        assert done.exit_code == 2, done.output
        assert text in done.output
