"""The estimated error of bent states against the elastica, and the functions that warn of it."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.bending import BendingErrors, bending_warning, one_warning

STRIP = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 0.1}
FORCE, MOMENT = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def strip(theory="linear", count=1, **fields):
    return fa.Arm(links=[fa.Link(**STRIP, **fields)] * count, theory=theory)


def bent(arm, load):
    with one_warning(report=False):
        return fa.equilibrium(arm, [0.0] * arm.n_joints, tip_force=tuple(load)).q


def off(arm, load):
    """Return estimated and true error of the tip: against 32 segments, within 1e-5 of the
    elastica."""
    fine = strip("second_order", arm.n_links, elements=32, segments=32)
    q = bent(arm, load)
    true = np.hypot(*(arm.tip(q) - fine.tip(bent(fine, load)))[:2])
    states = arm.padded(np.stack([q, 0 * q]))[None]
    return BendingErrors(arm).of_links(states)[1][0], true


@pytest.mark.sampled("linear-moment-1", "second_order-force-1")
@pytest.mark.parametrize("segments", [1, 4])
@pytest.mark.parametrize("load", [FORCE, MOMENT], ids=["force", "moment"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_estimate_is_within_a_factor_of_three_of_the_elastica(theory, load, segments):
    """For both shapes of a load at the tip, up to more than half a radian."""
    for size in (0.3, 0.6, 1.0, 1.5):
        estimate, true = off(strip(theory, elements=4, segments=segments), size * load)
        assert true / 3.0 < estimate < 3.0 * true


@pytest.mark.parametrize(
    ("links", "elements", "segments", "load", "high"),
    [
        # A force to which the linear theory responds with a deflection of two lengths.
        pytest.param(1, 1, 1, 6.0 * FORCE, 3.0, id="absurd"),
        # A bent link displaces the next one; the slope under a moment is exact.
        pytest.param(2, 2, 2, 0.3 * FORCE, 3.5, id="two links, force"),
        pytest.param(2, 2, 2, 0.6 * MOMENT, 3.5, id="two links, moment"),
    ],
)
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_estimate_of_arms_with_several_links(theory, links, elements, segments, load, high):
    estimate, true = off(strip(theory, links, elements=elements, segments=segments), load)
    assert true / 3.0 < estimate < high * true


def analyses(arm):
    """Return the analyses that compute or take a bent state, by their names."""
    force, state = {"tip_force": (0.0, 1.0)}, bent(arm, FORCE)
    # Clamped, because a free joint feels no inertia in the second-order theory this far bent.
    clamped = fa.Arm(arm.spec.replace(joints=[fa.Joint(fixed=True)]))
    return {
        "equilibrium": lambda: fa.equilibrium(arm, [0.0], **force),
        "modes": lambda: fa.modes(arm, q=state, **force),
        "linearize": lambda: fa.linearize(arm, state, **force),
        "simulate": lambda: fa.simulate(clamped, 0.001, initial=state[1:], **force),
    }


@pytest.mark.parametrize("name", ["equilibrium", "modes", "linearize", "simulate"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_every_analysis_warns_once(theory, name):
    arm = strip(theory, elements=1)
    with pytest.warns(fa.LargeDeflectionWarning, match="misplaces the tip by about") as caught:
        analyses(arm)[name]()
    assert len(caught) == 1
    assert caught[0].filename == __file__


def test_equilibrium_passes_its_warning_to_later_analyses():
    arm = strip("second_order", elements=2)
    with one_warning(report=False):
        rest = fa.equilibrium(arm, [0.0], tip_force=(0.0, 1.0))
    for use in (fa.modes, fa.linearize):
        with pytest.warns(fa.LargeDeflectionWarning) as caught:
            use(arm, rest)
        assert len(caught) == 1


@pytest.mark.parametrize(
    "use",
    [lambda arm: fa.track_modes(arm, [[0.0], [0.1], [0.2]], sag=True, count=2), fa.linearize],
    ids=["modes along postures", "linearize"],
)
def test_analyses_that_find_sagging_equilibria_warn_once(use):
    arm = fa.Arm(links=[fa.Link(**STRIP, elements=2)], gravity=(0.0, -30.0))
    with pytest.warns(fa.LargeDeflectionWarning) as caught:
        use(arm)
    assert len(caught) == 1


@pytest.mark.parametrize(
    ("theory", "segments", "force"),
    [("linear", 1, 0.27), ("linear", 4, 1.2), ("second_order", 1, 0.5), ("second_order", 4, 3.0)],
)
def test_states_within_the_theory_give_no_warning(theory, segments, force):
    arm = strip(theory, elements=4, segments=segments)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rest = fa.equilibrium(arm, [0.0], tip_force=(0.0, force))
        fa.modes(arm, rest)
    assert bending_warning(arm, rest.q) == ""


def test_message_has_the_estimate_and_a_remedy():
    linear, second = (strip(theory, elements=4) for theory in ("linear", "second_order"))
    stated = bending_warning(linear, bent(linear, FORCE))
    assert "33% of its length of 1 m: the linear theory misplaces the tip by about 65 mm" in stated
    assert "(6.5% of the reach). Use theory='second_order' and segments=2 or 4 on" in stated
    stated = bending_warning(second, bent(second, FORCE))
    assert "the second-order theory misplaces the tip by about 20 mm" in stated
    assert "Use segments=2 or 4 on that link" in stated


@pytest.mark.parametrize(("elements", "fields"), [(3, {"segments": 3}), (5, {"elements": 8})])
def test_the_remedy_can_be_followed(elements, fields):
    """Segments divide the elements; the damping keeps its ratio in the first mode."""
    soft = strip("linear", elements=elements, damping=fa.ModalDamping(ratio=0.01))
    stated = bending_warning(soft, bent(soft, FORCE))
    text = " and ".join(f"{name}={value}" for name, value in fields.items())
    assert f"Use theory='second_order' and {text}" in stated
    coefficient = float(stated.split("stiffness_coefficient ")[1].split()[0])
    damping = fa.RayleighDamping(stiffness_coefficient=coefficient)
    cured = soft.spec.links[0].replace(**{"segments": 2, **fields}, damping=damping)
    held = [fa.Joint(fixed=True)]
    ratio = fa.modes(fa.Arm(links=[cured], joints=held)).damping_ratio[0]
    assert ratio == pytest.approx(0.01, rel=0.03)  # two digits of the coefficient


def test_rigid_arm_has_no_error():
    arm = strip(flexible=False)
    assert bending_warning(arm, arm.rest([0.3])) == ""
