"""ARCHITECTURE.md agrees with the import contract and with the files of the repository."""

from __future__ import annotations

import re
import tomllib

from docs_pages import ROOT, blocks

PAGE = "ARCHITECTURE.md"


def block_that_starts_with(word: str) -> str:
    return next(block.text for block in blocks(PAGE) if block.text.startswith(word))


def test_layers_equal_the_import_contract() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    layers = next(c["layers"] for c in contracts if c["type"] == "layers")
    assert block_that_starts_with("cli").split("\n")[:-1] == layers


def test_tree_of_the_package_is_complete() -> None:
    text, _, rest = block_that_starts_with("src/flexarm/").partition("\ntests/")
    drawn = set(re.findall(r"^  (\w[\w.]*/?) ", text, flags=re.MULTILINE))
    folder = ROOT / "src" / "flexarm"
    real = {f"{p.name}/" if p.is_dir() else p.name for p in folder.iterdir()}
    assert drawn == real - {"__pycache__/"}
    assert rest, "the tree goes on with the tests"


def test_every_kernel_is_named() -> None:
    """Each file has one algorithm, so the list of files is the list of compiled algorithms."""
    text = (
        block_that_starts_with("src/flexarm/")
        .partition("\n  kernels/")[2]
        .partition("\n  integrate/")
    )
    named = set(re.findall(r"\w+", text[0]))
    real = {path.stem for path in (ROOT / "src/flexarm/kernels").rglob("*.py")} - {"__init__"}
    assert real <= named, real - named


def test_tree_of_the_tests_is_complete() -> None:
    text = block_that_starts_with("src/flexarm/").partition("\ntests/")[2].partition("\ndocs/")[0]
    drawn = {n for line in text.splitlines() for n in re.findall(r"(\w+)/", line[:29])}
    real = {p.name for p in (ROOT / "tests").iterdir() if p.is_dir()}
    assert drawn == real - {"__pycache__"}


def test_every_file_is_short() -> None:
    for path in [*(ROOT / "src").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]:
        assert len(path.read_text(encoding="utf-8").splitlines()) < 600, path


def test_functions_of_the_two_lists_exist_and_are_counted() -> None:
    page = (ROOT / PAGE).read_text(encoding="utf-8")
    section = page.partition("### Two values on their way")[2].partition("\n## ")[0]
    sources = [p.read_text(encoding="utf-8") for p in (ROOT / "src" / "flexarm").rglob("*.py")]
    defined = {name for text in sources for name in re.findall(r"def (\w+)\(", text)}
    ways = re.findall(
        r"\*\*[^*]*: (\d+) functions\.\*\*(.*?)\n\((\d+) more:(.*?)\)\n", section, re.S
    )
    assert len(ways) == 2
    values = r"^(?!Link$|E I|PiecewiseCubic$|w2$|ArmConstants$)"
    for stated, acting, more, handing in ways:
        for count, text in ((stated, acting), (more, handing)):
            names = [n for n in re.findall(r"`([\w.]+)`", text) if re.match(values, n)]
            assert {n.rpartition(".")[2] for n in names} <= defined, names
            assert len(names) == int(count), names
