"""The study files in ``examples/studies`` run, and what comes out is what they say."""

from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from flexarm.model import locate_study

STUDIES = Path(__file__).parents[2] / "examples" / "studies"


def test_every_file_is_tested_here():
    assert {path.stem for path in STUDIES.glob("*.yaml")} == {"drives", "wipe"}


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_file_says_what_it_shows(path):
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert f"flexarm compare examples/studies/{path.name}" in text


def test_feedback_and_feedforward_together_hold_up():
    study = locate_study(STUDIES / "drives.yaml")[0]
    table = fa.run_study(study, progress=False)
    assert (table.failure == "").all()
    error = table.tip_error_rms.sel(reference="line", plant="payload doubled")
    best = error.sel(controller="joint PD and rigid torque")
    assert best < 0.5 * error.sel(controller="joint PD")
    assert best < 0.5 * error.sel(controller="rigid torque alone")


@pytest.fixture(scope="module")
def wiped():
    return fa.run_study(STUDIES / "wipe.yaml", progress=False).sel(reference="wipe")


def test_force_controllers_keep_the_force_on_every_arm(wiped):
    assert (wiped.failure == "").all()
    controlled = wiped.drop_sel(controller="joint PD")
    # Of 5 N in the mean: what friction that turns over and links that swing leave.
    assert controlled.force_error_rms.max() < 0.35
    assert controlled.force_error_peak.max() < 1.5
    assert (controlled.force_error_peak > controlled.force_error_rms).all()
    # Nothing presses: the error is the force asked for, 3 to 7 N.
    assert wiped.force_error_rms.sel(controller="joint PD").min() > 5.0
    assert wiped.force_error_peak.sel(controller="joint PD").min() > 6.0


def test_measuring_the_force_helps_impedance(wiped):
    rms = wiped.force_error_rms
    assert (rms.sel(controller="measuring impedance") < rms.sel(controller="impedance")).all()


def test_softer_links_cost_place_along_the_wall(wiped):
    peak = wiped.tip_error_peak.drop_sel(controller="joint PD")
    assert (peak.sel(plant="soft") > 1.5 * peak.sel(plant="as believed")).all()
    assert np.isfinite(peak).all()
