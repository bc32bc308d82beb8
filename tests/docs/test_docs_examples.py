"""Every code block of the documentation runs, and its output is that of the page.

Blocks of a page run in order, in one empty folder and one Python namespace:

- ``yaml`` blocks that begin with ``flexarm:`` are read as files; with ``title=NAME`` in the head
  line they are saved under that name for later blocks. Other ``yaml`` blocks show keys of an arm,
  a link or a scenario and are tried on the arm of two links below.
- ``python`` blocks are executed. With ``requires=NAME`` in the head line a block needs another
  program: it runs in a separate test, which is skipped if the program is not installed;
  ``requires=flexarm`` keeps a slow block out of the short suite. With
  ``runs=sample`` its ``fa.compare`` simulates two plants for each controller, and these cells of
  its output are compared; ``FULL_PAGES=1`` (``make suite ALL=1 FULL=1``) simulates all of them.
- ``bash`` blocks whose lines begin with ``flexarm`` run; ``exit=2`` in the head line is the
  expected exit status. ``make`` lines must name a chore of the Makefile.
- a ``text`` block directly after a block that ran is its output; ``...`` matches any text.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from docs_pages import ROOT, Block, blocks, pages
from sampled_comparison import SampledComparison, fits_sample
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.main import app
from flexarm.model import ArmSpec, Link, Scenario, load_arm_spec, load_scenario, locate_study
from flexarm.model.file_format.files import load_hardware
from flexarm.model.identification import locate_identification

RUNNING = ("yaml", "python", "bash")
#: Pages of cards are made of scripts, which tests/gallery/test_moving.py runs.
PAGES = [
    page
    for page in pages()
    if any(block.language in RUNNING for block in blocks(page)) and "docs/cards/" not in page
]
#: Simulate all cells of all tables, instead of a sample of those of the longest ones.
FULL = bool(os.environ.get("FULL_PAGES"))
#: Commands that run in separate tests only; `warmup` compiles or loads all machine code.
ELSEWHERE = {"warmup", "studio"}  # tests/cli/test_warmup.py, tests/browser/test_studio.py
_LINK = {"length": 1.0, "flexural_rigidity": 10.0, "mass_per_length": 1.0}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return an empty folder with the examples of the repository, as the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    if (ROOT / "examples").exists():
        shutil.copytree(ROOT / "examples", tmp_path / "examples")
    yield tmp_path
    if "matplotlib.pyplot" in sys.modules:  # Matplotlib warns of more than twenty open figures
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.mark.sampled(
    "CONTRIBUTING.md",
    "docs/reference/file-format.md",
    "docs/how-to/read-the-result.md",
    "docs/how-to/prescribe-a-motion.md",
    "docs/how-to/handle-errors.md",
    "docs/how-to/differentiate-a-step.md",
    "docs/how-to/plan-a-motion.md",
    "docs/tutorials/first-run.md",
)
@pytest.mark.parametrize("page", PAGES)
def test_blocks_of_page(page: str, folder: Path) -> None:
    run_blocks(page)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("page", "program"),
    sorted(
        {
            (page, block.option("requires"))
            for page in PAGES
            for block in blocks(page)
            if block.option("requires")
        }
    ),
)
def test_blocks_with_another_program(page: str, program: str, folder: Path) -> None:
    pytest.importorskip(program, reason=f"{program} is not installed: the blocks were not run")
    run_blocks(page, program)


def run_blocks(page: str, program: str = "") -> None:
    """Run the blocks of a page; with ``program`` only those that require it."""
    with np.printoptions(), warnings.catch_warnings():  # a page may set its own
        warnings.simplefilter("error", fa.ImplausibleValueWarning)
        _run_blocks(page, program)


def _run_blocks(page: str, program: str) -> None:
    scope: dict[str, Any] = {"__name__": "__main__"}
    printed: str | None = None
    sampled = False
    for block in blocks(page):
        if block.option("requires") not in ("", program):
            printed = None
            continue
        if block.language == "text" and printed is not None:
            assert_output(block, printed, sampled)
        printed = run(block, scope) if block.language in RUNNING else None
        sampled = is_sampled(block)


def run(block: Block, scope: dict[str, Any]) -> str:
    """Run a block and return its output."""
    if block.language == "bash":
        return "".join(run_command(block, line) for line in block.text.splitlines())
    if block.language == "yaml":
        read_yaml(block)
        return ""
    # Empty lines in front give tracebacks the line numbers of the page.
    source = "\n" * (block.line - 1) + block.text
    with contextlib.redirect_stdout(io.StringIO()) as stream, pytest.MonkeyPatch.context() as patch:
        if is_sampled(block):
            patch.setattr(fa, "compare", SampledComparison())
        exec(compile(source, str(ROOT / block.page), "exec"), scope)
    return stream.getvalue()


def is_sampled(block: Block) -> bool:
    return block.option("runs") == "sample" and not FULL


def assert_output(block: Block, printed: str, sampled: bool = False) -> None:
    if sampled:
        fits = fits_sample(tidy(printed), tidy(block.text))
    else:
        pieces = [re.escape(piece) for piece in tidy(block.text).split("...")]
        fits = bool(re.fullmatch(".*?".join(pieces), tidy(printed), flags=re.DOTALL))
    assert fits, f"{block}: the page says\n{block.text}\nbut this was printed:\n{printed}"


def tidy(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def run_command(block: Block, line: str) -> str:
    words = shlex.split(line, comments=True)
    if not words or words[0] not in ("flexarm", "make"):
        return ""
    if words[0] == "make":
        chores = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
        assert set(words[1:]) <= set(chores), f"{block}: the Makefile has no such chore: {line}"
        return ""
    if words[1] in ELSEWHERE:
        words.append("--help")
    done = CliRunner().invoke(app, words[1:], env={"COLUMNS": "100", "NO_COLOR": "1"})
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    printed = done.output
    # With an empty cache the first run prints that it compiles; no page shows that.
    # Lines of progress appear if the machine is slow.
    printed = re.sub(
        r"^(flexarm: compiling|(simulating|designing): ).*\n", "", printed, flags=re.MULTILINE
    )
    expected = int(block.option("exit", "0"))
    assert done.exit_code == expected, f"{block}: {line}\nexit {done.exit_code}\n{printed}"
    return printed


def read_yaml(block: Block) -> None:
    content = yaml.safe_load(block.text)
    assert isinstance(content, dict), f"{block}: not a mapping"
    if "flexarm" not in content:
        read_fragment(block, content)
        return
    path = Path(block.option("title", "block.yaml"))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(block.text)
    if block.option("broken"):
        return
    if "drives" in content:
        locate_study(path)
    elif "records" in content:
        locate_identification(path)
    elif "run" in content:
        load_scenario(path)
    elif "arm" not in content:
        load_hardware(path)
    else:
        load_arm_spec(path)


def read_fragment(block: Block, content: dict[str, Any]) -> None:
    """Read keys of a scenario, of its arm or of the arm's first link on an arm of two links."""
    described = {"material", "section", "table"} & content.keys()
    link = {"length": 1.0} if described else dict(_LINK)
    arm: dict[str, Any] = {"links": [link, dict(_LINK)]}
    scenario: dict[str, Any] = {"arm": arm, "run": {"duration": 1.0}}
    for key, value in content.items():
        homes = ((Link, link), (ArmSpec, arm), (Scenario, scenario))
        home = next((home for model, home in homes if key in model.model_fields), None)
        assert home is not None, f"{block}: {key} is no key of a file"
        home[key] = value
    if "drive" in content and "motion" not in content:
        scenario["motion"] = {"kind": "joint", "start": [0, 0], "end": [1, 1], "duration": 1}
    text = yaml.safe_dump({"flexarm": 1, **scenario})
    path = Path("fragment.yaml")
    path.write_text(text)
    load_scenario(path)


@pytest.mark.parametrize(
    ("printed", "fits"),
    [
        ("PD 79.0 131.1 1.7x  nan  nanx", True),
        ("PD 79.1 131.1 1.7x  nan  nanx", False),  # another number
        ("PI 79.0 131.1 1.7x  nan  nanx", False),  # another word
        ("PD 79.0 131.1 1.7x  nan", False),
        ("PD nan nan nanx nan nanx", False),  # nothing of the row was simulated
        ("PD 79.0 131.1 1.7x 93.3 1.2x", False),  # no sample
        ("PD 79.0 131.1 1.7x nan nanx\nPD", False),
    ],
)
def test_fits_sample_accepts_nan_and_rejects_other_numbers(printed: str, fits: bool) -> None:
    assert fits_sample(printed, "PD       79.0 131.1   1.7x  93.3   1.2x") is fits
