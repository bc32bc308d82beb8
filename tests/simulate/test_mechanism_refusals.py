"""Functions that do not support branches, sliding joints or bases that move name these features."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=2)
FORK = fa.Arm(links=[LINK, LINK, LINK.replace(parent=1)])
SLIDE = fa.Arm(links=[LINK, LINK], joints=[fa.Joint(kind="prismatic"), fa.Joint()])
CART = fa.Arm(base=fa.Base(mass=1.0, free=("x",)), links=[LINK])
ARMS = {"branches": FORK, "sliding joints": SLIDE, "a free base": CART}


def _motion(arm):
    return fa.joint_motion(arm, np.zeros(arm.n_joints), np.full(arm.n_joints, 0.2), 1.0)


GAUGES = [fa.Instrument("joint_angle")]
REFUSED = {
    "tip_inversion": lambda arm: fa.tip_inversion(arm, _motion(arm)),
    "quasi_static_reference": lambda arm: fa.quasi_static_reference(arm, _motion(arm)),
    "Impedance": lambda arm: fa.Impedance(arm, 100.0, 10.0),
    "HybridForce": lambda arm: fa.HybridForce(arm),
    "WaveBasedControl": lambda arm: fa.WaveBasedControl(arm, fa.JointPD(1.0, 1.0)),
    "LoopShaping": lambda arm: fa.LoopShaping(arm),
    "design": lambda arm: fa.design(arm, "hold"),
    "export_mjcf": lambda arm: fa.export_mjcf(arm, "arm.xml"),
    "export_urdf": lambda arm: fa.export_urdf(arm, "arm.urdf"),
    "export_exudyn": lambda arm: fa.export_exudyn(arm, "arm.py"),
    "modes": lambda arm: fa.modes(arm, spin=1.0),
    "campbell": lambda arm: fa.campbell(arm, [0.0, 1.0]),
}
OF_BASES_ALONE = {
    "DisturbanceObserver": lambda arm: fa.DisturbanceObserver(arm, fa.JointPD(1.0, 1.0)),
    "inverse_kinematics": lambda arm: fa.inverse_kinematics(arm, (1.0, 0.5), posture=[0.5]),
    "line_motion": lambda arm: fa.line_motion(arm, (1.0, 0.5), (1.0, 0.7), 1.0, posture=[0.5]),
}
OF_BASES = {
    "optimal_motion": lambda arm: fa.optimal_motion(
        arm, np.zeros(arm.n_joints), np.full(arm.n_joints, 0.2), duration=1.0
    ),
    "iterative_learning": lambda arm: fa.iterative_learning(
        arm, _motion(arm), fa.JointPD(1.0, 1.0)
    ),
    "simulate_separated": lambda arm: fa.simulate_separated(arm, _motion(arm)),
    "NonlinearMPC": lambda arm: fa.NonlinearMPC(arm, torque_limit=1.0),
    "Composite": lambda arm: fa.Composite(arm),
    "SlidingMode": lambda arm: fa.SlidingMode(arm, 5.0, 1.0),
    "Adaptive": lambda arm: fa.Adaptive(arm, 5.0, 1.0, 1.0),
}


#: Closed at zero: the tip of the second link on a line of the ground.
LOOP = fa.Arm(links=[LINK, LINK], closures=[fa.Closure(link=2, kind="line")])
START = LOOP.rest([0.0, 0.0])
OF_CLOSURES = {
    "ExtendedKalmanFilter": lambda arm: fa.ExtendedKalmanFilter(arm, GAUGES),
    "MovingHorizonEstimator": lambda arm: fa.MovingHorizonEstimator(arm, GAUGES),
    "linearize_along": lambda arm: fa.linearize_along(arm, _motion(arm)),
    "converged": lambda arm: fa.converged(arm, 0.1),
    "export_c": lambda arm: fa.export_c(arm, "code"),
    "export_mat": lambda arm: fa.export_mat(arm, "arm.mat"),
}


@pytest.mark.parametrize("name", {**REFUSED, **OF_BASES, **OF_CLOSURES})
def test_functions_without_closures_name_them(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(fa.InputError, match=f"^{name}: .* is not supported for arms with closures"):
        {**REFUSED, **OF_BASES, **OF_CLOSURES}[name](LOOP)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("feature", ARMS)
@pytest.mark.parametrize("name", REFUSED)
def test_functions_for_serial_arms_name_the_feature(name, feature, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = f"^{name}: .* is not supported for arms with {feature}"
    with pytest.raises(fa.InputError, match=words):
        REFUSED[name](ARMS[feature])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", {**OF_BASES, **OF_BASES_ALONE})
def test_functions_for_fixed_bases_name_the_base(name):
    with pytest.raises(fa.InputError, match=f"^{name}: .* is not supported for arms with a free"):
        {**OF_BASES, **OF_BASES_ALONE}[name](CART)


@pytest.mark.parametrize("arm", [FORK, SLIDE], ids=["branches", "sliding joints"])
def test_the_torque_of_the_rigid_model_is_its_inverse_dynamics(arm):
    motion = _motion(arm)
    rigid = arm.rigid()
    state = motion.state(0.3)
    expected = rigid.inverse_dynamics(*state)
    np.testing.assert_allclose(fa.rigid_torque(arm, motion)(0.3), expected, rtol=1e-12)


def test_rest_names_coordinates_of_the_base_that_are_not_free():
    np.testing.assert_array_equal(CART.rest([0.3], base=[2.0, 0.0, 0.0])[:2], [2.0, 0.3])
    with pytest.raises(fa.InputError, match="have y = 0, because the base is not free"):
        CART.rest([0.3], base=[0.0, 1.0, 0.0])
