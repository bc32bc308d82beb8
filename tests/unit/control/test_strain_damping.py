"""Positive position feedback and integral resonant control against published closed forms.

The sampled law is read from ``update`` around an inner controller that returns its reference, and
is closed by python-control around the modal signal of (C.17).
"""

import control
import numpy as np
import pytest
from strain_loops import (
    TICK,
    base_driven,
    closed_poles,
    continuous,
    echo,
    modal_law,
    one_link,
    strain_rows,
    two_links,
)

import flexarm as fa
from flexarm.control.analysis.linear_controller import linear_controller
from flexarm.control.analysis.margins import loop_at
from flexarm.control.hardware.measurement import Measurement

LAWS = [fa.PositivePositionFeedback, fa.IntegralResonantControl]
every = pytest.mark.parametrize("law", LAWS)


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.7])
def test_positive_position_gives_two_equal_pairs_of_poles(ratio):
    sampled, omega = modal_law(fa.PositivePositionFeedback, damping_ratio=ratio)
    found = closed_poles(continuous(sampled), base_driven(omega))
    wanted = np.poly([omega * (-ratio + 1j * np.sqrt(1 - ratio**2) * s) for s in (1, -1)])
    # The law is read by differences of strains, whose rounding is 1e-8 of it.
    np.testing.assert_allclose(np.poly(found).real, np.polymul(wanted, wanted).real, rtol=1e-6)


def test_filter_has_the_stability_condition_of_fanson_and_caughey():
    """Fanson and Caughey (1990): a structure driven by a force is stable for gains below 1."""
    sampled, omega = modal_law(fa.PositivePositionFeedback, damping_ratio=0.15)
    law = continuous(sampled)
    structure = control.tf([omega**2], [1.0, 0.0, omega**2])
    filtered = law / float(np.real(law(0.0)))  # the filter with unit gain for constant strains
    for gain, stable in ((0.05, True), (0.5, True), (0.99, True), (1.01, False), (1.5, False)):
        poles = closed_poles(gain * filtered, structure)
        assert (poles.real.max() < 0.0) == stable, gain


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.7])
def test_integral_resonant_has_the_largest_damping_of_namavar(ratio):
    """Namavar et al. (2014): (pole / zero - 1) / 2, at the gain pole sqrt(pole / zero)."""
    sampled, omega = modal_law(fa.IntegralResonantControl, damping_ratio=ratio)
    law = continuous(sampled)
    plant = base_driven(omega)
    found = closed_poles(law, plant)
    radius = omega / np.sqrt(1.0 + 2.0 * ratio)
    np.testing.assert_allclose(abs(found), radius, rtol=1e-6)
    pair = found[found.imag > 0.0]
    np.testing.assert_allclose(-pair.real / abs(pair), [ratio], rtol=1e-6)
    # Another integral gain k in u = -k (y + f u) / s gives less damping.
    k, leak = -float(law.B[0, 0] * law.C[0, 0]), -float(law.A[0, 0])
    for factor in (0.8, 0.95, 1.05, 1.2):
        other = control.tf([-factor * k], [1.0, factor * leak])
        poles = closed_poles(other, plant)
        pair = poles[poles.imag > 1e-6 * omega]
        assert -pair.real[0] / abs(pair[0]) < ratio


@every
@pytest.mark.parametrize("modes", [1, 3])
def test_stiff_joint_gives_the_designed_damping(law, modes):
    """A joint loop of 240 Hz around a mode of 3.6 Hz, with higher modes that are not designed."""
    arm, w = one_link(modes), 1500.0
    inner = fa.JointPD(5.0 * w**2, 7.0 * w, sample_time=TICK)
    poles = loop_at(law(arm, inner, damping_ratio=0.3), arm, np.zeros(1)).poles()
    poles = poles[poles.imag > 0.0]
    lowest = poles[np.argsort(abs(poles))][: 1 if law is fa.IntegralResonantControl else 2]
    # Higher modes yield quasi-statically to the motion of the joint and change the damping a bit.
    ratio = np.mean(-lowest.real / abs(lowest))
    assert ratio == pytest.approx(0.3, abs=0.002 if modes == 1 else 0.006)
    # The joint yields to higher modes, whose strain then reaches the filters: 1.5e-6 of the
    # frequency of an undamped mode, and a thousandth of the damping of any material.
    assert (poles.real / abs(poles)).max() < 5e-6


@every
def test_run_is_the_response_of_the_closed_form(law):
    """A bent link is released: s / (s^2 + w^2) in the loop of the law, by python-control."""
    sampled, omega = modal_law(law, damping_ratio=0.2)
    loop = continuous(sampled) * base_driven(omega)
    released = control.tf([1.0, 0.0], [1.0, 0.0, omega**2]) * control.feedback(1.0, loop, sign=1)
    arm = one_link()
    inner = fa.JointPD(5.0 * 400.0**2, 10.0 * 0.7 * 400.0)
    start = arm.rest([0.0])
    start[1] = 1e-6 / strain_rows(arm)[0, 1]
    run = fa.simulate(
        arm, 1.0, controller=law(arm, inner, damping_ratio=0.2), initial=start, rate=500.0
    )
    wanted = control.impulse_response(released, run.time.values).outputs
    found = run.strain.values[:, 0] / run.strain.values[0, 0]
    # Within the delay of the joint loop, 2 * 0.7 / (400 rad/s), of a vibration of 22.6 rad/s.
    np.testing.assert_allclose(found, wanted, atol=0.08)
    assert abs(wanted).max() == pytest.approx(1.0, abs=1e-6)


@every
def test_links_in_equilibrium_request_no_motion(law):
    """Under gravity the torque at rest is that of the inner controller."""
    arm = one_link(gravity=(0.0, -0.5))
    rest = fa.equilibrium(arm, [0.4])
    reading = Measurement(
        joint_angle=np.array([0.4]), joint_rate=np.zeros(1), strain=strain_rows(arm) @ rest.q
    )
    # Rounding of strains, which the law converts to angles.
    controller = law(arm, echo(), posture=[0.4])
    for k in range(20):
        torque = controller.update(k * TICK, reading, None)
    np.testing.assert_allclose(torque, [0.4], atol=1e-12)
    # At other angles, too: the stiffness under gravity is that of the design posture.
    controller = law(arm, echo())
    for k in range(20):
        torque = controller.update(k * TICK, reading, None)
    np.testing.assert_allclose(torque, [0.4], atol=1e-3 * np.ptp(rest.q))


@pytest.mark.sampled("PositivePositionFeedback")
@every
def test_static_bending_along_the_reference_is_not_fed_back(law):
    """A slow motion is followed as by the inner controller."""
    arm = one_link()
    motion = fa.joint_motion(arm, [0.0], [1.0], 4.0)
    inner = fa.JointPD(5.0 * 200.0**2, 10.0 * 0.7 * 200.0, feedforward=fa.rigid_torque(arm, motion))
    errors, strains = [], []
    for controller in (inner, law(arm, inner)):
        run = fa.simulate(arm, 4.0, controller=controller, reference=motion, rate=100.0)
        errors.append(abs(run.joint_angle.values - motion.joint_angle(run.time.values)).max())
        strains.append(abs(run.strain.values).max())
    # Strains along the motion, as angles of the joint by the law, would be a hundred times larger.
    assert errors[1] < errors[0] + 2e-4


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["quasi_static", "inversion"])
@every
def test_bending_of_a_flexible_reference_is_not_fed_back(law, kind):
    """The tip follows a fast motion as with the inner controller, and a soft arm swings less."""
    arm = two_links()
    line = fa.line_motion(arm, (1.8, 1.0), (1.0, 1.8), 1.2, start_time=0.4)
    if kind == "quasi_static":
        followed = fa.quasi_static_reference(arm, line)
        torque = followed.torque
    else:
        inverse = fa.tip_inversion(arm, line)
        followed, torque = inverse.reference, inverse.torque
    inner = fa.JointPD([200.0, 50.0], [40.0, 6.0], feedforward=torque)
    soft = fa.varied(arm, flexural_rigidity_factor=0.7)
    peaks, swings = [], []
    for controller in (inner, law(arm, inner, 0.3, posture=line.joint_angle(1.0))):
        run = fa.simulate(arm, 2.5, controller=controller, reference=followed, rate=100.0)
        peaks.append(np.hypot(*(run.tip.values - line.tip(run.time.values)).T).max())
        run = fa.simulate(soft, 3.5, controller=controller, reference=followed, rate=100.0)
        late = run.link_tip_deflection.sel(link=1, time=slice(2.5, 3.5))
        swings.append(np.ptp(late.values))
    # Static bending alone, of the same motion, would be a deviation of several centimetres.
    assert peaks[1] < peaks[0] + 5e-4
    assert swings[1] < 0.7 * swings[0]


def test_coordinates_of_the_inversion_are_those_of_the_run():
    arm = two_links()
    line = fa.line_motion(arm, (1.8, 1.0), (1.0, 1.8), 1.2, start_time=0.4)
    inverse = fa.tip_inversion(arm, line)
    run = fa.simulate(arm, 1.5, torque=inverse.torque, initial=inverse.initial, rate=100.0)
    q, qd, _ = inverse.reference.coordinates(run.time.values)
    np.testing.assert_allclose(q, run.q.values, atol=2e-5)  # the spline, and the run's tolerance
    np.testing.assert_allclose(qd, run.qd.values, atol=1e-3)


def printed_law(law, ratio, omega, s):
    """Return u / y of (C.18) or (C.19)."""
    if law is fa.PositivePositionFeedback:
        return -((2 * ratio) ** 2) * omega**2 / (s**2 + 4 * ratio * omega * s + omega**2)
    zero = omega / (1 + 2 * ratio)
    f = zero**2 / (omega**2 - zero**2)
    k = omega * np.sqrt(omega / zero) / (1 + f)
    return -k / (s + k * f)


# The third mode would grow, around joints that follow exactly.
@pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning")
@every
def test_two_modes_of_two_links_are_separate_loops(law):
    """Joints move two modes, and gauges read them, as if each had its own joint and gauge."""
    arm, posture, ratio = two_links(), [0.1, 0.4], 0.2
    found = fa.modes(arm, posture)
    shapes, omega = found.shapes[:2], 2.0 * np.pi * found.frequency_hz[:2]
    seen = strain_rows(arm) @ shapes.T
    moved = shapes @ arm.mass_matrix(arm.rest(posture))[:, arm.joint_index]
    rest = {
        "joint_angle": np.array(posture), "joint_rate": np.zeros(2), "strain": np.zeros(2)
    }  # fmt: skip
    sampled = linear_controller(law(arm, echo(), ratio, modes=2, posture=posture), rest)
    for w in (2.0, 7.0, 20.0, 50.0):
        z = np.exp(1j * w * TICK)
        n = len(sampled.A)
        answer = sampled.C @ np.linalg.solve(z * np.eye(n) - sampled.A, sampled.B) + sampled.D
        plant = seen @ np.diag(w**2 / (omega**2 - w**2)) @ moved
        loops = np.linalg.eigvals(answer[:, 4:] @ plant)
        tustin = 2.0 / TICK * (z - 1.0) / (z + 1.0)
        wanted = printed_law(law, ratio, omega, tustin) * -(w**2) / (omega**2 - w**2)
        # Differences of strains have an error of 1e-8 of the law.
        np.testing.assert_allclose(np.sort_complex(loops), np.sort_complex(wanted), rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"damping_ratio": 1.0}, "damping_ratio must be less than 1"),
        ({"damping_ratio": 0.0}, "damping_ratio must be greater than 0"),
        ({"modes": 2}, r"modes is 2, but the arm has 1 joint\(s\), 1 gauge\(s\) "),
        ({"posture": [0.0, 1.0]}, "posture must have length 1"),
        ({"inner": "PD"}, "inner must have the method reset"),
        ({"inner": fa.LQG(one_link())}, "inner must be a controller of the joint angles"),
        ({"arm": fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0)])},
         r"modes is 1, but the arm has 1 joint\(s\), 0 gauge\(s\) and "),
    ],
)  # fmt: skip
@every
def test_wrong_arguments_are_rejected(law, options, words):
    with pytest.raises(fa.InputError, match=words):
        law(**{"arm": one_link(), "inner": fa.JointPD(1.0, 1.0), **options})


def around(inner):
    """Return controllers of the joint angles, or not, around an inner one."""
    return [
        inner,
        fa.DisturbanceObserver(one_link(), inner),
        fa.RepetitiveControl(inner, 0.5, 1.0),
        fa.RepetitiveControl(fa.DisturbanceObserver(one_link(), inner), 0.5, 1.0),
    ]


NOT_OF_JOINTS = [fa.LQG(one_link()), fa.Impedance(one_link())] + [
    kind(one_link(), fa.JointPD(1.0, 1.0)) for kind in LAWS
]


@every
@pytest.mark.parametrize("innermost", NOT_OF_JOINTS, ids=lambda one: one.name)
def test_innermost_controller_must_be_one_of_the_joint_angles(law, innermost):
    for inner in around(innermost):
        with pytest.raises(fa.InputError, match="inner must be a controller of the joint angles"):
            law(one_link(), inner)


@every
def test_controllers_around_one_of_the_joint_angles_are_accepted(law):
    own = [echo(), fa.JointPD(1.0, 1.0), fa.LoopShaping(one_link())]
    for innermost in own:
        for inner in around(innermost):
            assert law(one_link(), inner).inner is inner


@every
def test_gauges_at_one_place_do_not_distinguish_two_modes(law):
    gauges = [fa.Gauge(station=0.05, distance=distance) for distance in (0.005, -0.005)]
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 1}
    links = [fa.Link(length=1.0, gauges=gauges, **rod), fa.Link(length=1.0, **rod)]
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=1.0)] * 2)
    with pytest.raises(fa.InputError, match="modes must be observed by the gauges, got 2"):
        law(arm, fa.JointPD(1.0, 1.0), modes=2)


def aluminium_links():
    section = {"elements": 2, "material": "aluminium", "damping": fa.ModalDamping(ratio=0.005)}
    gauges = [fa.Gauge(station=0.02, distance=0.002)]
    sizes = [(0.8, 0.05, 0.006), (0.6, 0.04, 0.004)]
    links = [
        fa.Link(length=length, section=fa.Rectangle(width=b, height=h), gauges=gauges, **section)
        for length, b, h in sizes
    ]
    joints = [
        fa.Joint(hub_inertia=0.05),
        fa.Joint(mass=0.8, hub_inertia=0.01, housing_inertia=0.005),
    ]
    return fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.3))


def test_growing_mode_that_is_not_designed_is_reported():
    """The second mode grows around stiff joints with one mode, and is damped with two."""
    arm, posture = aluminium_links(), [0.8, 0.4]
    inner = fa.JointPD([2000.0, 500.0], [120.0, 20.0], sample_time=TICK)
    ratios = []
    for count in (1, 2):
        options = {"modes": count, "posture": posture}
        if count == 1:
            with pytest.warns(fa.UnstableLoopWarning, match="With modes=1, a mode of 5.8.* Hz"):
                made = fa.IntegralResonantControl(arm, inner, 0.3, **options)
        else:
            made = fa.IntegralResonantControl(arm, inner, 0.3, **options)
        poles = loop_at(made, arm, np.array(posture)).poles()
        second = 2.0 * np.pi * fa.modes(arm, posture).frequency_hz[1]
        near = poles[(poles.imag > 0.6 * second) & (poles.imag < 1.2 * second)]
        ratios.append(min(-near.real / abs(near)))
    assert ratios[0] < 0.0 < 0.2 < ratios[1]


def test_growing_mode_above_all_that_can_be_designed_is_reported():
    arm, posture = two_links(), [0.8, 0.4]
    inner = fa.JointPD([2000.0, 500.0], [120.0, 20.0], sample_time=TICK)
    with pytest.warns(fa.UnstableLoopWarning, match="With modes=2, a mode of 13.* Hz"):
        made = fa.IntegralResonantControl(arm, inner, 0.3, modes=2, posture=posture)
    assert float(fa.loop_margins(made, arm, posture).growth.max()) > 1.0
    made = fa.IntegralResonantControl(arm, inner, 0.3, posture=posture)
    assert float(fa.loop_margins(made, arm, posture).growth.max()) < 0.0


def test_reported_growth_is_that_of_joints_that_follow():
    """The damping ratio in the warning, against the sampled loop around joints of 130 Hz."""
    arm, posture = aluminium_links(), np.array([0.8, 0.4])
    inertia = np.diag(arm.mass_matrix(arm.rest(posture)))[arm.joint_index]
    w = 2.0 * np.pi * 130.0
    inner = fa.JointPD(10.0 * inertia * w**2, 14.0 * inertia * w, sample_time=1e-5)
    with pytest.warns(fa.UnstableLoopWarning) as kept:
        made = fa.IntegralResonantControl(arm, inner, 0.3, posture=posture)
    reported = float(str(kept[0].message).partition("damping ratio is ")[2].partition(". ")[0])
    poles = loop_at(made, arm, posture).poles()
    poles = poles[(poles.imag > 30.0) & (poles.imag < 45.0)]
    assert len(poles) == 1
    assert reported == pytest.approx(float(-poles[0].real / abs(poles[0])), abs=0.003)
