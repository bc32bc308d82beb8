"""The workflow runs existing chores, and GitHub can show the forms for issues."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
CHORES = set(re.findall(r"^([a-z-]+):", MAKEFILE, flags=re.MULTILINE))
FORMS = [
    path
    for path in sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml"))
    if path.name != "config.yml"  # settings of the list of forms
]


def commands(job: str) -> list[str]:
    """Return the lines that the steps of a job run."""
    steps = WORKFLOW["jobs"][job]["steps"]
    return [line for step in steps for line in step.get("run", "").splitlines()]


def strings(value: Any) -> Iterator[str]:
    """Yield every text of nested mappings and lists."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from strings(part)


def pythons(*, experimental: bool) -> set[str]:
    """Return the Python versions of the suite that may fail, or those that may not."""
    matrix = WORKFLOW["jobs"]["suite"]["strategy"]["matrix"]
    if experimental:
        return {entry["python"] for entry in matrix["include"] if entry.get("experimental")}
    return set(matrix["python"])


def test_workflow_runs_for_every_change_and_all_tests_every_night() -> None:
    # YAML 1.1 reads the key `on` as true.
    assert set(WORKFLOW[True]) == {"push", "pull_request", "schedule"}
    # `make` takes it from the environment.
    assert WORKFLOW["env"]["ALL"] == "${{ github.event_name == 'schedule' && '1' || '' }}"
    assert "\nALL ?=\n" in MAKEFILE


@pytest.mark.parametrize("job", WORKFLOW["jobs"])
def test_every_job_is_complete(job: str) -> None:
    content = WORKFLOW["jobs"][job]
    assert content["runs-on"]
    assert content["timeout-minutes"] <= 180
    for step in content["steps"]:
        assert ("uses" in step) != ("run" in step), step
        assert re.fullmatch(r"actions/[\w-]+@v\d+", step.get("uses", "actions/checkout@v0"))
        assert isinstance(step.get("with", {}).get("python-version", ""), str), "3.10 reads as 3.1"
    assert content["steps"][0]["uses"].startswith("actions/checkout@")


@pytest.mark.parametrize("job", WORKFLOW["jobs"])
def test_every_chore_is_in_the_makefile(job: str) -> None:
    for line in commands(job):
        words = line.split()
        if words[0] == "make":
            named = {word for word in words[1:] if "=" not in word}
            assert named, line
            assert named <= CHORES, f"the Makefile has no {named - CHORES}"


def test_every_chore_is_declared_phony() -> None:
    """Otherwise a file with the name of a chore stops it from running."""
    declared = re.search(r"^\.PHONY: (.*)$", MAKEFILE, flags=re.MULTILINE)
    assert declared
    assert set(declared[1].split()) == CHORES


def test_workflow_covers_platforms_and_chores() -> None:
    systems = {name.partition("-")[0] for job in WORKFLOW["jobs"].values() for name in runs_on(job)}
    assert systems == {"ubuntu", "macos", "windows"}
    run = [line for job in WORKFLOW["jobs"] for line in commands(job)]
    for chore in ("lint", "suite", "interpreted", "test-lowest", "dist"):
        assert any(line.startswith(f"make {chore} ") for line in run), chore


def runs_on(job: dict[str, Any]) -> list[str]:
    """Return the machines of a job."""
    name = job["runs-on"]
    return [name] if "matrix" not in name else job["strategy"]["matrix"]["os"]


def test_windows_runs_the_commands_of_the_chore() -> None:
    """Windows has no make, so its commands must equal the recipes of `make suite`."""
    recipe = MAKEFILE.partition("\nkernels:")[2].partition("\ntest-lowest:")[0]
    recipe = recipe.replace("$(BIN)/", "").replace("$(WORKERS)", "2")
    recipe = recipe.replace('$(TESTS) \\\n\t\t$(if $(ALL),,-m "not thorough")', '-m "not thorough"')
    for line in commands("windows")[1:]:
        assert line in recipe
    assert [step.get("if") for step in WORKFLOW["jobs"]["windows"]["steps"][-2:]] == [
        "${{ ! env.ALL }}",
        "${{ env.ALL }}",
    ]
    assert commands("windows")[0] == 'python -m pip install --editable ".[dev]"'
    assert set(WORKFLOW["jobs"]["windows"]["strategy"]["matrix"]["python"]) == pythons(
        experimental=False
    )


def test_classifiers_equal_the_versions_that_must_pass() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    prefix = "Programming Language :: Python :: 3."
    promised = {"3." + c.removeprefix(prefix) for c in project["classifiers"] if prefix in c}
    assert promised == pythons(experimental=False)
    assert not promised & pythons(experimental=True)
    lowest = project["requires-python"].removeprefix(">=")
    assert lowest == min(promised, key=lambda text: int(text.partition(".")[2]))
    for job in ("lint", "lowest-versions"):
        setup = next(s for s in WORKFLOW["jobs"][job]["steps"] if "python-version" in str(s))
        assert setup["with"]["python-version"] == lowest


def test_expressions_use_names_of_the_matrix() -> None:
    found = 0
    for name, job in WORKFLOW["jobs"].items():
        matrix = job.get("strategy", {}).get("matrix", {})
        known = {*matrix, *(key for entry in matrix.get("include", []) for key in entry)}
        used = {word for text in strings(job) for word in re.findall(r"matrix\.(\w+)", text)}
        assert used <= known, f"{name}: {used - known}"
        found += len(used)
    assert found


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.stem)
def test_forms_have_keys_that_github_supports(path: Path) -> None:
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert form.keys() == {"name", "description", "labels", "body"}
    known = {
        "textarea": {"label", "description", "placeholder", "value", "render"},
        "input": {"label", "description", "placeholder", "value"},
        "dropdown": {"label", "description", "options"},
    }
    for field in form["body"]:
        assert field.keys() <= {"type", "id", "attributes", "validations"}
        assert {"label"} <= field["attributes"].keys() <= known[field["type"]]
        assert field.get("validations", {}).keys() <= {"required"}
    names = [field["id"] for field in form["body"]]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("form", "fields"),
    [
        ("bug", {"happened", "arm", "version", "platform"}),
        ("wrong-number", {"value", "reference", "arm", "theory", "version"}),
        ("feature", {"task"}),
    ],
)
def test_forms_require_the_information_for_an_answer(form: str, fields: set[str]) -> None:
    path = ROOT / ".github/ISSUE_TEMPLATE" / f"{form}.yml"
    body = yaml.safe_load(path.read_text(encoding="utf-8"))["body"]
    required = {field["id"] for field in body if field.get("validations", {}).get("required")}
    assert required == fields
