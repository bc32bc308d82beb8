"""Joints of links with a hub radius are drawn where they are, not at the roots of the beams."""

import numpy as np

import flexarm as fa


def test_joints_are_at_the_tips_before_them():
    beam = {"mass_per_length": 1.0, "flexible": False}
    arm = fa.Arm(links=[fa.Link(length=0.5, hub_radius=radius, **beam) for radius in (0.2, 0.1)])
    result = fa.simulate(arm, 0.01, rate=200.0)
    panel = fa.plot.postures(result)
    dots = [line for line in panel.get_lines() if line.get_marker() == "o"]
    places = np.concatenate([np.stack(line.get_data(), axis=1) for line in dots])
    assert {round(float(x), 6) for x in places[:, 0]} == {0.0, 0.7}
