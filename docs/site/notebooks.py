"""Pages that draw figures as notebooks: their code runs while the site is built.

A block of a page becomes a cell: Python as it is, a file with ``title=NAME`` as ``%%writefile``,
commands with ``!``. The output printed on the page is left out, because the notebook prints its
own; the tests compare the two (``tests/docs/test_docs_examples.py``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

_FENCE = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
#: Parts that a page folds; Jupyter renders each cell alone, and cannot fold several.
_FOLDED = re.compile(r"^</details>\n|^<details>\s*<summary>(.*?)</summary>\n", re.MULTILINE)
_DRAWING = re.compile(r"\bplt\.|\bfa\.plot\.\w+\(")
#: Stored pictures after code that draws them.
_STORED = re.compile(r"(?<=^```\n)\n(?:!\[[^\]]*\]\([\w-]+\.png\)\n)+", re.MULTILINE)
_KERNEL = {"name": "python3", "display_name": "Python 3", "language": "python"}
_HEAD = "---\nfile_format: mystnb\nkernelspec:\n  name: python3\n---\n\n"
#: First cell of the notebooks that the build runs: sharp figures, commands without progress
#: bars, which must succeed, and no values but those that are printed.
_SETTINGS = """%config InlineBackend.figure_formats = ['retina']
%env TERM=dumb
get_ipython().ast_node_interactivity = "none"
get_ipython().system_raise_on_error = True"""


def draws(text: str) -> bool:
    """Return whether Python blocks of a page draw, and none of its blocks needs other files."""
    blocks = _FENCE.findall(text)
    drawing = any(_DRAWING.search(code) for language, _, code in blocks if language == "python")
    return drawing and not any("examples/" in code for _, _, code in blocks)


def runnable(text: str) -> str:
    """Return a page as a text notebook that MyST-NB runs."""
    settings = new_code_cell(_SETTINGS, metadata={"tags": ["remove-cell"]})
    cells = [settings, *_cells(_STORED.sub("", text))]
    return _HEAD + "\n\n".join(_directive(cell) for cell in cells) + "\n"


def _directive(cell: nbformat.NotebookNode) -> str:
    """Return a cell in the notation of text notebooks."""
    if cell.cell_type == "markdown":
        return str(cell.source)
    tags = f":tags: {cell.metadata.tags}\n" if "tags" in cell.metadata else ""
    return f"```{{code-cell}} python\n{tags}{cell.source}\n```"


def notebook(text: str) -> str:
    """Return the ``.ipynb`` file of a page, for its readers."""
    cells = list(_cells(_FOLDED.sub(lambda fold: f"### {fold[1]}\n" if fold[1] else "", text)))
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"  # random ones would make two builds differ
    return str(nbformat.writes(new_notebook(cells=cells, metadata={"kernelspec": _KERNEL})))


def _cells(text: str) -> Iterator[nbformat.NotebookNode]:
    """Yield the cells of a page, in order."""
    end, ran = 0, False
    for match in _FENCE.finditer(text):
        between = text[end : match.start()].strip()
        language, options, code = match[1], match[2].split(), match[3].rstrip()
        if between:
            yield new_markdown_cell(between)
        shown_output = language == "text" and ran and not between
        ran = False
        cell = None if shown_output else _cell(language, options, code)
        if cell is not None:
            ran = cell.cell_type == "code"
            yield cell
        elif not shown_output:
            yield new_markdown_cell(match[0])
        end = match.end()
    rest = text[end:].strip()
    if rest:
        yield new_markdown_cell(rest)


def _cell(language: str, options: list[str], code: str) -> nbformat.NotebookNode | None:
    """Return the code cell of a block, or None for a block that is only shown."""
    titles = [option.partition("=")[2] for option in options if option.startswith("title=")]
    others = [option for option in options if not option.startswith("title=")]
    if others:  # it needs another program, or shows an error
        return None
    if language == "python":
        # A notebook shows the figures that are open at the end of a cell.
        return new_code_cell(code.replace('plt.close("all")', "").rstrip())
    if titles:
        return new_code_cell(f"%%writefile {titles[0]}\n{code}")
    lines = code.splitlines()
    if language == "bash" and all(line.startswith("flexarm ") for line in lines):
        return new_code_cell("\n".join(f"!{line}" for line in lines))
    return None
