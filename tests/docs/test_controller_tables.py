"""The scripts of the tables of controllers give a sample of the cells of the page."""

from __future__ import annotations

import re

import pytest
from docs_pages import text_of
from reference_tables import part_pattern
from sampled_comparison import SampledComparison, fits_sample

import flexarm as fa
from page_scripts import script

PAGE = "docs/performance/controllers.md"
PARTS = {
    "measure_changing_arms": ("changes", "faults"),
    "measure_damping": ("damping",),
    "measure_uncertain_arms": ("uncertain",),
    "measure_which_controller": ("study",),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PARTS)
def test_script_gives_the_table_or_a_sample_of_it(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fa, "compare", SampledComparison())
    tables = dict(script(name).tables())
    assert tuple(tables) == PARTS[name]
    for part, text in tables.items():
        shown = part_pattern(part).search(text_of(PAGE))
        assert shown is not None
        block = re.fullmatch(r"```text\n(.*)\n```", shown[1], flags=re.DOTALL)
        assert block is not None
        sampled = bool(re.search(r"\bnan", text))
        fits = fits_sample(text, block[1]) if sampled else text == block[1]
        assert fits, f"{part} differs:\n{text}"
