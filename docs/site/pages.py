"""Put the Markdown pages together as Sphinx needs them: one folder, with a navigation.

The pages stay plain Markdown that reads well in a file browser. The copies made here differ in
four ways: links that leave ``docs`` lead to copies, each page that is an index gets a table of
contents of the pages that it links, pages with figures and cards are also notebooks, and live pages
get their scripts.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable
from fnmatch import fnmatch
from pathlib import Path

from notebooks import draws, notebook, runnable
from reference import write_reference

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Pages at the top of the repository, in the order of the navigation; the README is the site's
#: own entry page in other words.
PROJECT = (
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "ARCHITECTURE.md",
    "SUPPORT.md",
    "SECURITY.md",
    "CODE_OF_CONDUCT.md",
)
#: Titles of the navigation, and the folder of the pages below each; "" is the top of ``docs``.
SECTIONS = {
    "Tutorials": "tutorials",
    "Course": "course",
    "Live pages": "live",
    "How-to guides": "how-to",
    "Reference": "reference",
    "Cards": "cards",
    "Background": "",
}
#: Folders whose pages are notebooks if they draw.
NOTEBOOKS = ("tutorials", "course", "how-to")
_LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
#: Rows of a table of pictures, which do not decide the order of the navigation.
_PICTURES = re.compile(r"^\| \[!\[.*$", re.MULTILINE)
#: Scripts of a live page; see ``docs/site/live``.
_SCRIPT = '<script defer src="../_static/{}"></script>\n'
_FENCED = re.compile(r"^(\s*```.*?^\s*```\s*?$)", re.DOTALL | re.MULTILINE)


def assemble(folder: Path, run: str) -> None:
    """Write the sources of the site into an empty folder.

    Args:
        folder: the empty folder. run: pattern of the pages with figures, such as
            ``tutorials/*.md``, whose code is run; other pages show their code alone. All are
            notebooks for their readers.
    """
    ignored = shutil.ignore_patterns("__pycache__", "site")
    shutil.copytree(DOCS, folder, ignore=ignored, dirs_exist_ok=True)
    (folder / "project").mkdir()
    for name in PROJECT:
        shutil.copy(ROOT / name, folder / "project" / name)
    for page in sorted(folder.rglob("*.md")):
        source = _source_of(page.relative_to(folder))
        text = _redirected(page.read_text(encoding="utf-8"), source, page, folder)
        if page.name == "index.md":
            text += _contents(text, page.relative_to(folder))
        if page.parent.name == "live":
            scripts = ("live/kernels.js", f"live/{page.stem}.js", "live.js")
            text += "\n" + "".join(_SCRIPT.format(name) for name in scripts)
        page.write_text(text, encoding="utf-8")
        name = page.relative_to(folder)
        card = name.parts[0] == "cards"
        if card or (name.parts[0] in NOTEBOOKS and draws(text)):
            linked = _with_notebooks(page, text, folder / "notebooks")
            runs = not card and fnmatch(name.as_posix(), run)
            page.write_text(runnable(linked) if runs else linked, encoding="utf-8")
    write_reference(folder / "reference")


def _with_notebooks(page: Path, text: str, folder: Path) -> str:
    """Write the notebooks of a page, and return the text with links to them."""
    folder.mkdir(exist_ok=True)
    exercises, _, solutions = text.partition("\n## Solutions\n")
    versions = {"notebook": (page.stem, text)}
    if solutions:
        versions["notebook without solutions"] = (f"{page.stem}-exercises", exercises)
    links = []
    for label, (name, content) in versions.items():
        (folder / f"{name}.ipynb").write_text(notebook(content), encoding="utf-8")
        links.append(f"{{download}}`{label} <../notebooks/{name}.ipynb>`")
    title, _, rest = text.partition("\n")
    return f"{title}\n\nThis page is also a {' and a '.join(links)}.\n{rest}"


def _source_of(page: Path) -> Path:
    """Return the file of the repository that a page of the site is made from."""
    return ROOT / page.name if page.parts[0] == "project" else DOCS / page


def _redirected(text: str, source: Path, page: Path, folder: Path) -> str:
    """Make links that leave ``docs`` lead to copies of their targets inside the folder."""

    def redirect(match: re.Match[str]) -> str:
        before, target, after = match.groups()
        if re.match(r"\w+:", target):
            return match[0]
        goal = (source.parent / target).resolve()
        place = folder / _place_of(goal)
        if goal.is_file() and not place.exists() and goal.name != "README.md":
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(goal, place)
        return f"{before}{os.path.relpath(place, page.parent)}{after}"

    parts = _FENCED.split(text)
    parts[::2] = [_LINK.sub(redirect, part) for part in parts[::2]]
    return "".join(parts)


def _place_of(goal: Path) -> Path:
    """Return the place of a file of the repository below the folder of the site's sources."""
    if goal == ROOT / "README.md":
        return Path("index.md")
    if goal.parent == ROOT and goal.name in PROJECT:
        return Path("project", goal.name)
    if goal.is_relative_to(DOCS):
        return goal.relative_to(DOCS)
    return Path("files", goal.relative_to(ROOT))


def _contents(text: str, page: Path) -> str:
    """Return the hidden table of contents of an index: the pages it links, in their order."""
    targets = [target for _, target, _ in _LINK.findall(text) if target.startswith("cards/")]
    text = _PICTURES.sub("", text)
    targets = [target for _, target, _ in _LINK.findall(text)] + targets
    linked = [target for target in targets if target.endswith(".md")]
    linked = list(dict.fromkeys(linked))
    if len(page.parts) > 1:
        return _toctree("", [name for name in linked if "/" not in name])
    parts = []
    for title, folder in SECTIONS.items():
        inside = [name for name in linked if name.rpartition("/")[0] == folder]
        if not folder:
            sections = tuple(f"{name}/" for name in SECTIONS.values() if name)
            indexes = (name for name in linked if name.endswith("/index.md"))
            inside += [name for name in indexes if not name.startswith(sections)]
        parts.append(_toctree(title, inside))
    parts.append(_toctree("Project", [f"project/{name}" for name in PROJECT]))
    return "".join(parts)


def _toctree(title: str, names: Iterable[str]) -> str:
    caption = f":caption: {title}\n" if title else ""
    lines = "\n".join(name.removesuffix(".md") for name in names)
    return f"\n\n```{{toctree}}\n:hidden:\n{caption}\n{lines}\n```\n"
