"""Files of mechanisms, their initial states, plots and symbolic models."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

import flexarm as fa

TEXT = """
flexarm: 1
arm:
  base: {mass: 5 kg, inertia: 0.8 kg m^2, free: [x, y, angle]}
  links:
    - &beam {length: 0.8 m, flexural_rigidity: 20 N m^2, mass_per_length: 0.5 kg/m, elements: 2}
    - {<<: *beam, parent: 0}
  joints:
    - {offset: [0.4 m, 0 m]}
    - {offset: [-0.4 m, 0 m], mounting_angle: 180 deg}
initial:
  joint_angle: [0.1 rad, 0.2 rad]
  base_position: [1 m, 2 m, 10 deg]
  base_velocity: [0.1 m/s, 0 m/s, 20 deg/s]
run: {duration: 0.1 s, rate: 50 Hz}
"""


def _flyer():
    link = {"length": 0.8, "flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    return fa.Arm(
        base=fa.Base(mass=5.0, inertia=0.8, free=("x", "y", "angle")),
        links=[fa.Link(**link), fa.Link(**link, parent=0)],
        joints=[fa.Joint(offset=(0.4, 0.0)), fa.Joint(offset=(-0.4, 0.0), mounting_angle=np.pi)],
    )


def test_a_file_starts_a_base_like_python(tmp_path):
    path = tmp_path / "flyer.yaml"
    path.write_text(TEXT)
    result = fa.run_scenario(path)
    arm = _flyer()
    expected = fa.simulate(
        arm,
        0.1,
        initial=arm.rest([0.1, 0.2], base=[1.0, 2.0, np.deg2rad(10.0)]),
        initial_rate=arm.rest([0.0, 0.0], base=[0.1, 0.0, np.deg2rad(20.0)]),
        rate=50.0,
    )
    for name in ("q", "qd", "tip", "base_position"):
        np.testing.assert_array_equal(result[name].values, expected[name].values)
    saved = fa.write_result(result, tmp_path / "flyer.nc")
    assert fa.read_result(tmp_path / "flyer.nc").base_position.dims == ("time", "direction"), saved


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("free: [x, y, angle]", "free: [x, angle]", "must have y = 0"),
        ("[x, y, angle]", "[x, y]", "must have angle = 0"),
        ("run:", "initial_:\nrun:", "initial_"),
    ],
)
def test_a_file_gives_only_free_coordinates_of_the_base(old, new, words, tmp_path):
    path = tmp_path / "flyer.yaml"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(fa.ModelError, match=words):
        fa.run_scenario(path)


def test_the_start_of_a_base_is_not_that_of_an_equilibrium(tmp_path):
    path = tmp_path / "flyer.yaml"
    path.write_text(TEXT.replace("initial:", "initial:\n  equilibrium: true"))
    with pytest.raises(fa.ModelError, match="cannot be combined with equilibrium"):
        fa.run_scenario(path)


def test_plots_do_not_connect_branches():
    run = fa.simulate(_flyer(), 0.1, rate=50.0, stations=3)
    axes = fa.plot.postures(run, count=2, rigid=True)
    drawn = [line.get_xydata() for line in axes.get_lines()]
    assert sum(np.isnan(points).any() for points in drawn) == 4
    fa.plot.bending_moment(run)
    fa.plot.history(run, ["base_position", "base_velocity[angle]"])
    plt.close("all")


def test_an_animation_draws_joints_where_they_are():
    from flexarm.view.plot.animation.scene import SceneOptions, scene_of

    arm = _flyer()
    run = fa.simulate(arm, 0.1, rate=50.0)
    scene = scene_of("", arm, run, run.time.values, SceneOptions(), [])
    q = run.q.values[-1]
    np.testing.assert_allclose(scene.joints[-1], arm.shape(q, 2)[:, 0], atol=1e-12)


def test_symbolic_models_of_mechanisms_are_the_kernels():
    arm = _flyer()
    rng = np.random.default_rng(0)
    q, qd = rng.normal(size=(2, arm.dof)) * 0.1
    torque, none = rng.normal(size=2), np.zeros(0)
    model = fa.to_casadi(arm)
    symbolic = np.array(model.forward_dynamics(q, qd, torque, np.zeros(3), none)).ravel()
    expected = arm.forward_dynamics(q, qd, torque)
    np.testing.assert_allclose(symbolic, expected, rtol=1e-10, atol=1e-10 * abs(expected).max())
