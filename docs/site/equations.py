"""Equations as MathML, which browsers draw without a script and without a network.

An equation with ``\\tag{R.8}`` carries its number and can be linked to. Where text or a docstring
cites ``(R.8)``, it becomes such a link.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docutils import nodes
from math_core import LatexToMathML
from sphinx.application import Sphinx

_TAG = re.compile(r"\\tag\{([A-Z])\.(\d+[a-z]?)\}")
_CITED = re.compile(r"\(([A-Z])\.(\d+)([a-z]?)\)")
_converter = LatexToMathML(fancy_error=False)


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_inline, None), block_renderers=(_block, None)
    )
    app.connect("builder-inited", _find_equations)
    app.connect("doctree-resolved", _link_citations)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_converter.convert_with_local_state(node.astext(), displaystyle=False))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    latex = node.astext()
    tag = _TAG.search(latex)
    mathml = _converter.convert_with_local_state(_TAG.sub("", latex), displaystyle=True)
    number = name = ""
    if tag:
        name = f' id="equation-{tag[1]}-{tag[2]}"'
        number = f'<span class="eqno">({tag[1]}.{tag[2]})</span>'
    writer.body.append(
        f'<div class="equation"{name}><div class="formula">{mathml}</div>{number}</div>\n'
    )
    raise nodes.SkipNode


def _find_equations(app: Sphinx) -> None:
    """Find the page of each number."""
    app.equation_pages = {  # type: ignore[attr-defined]
        tag: page.relative_to(app.srcdir).with_suffix("").as_posix()
        for page in Path(app.srcdir).rglob("theory/*.md")
        for tag in _TAG.findall(page.read_text(encoding="utf-8"))
    }


def _link_citations(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Turn numbers of equations in the text into links."""
    known = app.equation_pages  # type: ignore[attr-defined]
    for text in list(doctree.findall(nodes.Text)):
        if isinstance(text.parent, nodes.TextElement) and not isinstance(
            text.parent, nodes.literal | nodes.literal_block | nodes.math | nodes.reference
        ):
            pieces, end = [], 0
            for match in _CITED.finditer(text):
                # A letter is that of an equation, or of a part of one.
                tags = [(match[1], match[2] + match[3]), (match[1], match[2])]
                tag = next((tag for tag in tags if tag in known), None)
                if tag is None:
                    continue
                goal = app.builder.get_relative_uri(page, known[tag])
                uri = f"{goal}#equation-{tag[0]}-{tag[1]}"
                pieces += [nodes.Text(text[end : match.start()])]
                pieces += [nodes.reference(match[0], match[0], internal=True, refuri=uri)]
                end = match.end()
            if pieces:
                text.parent.replace(text, [*pieces, nodes.Text(text[end:])])
