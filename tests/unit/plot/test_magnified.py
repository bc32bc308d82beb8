"""Magnified bending: links stay connected, keep their lengths, and bend by the factor."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from plot_results import LINK, arm, result

import flexarm as fa
from closed_mechanisms import CLOSED
from flexarm.view.plot.animation.scene import SceneOptions, player_data, scene_of
from flexarm.view.plot.drawn_result import factor_of, shapes_of
from flexarm.view.plot.magnified import automatic, bending_of, nearest_round

BEAM = {"length": 1.0, "flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
FACTOR, STATIONS = 20.0, 17


def bent(links: int, size: float, theory: str = "linear", **fields):
    """Return an arm, three states with modal coordinates of a size, and their points."""
    chain = fa.Arm(links=[BEAM] * links, theory=theory, **fields)
    q = np.random.default_rng(1).normal(size=(3, chain.dof))
    modal = np.ones(chain.dof, dtype=bool)
    modal[chain.joint_index] = False
    q[:, modal] *= size / np.abs(q[:, modal]).max()
    return chain, q, shapes_of(chain, q, stations=STATIONS)


def directions(points):
    steps = np.diff(points, axis=2)
    return np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=2)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_links_of_a_chain_stay_connected_at_their_angles(theory):
    """A link begins at the drawn tip before it, and encloses the same angle with it."""
    chain, q, points = bent(10, 2e-3, theory)
    drawn = shapes_of(chain, q, FACTOR, STATIONS)
    np.testing.assert_allclose(drawn[:, 1:, 0], drawn[:, :-1, -1], atol=1e-14)
    lengths = [np.linalg.norm(np.diff(each, axis=2), axis=-1) for each in (points, drawn)]
    np.testing.assert_allclose(lengths[1], lengths[0], rtol=1e-12)
    angle = directions(points)
    corner, drawn_corner = (
        each[:, 1:, 0] - each[:, :-1, -1] for each in (angle, directions(drawn))
    )
    # Tangents are those of the lines between points: the rest of the bending at a joint, which a
    # line of a 16th of the link has, is magnified, too.
    wrapped = np.remainder(drawn_corner - corner + np.pi, 2.0 * np.pi) - np.pi
    own = np.abs(np.diff(angle, axis=2)).max()
    assert np.abs(wrapped).max() < 2.0 * (FACTOR - 1.0) * own
    turns = bending_of(chain, q, points).angle
    np.testing.assert_allclose(np.diff(directions(drawn), axis=2), FACTOR * np.diff(turns, axis=2))


def test_small_bending_is_that_of_larger_modal_coordinates():
    """Against the kinematics of an arm with modal coordinates that are larger by the factor."""
    chain, q, _ = bent(3, 1e-4)
    larger = q.copy()
    for piece in chain.assembly.pieces:
        larger[:, piece.modal] *= FACTOR
    drawn = shapes_of(chain, q, FACTOR, STATIONS)
    expected = shapes_of(chain, larger, stations=STATIONS)
    straight = shapes_of(chain, q, 0.0, STATIONS)
    size = np.abs(expected - straight).max()
    assert size > 1e-3
    # Second order in the angles of a few mrad.
    np.testing.assert_allclose(drawn, expected, atol=0.02 * size)
    rigid = fa.Arm(links=[{**BEAM, "flexible": False}] * 3)
    expected = shapes_of(rigid, q[:, chain.joint_index], stations=STATIONS)
    # Bent links of the linear theory are longer, by half the square of their slopes of 1e-3.
    np.testing.assert_allclose(straight, expected, atol=1e-5)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_loops_stay_closed(name):
    closed = CLOSED[name]()
    chain = fa.Arm(**closed.fields)
    q = np.array([chain.rest(closed.joints)])
    for piece in chain.assembly.pieces:
        q[:, piece.modal] = 0.01
    points = shapes_of(chain, q, stations=STATIONS)
    drawn = shapes_of(chain, q, FACTOR, STATIONS)
    ends = slice(None, None, STATIONS - 1)
    np.testing.assert_allclose(drawn[:, :, ends], points[:, :, ends], atol=1e-14)
    share = np.linspace(0.0, 1.0, STATIONS)[:, None]
    chord = points[:, :, :1] + share * (points[:, :, -1:] - points[:, :, :1])
    np.testing.assert_allclose(drawn - chord, FACTOR * (points - chord), atol=1e-12)


def test_joints_beside_links_are_carried_by_their_tips():
    """A hub and an offset turn with the section that carries them."""
    second = {**BEAM, "hub_radius": 0.2}
    chain = fa.Arm(links=[BEAM, second], joints=[fa.Joint(), fa.Joint(offset=(0.0, 0.3))])
    q = chain.rest([0.2, 0.5])[None]
    q[:, chain.assembly.pieces[0].modal] = 0.01
    drawn = shapes_of(chain, q, FACTOR, STATIONS)[0]
    points = shapes_of(chain, q, stations=STATIONS)[0]
    gaps = [each[1, 0] - each[0, -1] for each in (points, drawn)]
    assert np.linalg.norm(gaps[1]) == pytest.approx(np.linalg.norm(gaps[0]))
    turn = np.subtract(*[np.arctan2(*gap[::-1]) for gap in gaps[::-1]])
    slope = directions(drawn[None])[0, 0, -1] - directions(points[None])[0, 0, -1]
    assert np.exp(1j * turn) == pytest.approx(np.exp(1j * slope))


@pytest.mark.parametrize("reach", [1e-4, 1.0, 100.0])
def test_largest_deflection_is_drawn_at_a_twentieth_of_a_link(reach):
    for size in (1e-5, 3e-4, 2e-2):
        _, q, _ = bent(1, size)
        small = fa.Arm(links=[{**BEAM, "length": reach, "mass_per_length": 0.5 / reach}])
        q[:, 1:] *= reach * float(np.sqrt(0.5))  # deflections of the same fraction of the link
        points = shapes_of(small, q, stations=STATIONS)
        bending = bending_of(small, q, points)
        factor = automatic([(bending, points)])
        drawn = factor * bending.deflection(points)
        assert factor in {nearest_round(factor), 1.0}
        assert 0.05 / 1.6 < drawn < 0.05 * 1.6 or factor == 1.0


def test_deflection_is_measured_from_the_tangent_at_the_root():
    run = result()
    q = run.q.values
    found = bending_of(arm(), q, points := shapes_of(arm(), q, stations=101)).deflection(points)
    # Largest at a tip in this run; arcs of bent links are longer, by a few per mille here.
    expected = np.abs(run.link_tip_deflection.values).max() / LINK["length"]
    assert found == pytest.approx(expected, rel=0.02)


def test_arms_that_bend_far_or_not_are_drawn_to_scale():
    chain, q, _ = bent(1, 1e-2)
    far = q.copy()
    far[:, 1:] *= 30.0
    for states in (far, np.array([chain.rest([0.3])])):
        shapes = shapes_of(chain, states, stations=STATIONS)
        assert automatic([(bending_of(chain, states, shapes), shapes)]) == 1.0
    rigid = fa.Arm(links=[{**BEAM, "flexible": False}])
    run = fa.simulate(rigid, 0.01, rate=200.0)
    assert factor_of("auto", [(rigid, run, False)]) == 1.0
    assert factor_of(7.0, []) == 7.0


def test_angles_of_a_long_chain_add_up_to_half_a_radian_at_most():
    chain = fa.Arm(links=[{**BEAM, "modes": 1}] * 20)
    q = np.zeros((1, chain.dof))
    for piece in chain.assembly.pieces:
        q[:, piece.modal] = 1e-3
    points = shapes_of(chain, q, stations=STATIONS)
    bending = bending_of(chain, q, points)
    factor = automatic([(bending, points)])
    turned = factor * np.abs(bending.angle).max()
    assert 0.5 / 1.6 < turned < 0.5 * 1.6
    assert factor * bending.deflection(points) < 0.03


@cache
def _scene(kind: str, factor: float):
    if kind == "chain":
        chain = fa.Arm(links=[BEAM, {**BEAM, "hub_radius": 0.1}, BEAM], payload={"mass": 0.1})
    elif kind == "branches":
        slide = fa.Joint(kind="prismatic", axis=(1.0, 0.5))
        links = [BEAM, {**BEAM, "parent": 1}, {**BEAM, "parent": 1, "parent_station": 0.0}]
        chain = fa.Arm(links=links, joints=[fa.Joint(), slide, fa.Joint(offset=(0.1, 0.2))])
    else:
        closed = CLOSED[next(iter(CLOSED))]()
        chain = fa.Arm(**closed.fields)
        rest = chain.rest(closed.joints)
        run = fa.simulate(chain, 0.05, initial=rest, torque=_pull(chain), rate=100.0)
        return scene_of("", chain, run, run.time.values, SceneOptions(factor), [])
    run = fa.simulate(chain, 0.1, torque=_pull(chain), rate=100.0)
    return scene_of("", chain, run, run.time.values, SceneOptions(factor), [])


def _pull(chain):
    return lambda t: np.linspace(1.0, 0.5, chain.n_joints) * np.cos(20.0 * t)


@pytest.mark.parametrize("kind", ["chain", "branches", "closed"])
def test_the_player_draws_as_python_does(kind):
    """Links, joints, rails, arrows and the path, in Node from the data of the page."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js")
    scene = _scene(kind, FACTOR)
    folder = files("flexarm.view.plot.animation")
    script = "".join(
        folder.joinpath(f"{name}.js").read_text() for name in ("magnified", "histories")
    )
    data = json.dumps(
        player_data([scene], 30.0, 1.0),
        default=lambda values: np.where(np.isnan(values), None, values).tolist(),
    )
    script += """
const scene = JSON.parse(require("fs").readFileSync(0)).scenes[0];
magnify = scene.magnify;
const frame = scene.times.length - 1;
console.log(JSON.stringify({ ...posed(scene, frame), path: magnifiedPath(scene) }));"""
    done = subprocess.run([node, "-e", script], input=data, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    assert scene.true is not None
    # Points are rounded to 1e-4 of the view, angles to 1e-5 of the largest.
    near = 2e-4 * float(scene.view[1] - scene.view[0])
    expected = {"links": scene.links[-1], "joints": scene.joints[-1], "path": scene.path}
    expected |= {"rails": scene.marks.rails[-1], "arrows": scene.arrows[-1]}
    for name, values in expected.items():
        drawn = np.array(shown[name], dtype=float).reshape(values.shape)
        np.testing.assert_allclose(drawn, values, atol=near, err_msg=name)
    moved = np.abs(scene.links - scene.true.links).max()
    assert moved > 20.0 * near
