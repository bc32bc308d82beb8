"""Excerpts of search results on pages that are opened as files.

The script of Sphinx requests each page that it lists, which browsers refuse for files. The search
page of this site has the texts of all pages in a script, and answers these requests from it.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

_MAIN = re.compile(r'<article role="main"[^>]*>(.*?)</article>', re.DOTALL)
_HIDDEN = re.compile(
    r"<(script|style|math|svg)\b.*?</\1>|<a class=\"headerlink\".*?</a>", re.DOTALL
)
_TAGS = re.compile(r"<(?!/?(?:section|dt)\b)[^>]*>")


def setup(app: Any) -> dict[str, Any]:
    app.connect("html-page-context", _add_scripts)
    app.connect("build-finished", _write_texts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _add_scripts(app: Any, page: str, _template: str, _context: Any, _doctree: Any) -> None:
    if page == "search":
        for name in ("texts.js", "excerpts.js"):
            app.add_js_file(name, priority=100)  # before the script of Sphinx


def _write_texts(app: Any, error: Exception | None) -> None:
    if error is not None:
        return
    folder = Path(app.outdir)
    texts = {}
    for page in folder.rglob("*.html"):
        main = _MAIN.search(page.read_text(encoding="utf-8"))
        if main is not None:
            plain = _TAGS.sub(" ", _HIDDEN.sub(" ", main[1]))
            texts[page.relative_to(folder).as_posix()] = " ".join(plain.split())
    content = json.dumps(texts, ensure_ascii=False, separators=(",", ":"), sort_keys=True)
    (folder / "_static" / "texts.js").write_text(f"const TEXTS = {content};\n", encoding="utf-8")
