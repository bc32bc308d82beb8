"""The reference pages agree with the code."""

from __future__ import annotations

import inspect
import re
from typing import Any

import pytest
import typer
from docs_pages import ROOT, blocks, pages, text_of
from python_tables import GROUPS
from reference_tables import STUB, generated, missing_sections, part_pattern, stub

import flexarm as fa
from flexarm.cli.main import app
from flexarm.control.laws import CONTROLLERS
from flexarm.integrate import INTEGRATORS
from flexarm.linear.models.state_space import CHANNEL_OUTPUTS
from flexarm.model import json_schema
from flexarm.motion import TIMING_LAWS
from page_scripts import script

PYTHON = "docs/reference/python-api.md"
COMMANDS = "docs/reference/command-line.md"
INTEGRATORS_PAGE = "docs/how-to/choose-an-integrator.md"
ACCURACY_PAGE = "docs/performance/accuracy.md"
LINEARIZE = "docs/how-to/linearize.md"


def code_words(page: str) -> set[str]:
    """Return the words inside backticks and in the blocks of a page."""
    spans = re.findall(r"`([^`\n]+)`", text_of(page)) + [block.text for block in blocks(page)]
    return {word for span in spans for word in re.findall(r"\w+", span)}


def public_members(cls: type) -> list[str]:
    return [name for name, _ in inspect.getmembers(cls) if not name.startswith("_")]


def test_generated_parts_are_up_to_date() -> None:
    again = "run `python tests/docs/reference_tables.py`"
    for (page, name), part in generated().items():
        found = part_pattern(name).findall(text_of(page))
        assert found == [part], f"{page}: {name} does not say what the code says; {again}"


def test_stub_has_the_controllers_of_the_registry() -> None:
    again = "run `python tests/docs/reference_tables.py`"
    assert text_of(STUB) == stub(), f"{STUB} lacks a controller, or has one too many; {again}"


def test_every_kind_of_mapping_has_a_section() -> None:
    """Parts are found by name above; here the page must not have further ones."""
    lacking = missing_sections()
    assert not lacking, f"docs/reference/file-format.md lacks sections: {', '.join(lacking)}"
    on_page = re.findall(r"<!-- begin (\w+) -->", text_of("docs/reference/file-format.md"))
    mappings = json_schema("study")["$defs"] | json_schema()["$defs"]
    with_keys = [n for n, d in mappings.items() if d["properties"].keys() - {"kind"}]
    assert sorted(on_page) == sorted(["file", "study", *with_keys])


def test_public_names_are_documented() -> None:
    words = code_words(PYTHON)
    for name in fa.__all__:
        value = getattr(fa, name)
        assert inspect.getdoc(value), f"{name} has no docstring"
        # An inherited docstring describes something else.
        if inspect.isclass(value):
            assert value.__dict__.get("__doc__"), f"{name} has only the docstring of its base"
        assert name in words, f"{PYTHON} does not mention {name}"


def test_members_of_arm_are_documented() -> None:
    words = code_words(PYTHON)
    for name in public_members(fa.Arm):
        assert name in words, f"{PYTHON} does not mention Arm.{name}"
        member = inspect.getattr_static(fa.Arm, name)
        if callable(member) or isinstance(member, property):
            assert inspect.getdoc(member), f"Arm.{name} has no docstring"


def test_public_figures_are_documented() -> None:
    for name in fa.plot.__all__:
        assert inspect.getdoc(getattr(fa.plot, name)), f"plot.{name} has no docstring"
        assert f"`fa.plot.{name}(" in text_of(PYTHON), f"{PYTHON} does not mention fa.plot.{name}"


def test_pages_and_examples_import_public_modules_only() -> None:
    """Readers copy lines, and names outside `flexarm` itself may change."""
    pages_and_examples = [text_of(page) for page in pages()]
    pages_and_examples += [path.read_text() for path in (ROOT / "examples").glob("*.py")]
    for text in pages_and_examples:
        found = re.findall(r"^(?:from|import) (flexarm\.[\w.]+)", text, flags=re.MULTILINE)
        assert set(found) <= {"flexarm.bridges.gymnasium_env"}


def test_every_public_name_is_in_one_table() -> None:
    listed = [name for names in GROUPS.values() for name in names]
    public = [*fa.__all__, *(f"plot.{name}" for name in fa.plot.__all__)]
    absent = set(public) - set(listed)
    assert not absent, f"add to a part of GROUPS in tests/docs/python_tables.py: {sorted(absent)}"
    assert sorted(listed) == sorted(public)


def test_names_on_the_page_exist() -> None:
    calls = re.findall(r"`fa\.(\w+)", text_of(PYTHON))
    assert calls
    for call in calls:
        assert hasattr(fa, call), f"{PYTHON} mentions fa.{call}, which does not exist"
    methods = re.findall(r"^\| `(\w+)\(", text_of(PYTHON), flags=re.MULTILINE)
    assert methods
    for name in methods:
        assert hasattr(fa.Arm, name) or hasattr(fa, name), f"{PYTHON}: {name} does not exist"


def test_registries_are_documented() -> None:
    table = text_of(INTEGRATORS_PAGE).partition("| order |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `(\w+)` \| (\d) \|", table, flags=re.MULTILINE)
    assert dict(rows) == {name: str(method.order) for name, method in INTEGRATORS.items()}
    for controller in CONTROLLERS.values():
        assert f"| `{controller.__name__}(" in text_of("docs/reference/python-api.md")
    assert TIMING_LAWS.keys() <= code_words("docs/how-to/plan-a-motion.md")


def test_commands_and_their_options_are_documented() -> None:
    commands = commands_of(typer.main.get_command(app))
    headings = re.findall(r"^## `flexarm ((?:[a-z]+ ?)+)", text_of(COMMANDS), flags=re.MULTILINE)
    assert sorted(heading.strip() for heading in headings) == sorted(commands)
    sections = re.split(r"^## ", text_of(COMMANDS), flags=re.MULTILINE)
    for name, command in commands.items():
        section = next(part for part in sections if part.startswith(f"`flexarm {name}"))
        listed = set(re.findall(r"^\| `(--[\w-]+)", section, flags=re.MULTILINE))
        real = {opt for p in command.params for opt in p.opts if opt.startswith("--")}
        assert listed == real - {"--help"}, f"{COMMANDS}: options of {name}"


def commands_of(group: Any, before: str = "") -> dict[str, Any]:
    """Commands by their names, such as ``run`` and ``export c``."""
    found: dict[str, Any] = {}
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            found |= commands_of(command, f"{before}{name} ")
        else:
            found[before + name] = command
    return found


@pytest.mark.thorough
def test_separation_table_repeats() -> None:
    """Deflections and errors are as shown; times depend on the machine and are only positive."""
    module = script("measure_separation")
    found = part_pattern("separation").search(text_of(ACCURACY_PAGE))
    assert found is not None
    rows = [module.measure(case, repeats=1) for case in module.CASES]
    again = [line.split("|")[1:6] for line in module.table(rows).splitlines()]
    shown = [line.split("|")[1:6] for line in found[1].splitlines()]
    assert again == shown, "run `python docs/performance/measure_separation.py`"
    assert all(ratio > 0.0 for row in rows for ratio in row.ratios)


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["as believed", "all at their worst"])
def test_force_table_repeats(case: str) -> None:
    """Some cells are compared; a tip that bounces may do so differently on another machine."""
    module = script("measure_force")
    page = text_of("docs/performance/controllers.md")
    row = next(line for line in page.splitlines() if line.startswith(f"| {case} |"))
    for cell, name in zip(row.split("|")[2:4], list(module.CONTROLLERS)[:2], strict=True):
        off, beside = module.errors(module.run(module.CONTROLLERS[name], **module.CASES[case]))
        shown_off, shown_beside = cell.split(",")
        assert float(shown_off.strip(" %")) == pytest.approx(off, rel=0.1)
        assert float(shown_beside.strip(" m")) == pytest.approx(beside, rel=0.1)


@pytest.mark.thorough
def test_integrator_table_repeats() -> None:
    module = script("measure_integrators")
    found = part_pattern("integrators").search(text_of(ACCURACY_PAGE))
    assert found is not None
    shown = [[cell.strip(" `") for cell in line.split("|")[1:-1]] for line in found[1].splitlines()]
    measured = module.measure(repeats=1)
    assert len(shown) - 2 == len(measured)
    for (integrator, setting, error, evaluations, _), row in zip(shown[2:], measured, strict=True):
        assert (integrator, setting) == (row.integrator, row.setting)
        # One digit is shown; rounding differs between machines, which moves single steps.
        assert 0.3 < float(error) / row.error < 3.0
        # At loose tolerances rejections follow each other, and their number depends on rounding.
        share = 0.5 if row.setting == "rtol 0.001" else 0.02
        assert float(evaluations) == pytest.approx(row.evaluations, rel=share)


def test_page_of_linear_models_lists_the_channels_that_are_outputs():
    rows = re.findall(r"^\| (`\"joint_angle\".*?\n)\| `fa.Sensor", text_of(LINEARIZE), re.M | re.S)
    assert set(re.findall(r'"(\w+)"', rows[0])) == set(CHANNEL_OUTPUTS)
