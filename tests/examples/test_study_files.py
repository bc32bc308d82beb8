"""The study files in ``examples/studies`` run, and give the results that they state."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flexarm as fa
from default_runs import PROMISED, DefaultRun, record
from flexarm.model import locate_study

STUDIES = Path(__file__).parents[2] / "examples" / "studies"


def test_every_file_is_tested_here():
    assert {path.stem for path in STUDIES.glob("*.yaml")} == {"drives", "random_arms", "wipe"}


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_file_describes_its_result(path):
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert f"flexarm compare examples/studies/{path.name}" in text


@cache
def study(name: str) -> tuple[xr.Dataset, list[DefaultRun]]:
    """Return the table of a study and its runs, computed once for all tests."""
    with pytest.MonkeyPatch.context() as patch:
        runs = record(patch)
        return fa.run_study(STUDIES / f"{name}.yaml", progress=False), runs


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["drives", "wipe"])
def test_default_tolerances_are_accurate(name):
    """One run of each drive is repeated, on the plants in turn, which differ in parameters only."""
    table, runs = study(name)
    drives, plants, references = table.failure.shape
    assert len(runs) == table.failure.size, "a run that failed, or was made elsewhere"
    assert (drives >= plants, references) == (True, 1), "a plant without a run in the sample"
    chosen = [runs[drive * plants + drive % plants] for drive in range(drives)]
    assert 0.0 < max(run.error() for run in chosen) <= PROMISED


@pytest.mark.thorough
def test_references_of_the_flexible_arm_have_the_smallest_errors():
    table, _ = study("drives")
    assert (table.failure == "").all()
    error = table.tip_error_rms.sel(reference="line")
    rigid = error.sel(controller="joint PD, rigid reference")
    for drive in ("joint PD", "computed torque", "joint PD, tip inversion"):
        assert error.sel(controller=drive, plant="as believed") < 1e-3, "metres, as stated"
        assert (error.sel(controller=drive) < 0.7 * rigid).all()
    alone = error.sel(controller="rigid torque alone", plant="payload doubled")
    assert error.sel(controller="joint PD", plant="payload doubled") < 0.5 * alone


OPEN_LOOP_FORCE = ["joint PD", "joint PD without feedforward"]


@pytest.fixture(scope="module")
def wiped():
    return study("wipe")[0].sel(reference="wipe")


@pytest.mark.thorough
def test_force_controllers_follow_the_force_on_every_arm(wiped):
    assert (wiped.failure == "").all()
    controlled = wiped.drop_sel(controller=OPEN_LOOP_FORCE)
    # Of 5 N in the mean; the causes are reversing friction and vibration of the links.
    assert controlled.force_error_rms.max() < 0.35
    assert controlled.force_error_peak.max() < 1.5
    assert (controlled.force_error_peak > controlled.force_error_rms).all()
    # Rigid joint angles do not press, so the error is the requested force, 3 to 7 N.
    without = wiped.sel(controller="joint PD without feedforward")
    assert without.force_error_rms.min() > 5.0
    assert without.force_error_peak.min() > 6.0
    # The torques of the bent arm press as well as force control, and slip aside further.
    assert wiped.force_error_rms.sel(controller="joint PD").max() < 0.35


@pytest.mark.thorough
def test_force_measurement_improves_impedance_control(wiped):
    rms = wiped.force_error_rms
    assert (rms.sel(controller="measuring impedance") < rms.sel(controller="impedance")).all()


@pytest.mark.thorough
def test_softer_links_increase_the_error_along_the_wall(wiped):
    peak = wiped.tip_error_peak.drop_sel(controller=OPEN_LOOP_FORCE)
    assert (peak.sel(plant="soft") > 1.5 * peak.sel(plant="as believed")).all()
    assert np.isfinite(peak).all()


@pytest.mark.thorough
def test_random_arms_in_a_small_version():
    """Four of the twelve drives on two of the 64 arms."""
    whole, _ = locate_study(STUDIES / "random_arms.yaml")
    assert len(whole.drives) == 12
    names = "LQG", "joint PD", "joint PD, rigid", "disturbance observer"
    drives = {name: whole.drives[name] for name in names}
    small = fa.Study(whole.replace(drives=drives, samples=whole.samples.replace(count=2)))
    table = small.run(workers=1, chunk=2, progress=False)
    found = fa.study_statistics(table, [0.5, 1.0], nominal=small.nominal(progress=False))
    assert (found.failure_rate == 0.0).all()
    error = table.tip_error_rms.sel(reference="line")
    assert (error.sel(plant="changing") > error.sel(plant="constant")).all()
    for name in names[1:]:
        assert (error.sel(controller="LQG") < error.sel(controller=name)).all()
    ratio = found.tip_error_rms_ratio.sel(reference="line", plant="constant", quantile=1.0)
    # As stated: the controllers with the largest errors change least.
    assert ratio.sel(controller="joint PD, rigid") < 2.0 < ratio.sel(controller="joint PD") / 5.0
