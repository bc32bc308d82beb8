"""The tables of random arms have the laws of their study, and the columns of their script."""

from __future__ import annotations

import pytest
from reference_tables import table_rows

from flexarm.model import locate_study
from page_scripts import script


@pytest.mark.parametrize("plant", ["constant", "changing"])
def test_every_law_has_a_row(plant: str) -> None:
    """tests/examples/test_study_files.py runs a part of the study."""
    module = script("measure_random_arms")
    study, _ = locate_study(module.STUDY)
    rows = table_rows("docs/performance/controllers.md", plant)
    assert {row[0] for row in rows} == set(study.drives)
    medians = []
    for _, nominal, median, most, worst, ratio, failures in rows:
        assert float(median) <= float(most) <= float(worst)
        # The columns of errors are rounded to 0.1 and 0.01 mm, which is 0.01 of most ratios.
        if float(nominal) > 0.1:
            assert float(median) / float(nominal) == pytest.approx(float(ratio), rel=0.05)
        medians.append(float(median))
        assert failures.endswith(" %")
    assert medians == sorted(medians)
