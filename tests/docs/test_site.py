"""The documentation site: its build has no warnings, and it is complete."""

from __future__ import annotations

import html
import importlib
import json
import re
from functools import cache
from pathlib import Path

import pytest
from docs_pages import ROOT, pages
from python_tables import GROUPS
from test_docs_equations import tags

import flexarm as fa
from built_site import NOTEBOOK, built_site

_LINK = re.compile(r'\b(?:href|src)="([^"]*)"')
_ID = re.compile(r'\bid="([^"]*)"')
_CODE = re.compile(r"<(pre|code|script|style)\b.*?</\1>", re.DOTALL)


@pytest.mark.thorough
def test_site_is_complete(tmp_path_factory: pytest.TempPathFactory) -> None:
    site = built_site(tmp_path_factory)
    for check in (
        check_every_page_is_in_the_navigation,
        check_links_have_targets,
        check_no_file_is_requested_from_a_network,
        check_public_names_have_docstrings,
        check_equations_are_rendered,
        check_search_finds_words,
        check_search_has_excerpts,
        check_notebook_has_run,
    ):
        check(site)


def test_students_get_notebooks_without_solutions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("nbformat", reason="it comes with the extra: pip install 'flexarm[docs]'")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    assemble = importlib.import_module("pages").assemble
    assemble(tmp_path, "")
    parts = [page for page in (ROOT / "docs" / "course").glob("*.md") if page.stem != "index"]
    assert parts
    for part in parts:
        folder = tmp_path / "notebooks"
        whole = (folder / f"{part.stem}.ipynb").read_text(encoding="utf-8")
        exercises = (folder / f"{part.stem}-exercises.ipynb").read_text(encoding="utf-8")
        assert "## Exercises" in exercises
        assert "## Solutions" not in exercises
        assert "## Solutions" in whole
        assert "<details>" not in whole, "Jupyter would fold the text and not its cells"


def check_every_page_is_in_the_navigation(site: Path) -> None:
    entry = (site / "index.html").read_text(encoding="utf-8")
    navigation = entry.partition('class="sidebar-tree"')[2].partition("</aside>")[0]
    reached = set(_LINK.findall(navigation)) | {"index.html"}
    expected = {_address(page) for page in pages() if page != "README.md"}
    assert expected <= reached, f"not in the navigation: {sorted(expected - reached)}"


def _address(page: str) -> str:
    """Return the place on the site of a page of the repository."""
    name = page.removesuffix(".md") + ".html"
    return name.removeprefix("docs/") if name.startswith("docs/") else f"project/{name}"


def check_links_have_targets(site: Path) -> None:
    @cache
    def ids(path: Path) -> set[str]:
        return set(map(html.unescape, _ID.findall(path.read_text(encoding="utf-8"))))

    followed = 0
    for page in site.rglob("*.html"):
        for link in map(html.unescape, _LINK.findall(page.read_text(encoding="utf-8"))):
            name, _, anchor = link.partition("#")
            if re.match(r"\w+:", name):
                continue
            goal = (page.parent / name.partition("?")[0]).resolve() if name else page
            assert goal.is_file(), f"{page.relative_to(site)}: {link}"
            if anchor and goal.suffix == ".html":
                assert anchor in ids(goal), f"{page.relative_to(site)}: {link}"
            followed += 1
    assert followed > 1000


def check_no_file_is_requested_from_a_network(site: Path) -> None:
    loaded = re.compile(r'<(?:script|link|img|iframe)\b[^>]*"((?:https?:)?//[^"]*)"')
    for page in site.rglob("*.html"):
        assert not loaded.findall(page.read_text(encoding="utf-8")), page


def check_public_names_have_docstrings(site: Path) -> None:
    text = "".join(
        page.read_text(encoding="utf-8") for page in (site / "reference" / "api").glob("*.html")
    )
    names = {name for names in GROUPS.values() for name in names}
    assert set(fa.__all__) <= names
    for name in names:
        described = text.partition(f'id="flexarm.{name}"')[2].partition("</dt>")[2]
        assert described.lstrip().startswith("<dd><p>"), f"{name} has no docstring on the site"


def check_equations_are_rendered(site: Path) -> None:
    theory = "".join(page.read_text(encoding="utf-8") for page in site.glob("theory/*.html"))
    for letter, number in tags():
        name = f'id="equation-{letter}-{number}"'
        assert f'{name}><div class="formula"><math display="block">' in theory, name
    for page in site.rglob("*.html"):
        prose = _CODE.sub("", page.read_text(encoding="utf-8"))
        assert not re.search(r"\$\$|\\(mathbf|tfrac|dot|tag)\b", prose), page
    cited = (site / "reference" / "api" / "linear.html").read_text(encoding="utf-8")
    assert '../../theory/small-motion.html#equation-S-1">(S.1)</a>' in cited


def check_search_finds_words(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    found = json.loads(index.removeprefix("Search.setIndex(").removesuffix(")"))
    numbers = found["terms"]["timoshenko"]
    numbers = [numbers] if isinstance(numbers, int) else numbers
    assert "theory/beams" in {found["docnames"][number] for number in numbers}


def check_search_has_excerpts(site: Path) -> None:
    """The texts that the search page shows without requests, which files do not answer."""
    script = (site / "_static" / "texts.js").read_text(encoding="utf-8")
    texts = json.loads(script.removeprefix("const TEXTS = ").removesuffix(";\n"))
    assert {_address(page) for page in pages() if page != "README.md"} <= set(texts)
    assert "Timoshenko beam" in texts["theory/beams.html"]
    assert '<section id="bending">' in texts["theory/beams.html"]
    search = (site / "search.html").read_text(encoding="utf-8")
    assert search.index("excerpts.js") < search.index("searchtools.js")
    assert "texts.js" not in (site / "index.html").read_text(encoding="utf-8")


def check_notebook_has_run(site: Path) -> None:
    page = (site / NOTEBOOK).with_suffix(".html").read_text(encoding="utf-8")
    assert "largest deflection 65.9 mm" in page, "the output of a cell"
    assert re.search(r'<img[^>]*src="[^"]*_images/\w+\.png"', page), "the figure of a cell"
    (download,) = re.findall(r'href="([^"]*first-run\.ipynb)"', page)
    cells = json.loads(((site / NOTEBOOK).parent / download).read_text(encoding="utf-8"))["cells"]
    assert any("".join(cell["source"]).startswith("%%writefile beam.yaml") for cell in cells)
