"""``flexarm report`` writes the page of a result, or prints one message and writes nothing."""

import os

import pytest
from scenarios import GOOD, UNSTABLE, invoke
from test_wrong_input import assert_rejected

import flexarm as fa
from flexarm.cases.results import encode_netcdf


@pytest.fixture
def result(tmp_path):
    path = tmp_path / "run.nc"
    scenario = tmp_path / "good.yaml"
    scenario.write_text(GOOD)
    assert invoke("run", scenario, "--out", path).exit_code == 0
    scenario.unlink()
    return path


@pytest.mark.thorough
def test_report_equals_that_of_python(result):
    outcome = invoke("report", result)
    assert outcome.exit_code == 0
    assert outcome.stderr == ""
    path = result.with_suffix(".html")
    assert outcome.stdout == f"report in {path}\n"
    assert path.read_text(encoding="utf-8") == fa.report(fa.read_result(result), title="run")


@pytest.mark.thorough
def test_options_change_the_page(result, tmp_path):
    path = tmp_path / "new" / "page.html"
    given = ("--out", path, "--title", "A boom", "--magnify", "20", "--rigid")
    assert invoke("report", result, *given).exit_code == 0
    expected = fa.report(fa.read_result(result), title="A boom", magnify=20.0, rigid=True)
    assert path.read_text(encoding="utf-8") == expected
    assert not result.with_suffix(".html").exists()


def test_older_page_is_replaced(result):
    path = result.with_suffix(".html")
    path.write_text("older")
    assert invoke("report", result).exit_code == 0
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.thorough
def test_failed_run_has_a_report(tmp_path):
    scenario = tmp_path / "unstable.yaml"
    scenario.write_text(UNSTABLE)
    assert invoke("run", scenario, "--out", tmp_path / "run.nc").exit_code == 1
    assert invoke("report", tmp_path / "run.partial.nc").exit_code == 0
    page = (tmp_path / "run.partial.html").read_text(encoding="utf-8")
    assert "The run failed" in page
    assert fa.read_result(tmp_path / "run.partial.nc").attrs["failure"].split(":")[0] in page


def damaged(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)


def without_coordinates(path):
    whole = fa.read_result(path)
    path.write_bytes(b"".join(encode_netcdf(whole.drop_vars("q"))))


def without_arm(path):
    whole = fa.read_result(path)
    del whole.attrs["arm"]
    path.write_bytes(b"".join(encode_netcdf(whole)))


@pytest.mark.sampled("damaged")
@pytest.mark.parametrize("spoil", [os.unlink, damaged, without_coordinates, without_arm])
def test_bad_file_is_rejected_and_nothing_is_written(spoil, result, tmp_path):
    spoil(result)
    before = sorted(tmp_path.rglob("*"))
    outcome = invoke("report", result, "--out", tmp_path / "new" / "page.html")
    assert_rejected(outcome)
    assert str(result) in outcome.stderr
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.sampled("page.txt")
@pytest.mark.parametrize("name", ["page.txt", "page", "run.nc/page.html", "folder.html"])
def test_unwritable_path_is_rejected(name, result, tmp_path):
    (tmp_path / "folder.html").mkdir()
    before = sorted(tmp_path.rglob("*"))
    outcome = invoke("report", result, "--out", tmp_path / name)
    assert_rejected(outcome)
    assert "flexarm report: --out must" in outcome.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_wrong_option_is_rejected(result, tmp_path):
    for value in ("-1", "nan", "much"):
        outcome = invoke("report", result, "--magnify", value)
        assert outcome.exit_code == 2
        assert "magnify" in outcome.stderr
    assert list(tmp_path.iterdir()) == [result]


@pytest.mark.thorough
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX")
def test_full_disk_keeps_the_older_page(result, tmp_path):
    import resource

    path = result.with_suffix(".html")
    path.write_text("older")
    usual, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, most))
    try:
        outcome = invoke("report", result)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (usual, most))
    assert_rejected(outcome)
    assert path.read_text() == "older"
    assert sorted(tmp_path.iterdir()) == sorted([result, path])
