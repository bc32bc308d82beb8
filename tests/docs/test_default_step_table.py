"""The table of default steps on random arms, made again on a few of them."""

import runpy

import numpy as np
import pytest
from docs_pages import ROOT

SCRIPT = ROOT / "docs" / "how-to" / "measure_default_step.py"
#: Arms that are measured here, of the 120 of the page.
ARMS = 4


@pytest.fixture(scope="module")
def module():
    return runpy.run_path(str(SCRIPT))


def test_no_default_step_gives_a_wrong_tip(module):
    for case in module["cases"](ARMS):
        for name in module["METHODS"]:
            error, evaluations = module["measure"](case, name)
            assert error is not None, name
            assert error < module["WRONG"], name
            assert evaluations > 0
            assert np.isfinite(error)
