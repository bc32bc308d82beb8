"""A run warns if its links bend beyond the validity of their theory."""

import inspect

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.bending import one_warning

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}


def arm(theory="linear", segments=1, **fields):
    links = [
        fa.Link(length=2.0, flexible=False, mass_per_length=1.0),
        fa.Link(length=1.0, elements=4, segments=segments, **ROD),
    ]
    return fa.Arm(links=links, theory=theory, **fields)


def loaded(of, deflection):
    """Return coordinates under a force P at the tip with the deflection P L^3 / 3 E I."""
    with one_warning(report=False):
        return fa.equilibrium(of, tip_force=(0.0, deflection * 3 * 20.0)).q


def bent(of, deflection, **options):
    """Return a short run from rest with the last link bent as by a force at its tip."""
    q = loaded(of, deflection)
    held = {1: fa.PrescribedAngle.hold(0.0), 2: fa.PrescribedAngle.hold(0.0)}
    return fa.simulate(of, 0.01, initial=q, prescribed=held, rate=1000, **options)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_warning_names_the_link_and_its_deflection(side):
    with pytest.warns(fa.LargeDeflectionWarning) as caught:
        result = bent(arm(), side * 0.11)
    assert len(caught) == 1
    assert str(caught[0].message) == result.attrs["warning"]
    assert result.attrs["warning"] == (
        "link 2 deflects by up to 0.11 m, 11% of its length of 1 m: the linear theory misplaces "
        "the tip by about 7.2 mm (0.2% of the reach). Use theory='second_order' and segments=2 or "
        "4 on that link; see docs/how-to/large-deflection.md."
    )


def test_warning_has_the_line_of_the_call():
    with pytest.warns(fa.LargeDeflectionWarning) as caught:
        bent(arm(), 0.11)
    assert caught[0].filename == inspect.getfile(arm)


def test_warning_depends_on_the_largest_deflection_of_the_run():
    """The link starts bent to the other side and is straight at the end."""
    of = arm()
    period = 1.0 / fa.modes(of).frequency_hz[0]
    q = loaded(of, 0.11)
    held = {1: fa.PrescribedAngle.hold(0.0), 2: fa.PrescribedAngle.hold(0.0)}
    with pytest.warns(fa.LargeDeflectionWarning):
        result = fa.simulate(of, 0.25 * period, initial=q, prescribed=held, rate=20 / period)
    assert abs(result.link_tip_deflection.values[-1, 1]) < 0.03


@pytest.mark.parametrize(
    ("of", "deflection"),
    [
        (arm(), 0.09),
        (arm("second_order"), 0.11),
        (arm(segments=4), 0.3),
        (fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)]), 0.0),
    ],
    ids=["less", "second order", "segments", "rigid"],
)
def test_small_deflections_give_no_warning(of, deflection):
    if of.n_joints == 1:
        result = fa.simulate(of, 0.01)
    else:
        result = bent(of, deflection)
        assert abs(result.link_tip_deflection.values[0, 1]) > 0.9 * deflection
    assert result.attrs["warning"] == ""


def test_segments_are_checked_separately():
    """Four segments of a quarter: 0.9 of the length, and the first of them bends most."""
    with pytest.warns(fa.LargeDeflectionWarning, match="^a segment of link 2 deflects") as caught:
        bent(arm(segments=4), 0.9)
    assert "of its length of 0.25 m" in str(caught[0].message)
    assert "or more segments on that link" in str(caught[0].message)


def test_failed_run_gives_no_bending_warning():
    q = loaded(arm(), 1 / 3)
    with pytest.raises(fa.SimulationError) as caught:  # warnings are errors in this suite
        fa.simulate(arm(), 1.0, initial=q, integrator="rk4", step=0.01)
    assert caught.value.result.attrs["warning"].startswith("link 2 deflects")
    assert np.all(np.isfinite(caught.value.result.tip))


def test_scenario_run_gives_the_warning(tmp_path):
    text = (
        "flexarm: 1\n"
        "arm: {links: [{length: 1.0, flexural_rigidity: 20.0, mass_per_length: 0.5}]}\n"
        "loads: [{link: 1, force: [0, 7]}]\n"
        "initial: {equilibrium: true, balance: true}\n"
        "run: {duration: 0.01}\n"
    )
    (tmp_path / "run.yaml").write_text(text)
    with pytest.warns(fa.LargeDeflectionWarning):
        fa.run_scenario(tmp_path / "run.yaml")
