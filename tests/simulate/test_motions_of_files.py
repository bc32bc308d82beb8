"""Shaped, smoothed and pressing motions of scenario files equal those of Python."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.scenario.references import _over_time
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import load_scenario, locate_scenario
from flexarm.model.scenarios.motions import ForceTable

ARM = """\
flexarm: 1
arm:
  links:
    - {length: 1.4142, flexural_rigidity: 105.0, mass_per_length: 0.61732, elements: 1}
    - {length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.61732, elements: 1}
  joints: [{hub_inertia: 0.1}, {mass: 0.5, hub_inertia: 0.02, housing_inertia: 0.02}]
  payload: {mass: 0.1}
"""
TIMES = np.linspace(0.0, 2.0, 23)


@pytest.fixture
def made(tmp_path):
    def made(text):
        path = tmp_path / "run.yaml"
        path.write_text(ARM + text)
        return prepare(load_scenario(path))

    return made


def assert_same(one, other):
    for name in ("joint_angle", "joint_rate", "joint_acceleration"):
        np.testing.assert_array_equal(getattr(one, name)(TIMES), getattr(other, name)(TIMES))


@pytest.mark.sampled("{method: zv, frequency_hz: [1.5, 6], damping_ratio: [0, 0.02]}-None")
@pytest.mark.parametrize(
    ("keys", "options"),
    [
        ("{}", {}),
        ("{method: ei, tolerance: 0.1, modes: [2], joints: free}", None),
        ("{joints: [[40, 20], locked]}", None),
        ("{method: zv, frequency_hz: [1.5, 6], damping_ratio: [0, 0.02]}", None),
    ],
)
def test_shaped_and_smoothed_motions(made, keys, options):
    if options is None:
        options = {
            "{joints: [[40": {"joints": [(40.0, 20.0), "locked"]},
            "{method: ei": {"method": "ei", "tolerance": 0.1, "modes": [2], "joints": "free"},
            "{method: zv": {
                "method": "zv",
                "frequency_hz": [1.5, 6.0],
                "damping_ratio": [0.0, 0.02],
            },
        }[keys.partition(",")[0]]
    text = "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5, SHAPED}\n"
    text += "run: {duration: 0.1}\n"
    found = made(text.replace("SHAPED", f"shaping: {keys}"))
    plain = fa.joint_motion(found.arm, [0.2, -0.4], [0.5, 0.0], 0.5)
    assert_same(found.motion, fa.shaped(plain, found.arm, **options))
    assert found.motion.end_time > 0.55
    # The average over time is applied after shaping.
    found = made(text.replace("SHAPED", f"shaping: {keys}, smoothing: {{duration: 0.2}}"))
    assert_same(found.motion, fa.smoothed(fa.shaped(plain, found.arm, **options), 0.2))


def test_force_over_time_passes_its_values_at_rest():
    force = _over_time(ForceTable(times=[0.0, 1.0, 3.0], values=[2.0, 6.0, 0.0]))
    # The quintic from rest to rest is halfway at half of the time.
    reported = {-1.0: 2.0, 0.0: 2.0, 0.5: 4.0, 1.0: 6.0, 2.0: 3.0, 3.0: 0.0, 9.0: 0.0}
    assert [force(t) for t in reported] == pytest.approx(list(reported.values()), abs=1e-12)
    h = 1e-4
    for t in (0.0, 1.0, 3.0):
        # Slope and curvature vanish with the third and second power of the distance from a rest.
        assert abs(force(t + h) - force(t - h)) / (2 * h) < 1e-6
        assert abs(force(t + h) - 2 * force(t) + force(t - h)) / h**2 < 0.05
    assert _over_time(ForceTable(times=[1.0], values=[3.0]))(0.0) == 3.0


PRESSED = """\
motion:
  kind: pressed
  path: {kind: line, start: [1.5, 0.5], end: [1.5, 0.7], duration: 0.8, start_time: 0.2}
  force: {times: [0.0, 0.6], values: [1.0, 2.0]}
  friction: 0.2
drive: {kind: hybrid_force, force_integral: 8.0}
contacts:
  - surface: {kind: wall, point: [1.5, 0.0], normal: [-2, 0]}
    stiffness: 5000.0
    damping: 0.5
    friction: 0.2
run: {duration: 1.0, rate: 200}
"""


def by_hand(arm, friction=0.2, normal=(-1.0, 0.0)):
    path = fa.line_motion(arm, (1.5, 0.5), (1.5, 0.7), 0.8, start_time=0.2)
    force = _over_time(ForceTable(times=[0.0, 0.6], values=[1.0, 2.0]))
    return fa.pressed_motion(arm, path, force, normal, duration=1.0, friction=friction)


@pytest.mark.thorough
def test_pressing_motion_equals_that_of_python(made):
    found = made(PRESSED)
    arm, reference = found.arm, by_hand(found.arm)
    assert_same(found.motion, reference)
    wall = fa.Contact(fa.Wall((1.5, 0.0), (-1.0, 0.0)), 5000.0, damping=0.5, friction=0.2)
    wanted = fa.simulate(
        arm,
        1.0,
        controller=fa.HybridForce(arm, force_integral=8.0),
        reference=reference,
        contacts=[wall],
        initial=reference.initial,
        rate=200.0,
    )
    result = found.run()
    np.testing.assert_array_equal(result.q, wanted.q)


@pytest.mark.thorough
def test_normal_may_be_given(made):
    turned = PRESSED.replace("  friction: 0.2\ndrive", "  normal: [-3, 0.3]\ndrive", 1)
    reference = by_hand(made(PRESSED).arm, friction=0.0, normal=(-3.0, 0.3))
    assert_same(made(turned).motion, reference)


@pytest.mark.thorough
def test_normal_of_a_circle_follows_the_path(made):
    centre = (2.1, 0.6)
    text = PRESSED.replace(
        "{kind: wall, point: [1.5, 0.0], normal: [-2, 0]}",
        "{kind: round, center: [2.1, 0.6], radius: 0.6}",
    )
    found = made(text).motion
    for t in (0.0, 0.5, 1.0):
        away = np.array(found.tip(t)) - centre
        np.testing.assert_allclose(found.normal(t), away / np.hypot(*away), rtol=0, atol=1e-12)
    inside = made(text.replace("radius: 0.6", "radius: 0.6, inside: true")).motion
    np.testing.assert_allclose(inside.normal(0.5), -found.normal(0.5), rtol=0, atol=1e-12)


def test_pressing_motion_starts_at_given_angles(made):
    found = made(PRESSED + "initial: {joint_angle: [1.3, -1.4]}\n")
    np.testing.assert_array_equal(found.options["initial"], found.arm.rest([1.3, -1.4]))


#: Text of the file after the arm; the place and the key in the error.
IMPOSSIBLE = {
    "a mode that does not exist": (
        """motion:
  kind: joint
  start: [0.2, -0.4]
  end: [0.5, 0.0]
  duration: 0.5
  shaping:
    modes: [99]
run: {duration: 0.1}
""",
        r"run\.yaml:14: motion\.shaping\.modes must",
    ),
    "a path out of reach": (
        PRESSED.replace("end: [1.5, 0.7]", "end: [1.5, 2.4]"),
        r"run\.yaml:10: motion\.path\.end must",
    ),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_an_impossible_motion_is_reported_at_its_key(case, tmp_path):
    text, words = IMPOSSIBLE[case]
    path = tmp_path / "run.yaml"
    path.write_text(ARM + text)
    with pytest.raises(fa.InputError, match=words):
        fa.run_scenario(path)


#: Settings that a scenario lacks for its drive; the place; the message.
LACKING = {
    "contacts": (
        PRESSED.replace(PRESSED[PRESSED.index("contacts") : PRESSED.index("run:")], "").replace(
            "friction: 0.2", "normal: [-1, 0]"
        ),
        "contacts are missing: hybrid_force measures contact_force",
    ),
    "an instrument of the force": (
        PRESSED + "hardware: {instruments: [{signal: joint_angle, rate_cutoff: 80}]}\n",
        (
            "hardware.instruments has no instrument for contact_force, which hybrid_force "
            "reads; it measures joint_angle, joint_rate"
        ),
    ),
    "rates": (
        PRESSED + "hardware: {instruments: [{signal: joint_angle}, {signal: contact_force}]}\n",
        "An instrument of joint_angle with a rate_cutoff also measures it.",
    ),
    "gauges": (
        (
            "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
            "drive: {kind: strain_feedback, proportional: 1, derivative: 1, strain: 1}\n"
            "run: {duration: 0.1}\n"
        ),
        "arm has no gauges, but strain_feedback reads strain",
    ),
    "gauges of LQG": (
        (
            "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
            "drive: {kind: lqg, measured: {joint_angle: 0.0001, tip: 0.001}}\n"
            "run: {duration: 0.1}\n"
        ),
        "hardware.instruments has no instrument for tip, which lqg reads",
    ),
    "instruments of the filter": (
        (
            "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
            "drive: {kind: estimator, inner: {kind: joint_pd, proportional: 1, derivative: 1}}\n"
            "run: {duration: 0.1}\n"
        ),
        "drive.estimator.instruments are required, because the hardware has none",
    ),
    "a known parameter": (
        (
            "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
            "drive: {kind: sliding_mode, bandwidth: 1, boundary_layer: 1, uncertainty: "
            "{payload.mas: 1}}\n"
            "run: {duration: 0.1}\n"
        ),
        "Did you mean 'payload.mass'?",
    ),
    "a gain of the inner controller": (
        (
            "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
            "drive: {kind: disturbance_observer, inner: {kind: adaptive, bandwidth: 1, damping: 1, "
            "adaptation: 1, strain_gain: [2, 0]}}\n"
            "run: {duration: 0.1}\n"
        ),
        "drive.inner.strain_gain must be 0 at joint 1 (its link has no gauge",
    ),
}


@pytest.mark.thorough_cases("an instrument of the force", "contacts")
@pytest.mark.parametrize("what", LACKING)
def test_missing_requirements_of_a_drive_are_reported_before_the_run(what, tmp_path):
    text, words = LACKING[what]
    path = tmp_path / "run.yaml"
    path.write_text(ARM + text)
    with pytest.raises(fa.InputError) as caught:
        fa.run_scenario(path)
    (problem,) = caught.value.problems
    assert words in str(problem)
    assert problem.where.startswith(f"{path}:")


def test_filter_reads_all_instruments_by_default(made):
    text = (
        "motion: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.5}\n"
        "hardware: {instruments: [{signal: joint_angle, noise: 0.0001}]}\n"
        "drive: {kind: estimator, inner: {kind: joint_pd, proportional: 8, derivative: 1}}\n"
        "run: {duration: 0.05}\n"
    )
    found = made(text)
    (instrument,) = found.options["controller"].estimator.instruments
    assert (instrument.signal, instrument.noise) == ("joint_angle", 1e-4)
    found.run()


POINTS = [(2.0, 0.5), (1.6, 1.2), (0.4, 1.6)]


@pytest.mark.parametrize(
    ("keys", "function", "arguments"),
    [
        ("kind: via_points, points: POINTS", fa.via_point_motion, {"points": POINTS}),
        (
            "kind: via_points, points: POINTS, blend: 0.1, elbow: down, start_time: 0.2",
            fa.via_point_motion,
            {"points": POINTS, "blend": 0.1, "elbow": "down", "start_time": 0.2},
        ),
        (
            "kind: spline, points: POINTS, profile: trapezoidal",
            fa.spline_motion,
            {"points": POINTS, "profile": "trapezoidal"},
        ),
        (
            "kind: circle, center: [1.2, 0.6], start: [1.6, 0.6], angle: -5",
            fa.circle_motion,
            {"center": (1.2, 0.6), "start": (1.6, 0.6), "angle": -5.0},
        ),
    ],
)
def test_paths_of_the_tip(made, keys, function, arguments):
    points = [list(point) for point in POINTS]
    keys = keys.replace("POINTS", str(points))
    found = made(f"motion: {{{keys}, duration: 1.5}}\nrun: {{duration: 0.1}}\n")
    assert_same(found.motion, function(found.arm, duration=1.5, **arguments))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (
            "{kind: spline,\n  points: [[2, 0.5],\n    [9, 0]],\n  duration: 1}",
            r"run\.yaml:10: motion\.points\[1\] must lie within the reach of 2.4142 m",
        ),
        ("{kind: spline, points: [[2, 0.5]], duration: 1}", "motion.points must have at least two"),
        (
            "{kind: circle, center: [0, 1], start: [1, 1], angle: 0, duration: 1}",
            "motion.angle must differ from 0",
        ),
        (
            "{kind: circle, center: [0, 1], start: [1, 1], angle: 5, duration: 1}",
            r"run\.yaml:8: motion\.arc must stay more than 0.4142",
        ),
        ("{kind: polygon, points: [[2, 0.5], [1, 1]], duration: 1}", "motion.kind must be one of"),
    ],
)
def test_wrong_paths_are_rejected_at_their_key(tmp_path, motion, message):
    path = tmp_path / "run.yaml"
    path.write_text(f"{ARM}motion: {motion}\nrun: {{duration: 1}}\n")
    with pytest.raises(fa.InputError, match=message):
        prepare(*locate_scenario(path))
