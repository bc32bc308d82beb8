"""Parts of the pages of the documentation: fenced blocks, links, headings."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Pages in the top folder of the repository; the others are below docs/.
_TOP = (
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "CODE_OF_CONDUCT.md",
    "SECURITY.md",
    "SUPPORT.md",
)
_FENCE = re.compile(r"^\s*```(\w*)\s*(.*?)\s*$")


@dataclass(frozen=True)
class Block:
    """A fenced block: ```` ```language option option ```` and the lines up to the closing fence.

    Attributes:
        page: path below the root of the repository. line: number of the first line inside.
    """

    page: str
    line: int
    language: str
    options: tuple[str, ...]
    text: str

    def option(self, name: str, default: str = "") -> str:
        """Value of an option written ``name=value``."""
        pairs = (option.partition("=") for option in self.options)
        return next((value.strip('"') for key, _, value in pairs if key == name), default)

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[str]:
    """Return the paths of all pages, below the root of the repository."""
    found = [page for page in _TOP if (ROOT / page).exists()]
    return found + sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md"))


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str) -> list[Block]:
    """Return the fenced blocks of a page, in order."""
    found: list[Block] = []
    inside: list[str] | None = None
    head, start = ("", ""), 0
    for number, line in enumerate(text_of(page).splitlines(), start=1):
        fence = _FENCE.match(line)
        if fence and inside is None:
            head, start, inside = (fence[1], fence[2]), number + 1, []
        elif fence and inside is not None:
            text = "\n".join(inside) + "\n"
            found.append(Block(page, start, head[0], tuple(head[1].split()), text))
            inside = None
        elif inside is not None:
            inside.append(line)
    assert inside is None, f"{page}:{start}: the block is never closed"
    return found


def prose(page: str) -> str:
    """Return a page without the text of its fenced blocks; line numbers do not change."""
    lines = text_of(page).splitlines()
    fenced = False
    for i, line in enumerate(lines):
        if _FENCE.match(line):
            fenced = not fenced
            lines[i] = ""
        elif fenced:
            lines[i] = ""
    return "\n".join(lines)


def anchors(page: str) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    found: set[str] = set()
    for heading in re.findall(r"^#+\s+(.*)$", prose(page), flags=re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        copies = sum(1 for other in found if other == slug or other.startswith(f"{slug}-"))
        found.add(slug if slug not in found else f"{slug}-{copies}")
    return found
