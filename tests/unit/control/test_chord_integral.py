"""Integral feedback of the angles between chords, by gauges: the tip rests where it should."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.control.design.nominal import chord_matrix


def arm_of(payload=0.1):
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.1, "elements": 1, "damping": 0.02}
    more = {"gauge": (0.02, 0.004), "payload": payload, "gravity": (0.0, -9.81)}
    return chain([0.8], [0.05], **rod, **more)


def test_chord_of_a_cantilever_turns_by_a_third_of_its_root_curvature():
    """w(L) / L = F L^2 / (3 E I) and the curvature at x is F (L - x) / (E I)."""
    (turned,) = chord_matrix(arm_of(payload=100.0)).ravel()
    strain = 0.004 * (0.8 - 0.02)  # times F / (E I), at the gauge
    # The lowest mode with a heavy payload is the shape under a force at the tip.
    assert abs(turned) == pytest.approx(0.8**2 / 3.0 / strain, rel=2e-3)


def test_tip_returns_to_its_goal_under_an_unknown_payload():
    arm, heavy = arm_of(), arm_of(0.2)
    sag = 0.1 * 9.81 * 0.8**3 / (3.0 * 20.0)  # of the difference of the payloads
    motion = fa.quasi_static_reference(arm, fa.joint_motion(arm, [0.0], [0.2], 0.5))
    goal = 0.8 * np.array([np.cos(0.2), np.sin(0.2)])
    missed = {}
    for integral in (True, "chord_angle"):
        law = fa.LQG(arm, [0.1], integral=integral, rigidity_uncertainty=0.3, recovery=1.0)
        assert fa.loop_margins(law, heavy, [[0.2]]).growth.item() < -0.5
        run = fa.simulate(
            arm,
            12.0,
            controller=law,
            reference=motion,
            plant=heavy,
            initial=motion.initial,
            rate=100.0,
        )
        missed[integral] = np.hypot(*(run.tip.values[-1] - goal))
    assert missed[True] == pytest.approx(sag * np.cos(0.2), rel=0.1)
    # The lowest mode differs from the shape under a force by a few percent, because the link has
    # mass, too.
    assert missed["chord_angle"] < 0.06 * sag
