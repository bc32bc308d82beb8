"""Cards: moving pictures with their scripts. `make gallery` runs the scripts and writes the pages.

A card is a script in ``gallery/cards``: its docstring has a title, a sentence, and a link to read
on; its code simulates ``arm``, and its last expression is an animation. The page shows the code.

``src/flexarm/library/cards`` has the same runs as files of scenarios or studies, which the studio
offers: their head and their arm are written here, their other keys by hand. Some runs cannot be
written in a file, and their cards have a file of the arm.
"""

from __future__ import annotations

import ast
import contextlib
import os
import re
import shutil
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import flexarm as fa
from gallery.moving_svg import svg

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS, FOLDER = ROOT / "gallery" / "cards", ROOT / "docs" / "cards"
FILES = ROOT / "src" / "flexarm" / "library" / "cards"
ENTRY, OVERVIEW = ROOT / "docs" / "index.md", ROOT / "docs" / "images" / "cards.svg"
#: Names of the scripts, in the order of the entry page.
NAMES = (
    *("paper", "whip", "boom", "chain", "four_bar", "slider_crank", "five_bar", "cam"),
    *("gantry", "crane", "free_flyer", "spin_up", "buckling", "modes", "bounce", "wiping"),
    *("drop", "shaping", "inversion", "obstacle", "strain_feedback", "lqg", "learning"),
    "identification",
)
#: Cards of the picture of the README, four in a row.
SHOWN = ("paper", "whip", "four_bar", "wiping", "crane", "bounce", "shaping", "obstacle")
_COLUMNS, _GAP = 4, 80
WIDTH = 360  # of a picture, pixels

_PAGE = """# {title}

![{title}]({name}.svg)

{sentence}

```python
{code}
```

The file [{name}.yaml]({name}.yaml) contains the {content}. `flexarm studio {name}.yaml` opens it
in the [studio](../how-to/studio.md){menu}. Read on: {more}. [All cards](../index.md)
"""
_MENU = ", whose menu *New* offers it"


@dataclass(frozen=True)
class Card:
    """A script with its texts.

    Attributes:
        name: of the script, the picture and the page. title, sentence: of the page. more: Markdown
            link to a page about the subject. code: without the docstring.
    """

    name: str
    title: str
    sentence: str
    more: str
    code: str


def card(name: str) -> Card:
    """Read a card."""
    text = (SCRIPTS / f"{name}.py").read_text(encoding="utf-8")
    title, sentence, more = (ast.get_docstring(ast.parse(text)) or "").split("\n\n")
    code = text.split('"""', 2)[2].strip()
    return Card(name, title, sentence, more, code)


CARDS = tuple(map(card, NAMES))


def file_text(shown: Card, arm: str) -> str:
    """Return the file of a card: that of the package with another arm, or that of the arm alone."""
    stored = FILES / f"{shown.name}.yaml"
    if not stored.exists():
        return arm
    rest = re.split(r"^arm:\n(?:[ -].*\n)*", stored.read_text(encoding="utf-8"), flags=re.M)[1]
    return f"# {shown.title}: {shown.sentence}\n{arm}{rest}"


def run(shown: Card, folder: Path) -> dict[str, object]:
    """Run the script of a card, and write its picture and its file into a folder.

    Returns the variables of the script.
    """
    scope: dict[str, object] = {"__name__": "__main__"}
    *statements, last = ast.parse(shown.code).body
    assert isinstance(last, ast.Expr)
    script = f"{shown.name}.py"
    with (
        tempfile.TemporaryDirectory() as elsewhere,
        contextlib.chdir(elsewhere),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("error", fa.FlexarmWarning)
        exec(compile(ast.Module(statements, []), script, "exec"), scope)
        animation = eval(compile(ast.Expression(last.value), script, "eval"), scope)
    arm = scope["arm"]
    assert isinstance(arm, fa.Arm)
    file = folder / f"{shown.name}.yaml"
    fa.save_arm(arm, file)
    file.write_text(file_text(shown, file.read_text(encoding="utf-8")), encoding="utf-8")
    text = svg(animation.scenes, animation.fps, animation.speed, WIDTH)
    (folder / f"{shown.name}.svg").write_text(text, encoding="utf-8")
    return scope


def page_text(shown: Card) -> str:
    """Return the page of a card."""
    offered = (FILES / f"{shown.name}.yaml").exists()
    content, menu = ("run", _MENU) if offered else ("arm", "")
    return _PAGE.format(**vars(shown), content=content, menu=menu)


def table(cards: Sequence[Card] = CARDS) -> str:
    """Return the table of the entry page."""
    lines = ["| " * _COLUMNS + "|", "| --- " * _COLUMNS + "|"]
    for first in range(0, len(cards), _COLUMNS):
        cells = [
            f"[![{each.title}](cards/{each.name}.svg)](cards/{each.name}.md)<br>"
            f"**[{each.title}](cards/{each.name}.md)** {each.sentence}"
            for each in cards[first : first + _COLUMNS]
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def with_table(text: str) -> str:
    """Return the entry page with the table of today's cards."""
    parts = re.split(r"(<!-- (?:begin|end) cards -->)", text)
    parts[2] = f"\n\n{table()}\n\n"
    return "".join(parts)


def overview(names: Sequence[str] = SHOWN) -> str:
    """Return one picture of several cards; browsers do not play pictures inside pictures."""
    style, shapes = "", []
    wide = high = 0
    for place, name in enumerate(names):
        text = (FOLDER / f"{name}.svg").read_text(encoding="utf-8").replace("box", f"box-{place}")
        head, style, content = re.split(r"<style>|</style>", text)
        size = re.search(r'viewBox="0 0 (\d+) (\d+)"', head)
        assert size is not None
        wide, high = int(size[1]) + _GAP, int(size[2]) + _GAP
        x, y = place % _COLUMNS * wide, place // _COLUMNS * high
        content = content.removesuffix("</svg>\n").replace('<g id="still"/>', "")
        shapes.append(f'<g transform="translate({x} {y})">{content}</g>')
    wide, high = _COLUMNS * wide - _GAP, -(-len(names) // _COLUMNS) * high - _GAP
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}">'
    return f"{head}<style>{style}</style>{''.join(shapes)}</svg>\n"


def write(names: Sequence[str]) -> None:
    """Run cards, and write their pages, the entry page and the overview."""
    FOLDER.mkdir(exist_ok=True)
    for shown in CARDS:
        if not names or shown.name in names:
            run(shown, FOLDER)
            if (stored := FILES / f"{shown.name}.yaml").exists():
                shutil.copy(FOLDER / stored.name, stored)
            size = os.path.getsize(FOLDER / f"{shown.name}.svg")
            print(f"{shown.name}: {size / 1e3:.0f} kB")
        (FOLDER / f"{shown.name}.md").write_text(page_text(shown), encoding="utf-8")
    ENTRY.write_text(with_table(ENTRY.read_text(encoding="utf-8")), encoding="utf-8")
    OVERVIEW.write_text(overview(), encoding="utf-8")
