"""Margins of sampled loops against closed forms, and linear loops against their controllers."""

import sys
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from arms import chain, laboratory_arm
from controllers import Plain
from flexarm.control.analysis.linear_controller import linear_controller
from flexarm.control.analysis.margins import loop_at
from flexarm.control.analysis.sampled_loop import instruments_of, model_at, signals_of
from flexarm.control.contract.base import has_poles
from flexarm.control.design.linear_design import regulated
from flexarm.control.laws.lqg import _least

sys.path.append(str(Path(__file__).parents[2] / "conformance"))
from controller_examples import EXAMPLES, SAMPLE_TIME, two_links

STEP, K, D = 2e-3, 30.0, 3.0


def turntable():
    """Return one rigid link on a hub, a double integrator, and its inertia."""
    link = fa.Link(length=0.8, flexural_rigidity=40.0, mass_per_length=0.5, elements=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)]).rigid()
    return arm, float(arm.mass_matrix([0.0])[0, 0])


def returned(frequency, inertia, late=0):
    """Return the loop gain of a PD controller around J theta'' = torque with a hold, by
    z-transforms."""
    z = np.exp(1j * frequency * STEP)
    angle = STEP**2 / (2.0 * inertia) * (z + 1.0) / (z - 1.0) ** 2
    rate = STEP / inertia / (z - 1.0)
    return (K * angle + D * rate) * z**-late


@pytest.mark.parametrize("late", [0, 3])
def test_margins_of_a_double_integrator_have_closed_forms(late):
    arm, inertia = turntable()
    motors = fa.Motors(delay=late * STEP)
    found = fa.loop_margins(
        fa.JointPD(K, D, sample_time=STEP), arm, hardware=fa.Hardware(motors=motors)
    ).isel(plant=0, posture=0, joint=0)
    frequency = np.geomspace(0.1, np.pi / STEP * (1.0 - 1e-9), 400_001)
    L = returned(frequency, inertia, late)
    # The grid of the reference limits its digits.
    k = int(np.argmin(np.abs(np.log(np.abs(L)))))
    phase = np.angle(-L[k])
    assert float(found.phase_margin) == pytest.approx(phase, rel=1e-4)
    assert float(found.delay_margin) == pytest.approx(phase / frequency[k], rel=1e-4)
    S = 1.0 / (1.0 + L)
    assert float(found.disk_margin) == pytest.approx(2.0 / np.abs(2.0 * S - 1.0).max(), rel=1e-4)
    assert float(found.gain_reduction_margin) == 0.0
    if not late:  # the pole at z = -1: 4 - 2 D h gain / J = 0
        assert float(found.gain_margin) == pytest.approx(2.0 * inertia / (D * STEP), rel=1e-9)
    else:
        turned = np.flatnonzero((L.imag[:-1] < 0) & (L.imag[1:] > 0) & (L.real[:-1] < 0))[0]
        assert float(found.gain_margin) == pytest.approx(-1.0 / L.real[turned], rel=1e-3)


def test_loop_becomes_unstable_at_the_gain_margin():
    arm = two_links()
    own = fa.JointPD([3.0, 1.0], [0.05, 0.02], sample_time=SAMPLE_TIME)
    damped = fa.Arm(
        links=[link.replace(damping=fa.ModalDamping(ratio=0.02)) for link in arm.spec.links],
        joints=arm.spec.joints,
    )
    found = fa.loop_margins(own, damped, [0.4, 0.1]).isel(plant=0, posture=0)
    for joint in range(2):
        growth = []
        for factor in (0.999, 1.001):
            by = np.ones(2)
            by[joint] = factor * float(found.gain_margin[joint])
            scaled = fa.JointPD(by * own.proportional, by * own.derivative, SAMPLE_TIME)
            growth.append(loop_at(scaled, damped, [0.4, 0.1]).poles()[0].real)
        assert growth[0] < 0.0 < growth[1]


@pytest.mark.thorough
def test_disk_margins_equal_those_of_python_control():
    control = pytest.importorskip("control")
    if not hasattr(control, "disk_margins"):
        pytest.skip("python-control has no disk margins before 0.10.2")
    arm, inertia = turntable()
    z = control.tf([1.0, 0.0], [1.0], STEP)
    loop = K * STEP**2 / (2.0 * inertia) * (z + 1) / (z - 1) ** 2 + D * STEP / inertia / (z - 1)
    omega = np.geomspace(1.0, np.pi / STEP * 0.999, 20_001)
    wanted, *_ = control.disk_margins(control.ss(loop), omega)
    found = fa.loop_margins(fa.JointPD(K, D, sample_time=STEP), arm)
    assert float(found.disk_margin.min()) == pytest.approx(float(np.squeeze(wanted)), rel=1e-4)


@pytest.mark.parametrize("name", EXAMPLES)
def test_linear_systems_of_controllers(name):
    """The linear system of a controller has the same response to small readings of many samples."""
    controller = EXAMPLES[name]()
    if not has_poles(controller):
        assert name in ("estimator", "nonlinear_mpc", "rbf_adaptive", "repetitive")
        return
    arm = two_links()
    instruments = instruments_of(arm, None, 0)
    model = model_at(arm, [0.4, 0.1], signals_of(instruments))
    about = {item.signal: model.signals[item.signal].value for item in instruments}
    linear = linear_controller(controller, about)
    readings = np.concatenate(list(about.values()))
    rng = np.random.default_rng(3)
    small = 1e-7 * rng.normal(size=(25, readings.size))
    small[0] = 0.0  # constant angles without a reference
    ends = np.cumsum([value.size for value in about.values()])[:-1]

    def answer(deviations):
        controller.reset()
        return np.array(
            [
                controller.update(
                    0.0,
                    fa.Measurement(**dict(zip(about, np.split(readings + d, ends), strict=True))),
                    None,
                )
                for d in deviations
            ]
        )

    found = answer(small) - answer(0.0 * small)
    state, wanted = np.zeros(len(linear.A)), []
    for y in small:
        wanted.append(linear.C @ state + linear.D @ y)
        state = linear.A @ state + linear.B @ y
    # Second order in 1e-7, amplified by the change of gains with the readings.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=2e-4 * np.abs(wanted).max())


def robust_arm(rigidity=1.0, payload=0.1, gravity=(0.0, -9.81)):
    """Return the arm of docs/how-to/control-linear.md with a payload, in a vertical plane."""
    gauges, damping = [fa.Gauge(station=0.05, distance=0.005)], fa.ModalDamping(ratio=0.01)
    rod = {"gauges": gauges, "damping": damping}
    return laboratory_arm(rigidity, payload, rod, gravity=gravity)


PLANTS = {"soft": (0.7, 0.1), "stiff": (1.3, 0.1), "heavy": (1.0, 0.2), "both": (0.7, 0.2)}
POSTURE = [0.8, 0.9]


def growth(controller):
    plants = [robust_arm(), *(robust_arm(*change) for change in PLANTS.values())]
    return max(controller.loop_poles(plant, POSTURE)[0].real for plant in plants)


# The soft and heavy arm sags by a tenth of its length: beyond the theory, without effect here.
@pytest.mark.sampled("LQG")
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.parametrize("kind", [fa.LQG, fa.Composite, fa.MPC])
def test_designs_for_an_uncertain_rigidity_are_stable_on_other_arms(kind):
    options = {"torque_limit": 200.0, "sample_time": 2e-3} if kind is fa.MPC else {}
    certain = {"rigidity_uncertainty": 0.0, "recovery": 0.0}
    plain = kind(robust_arm(), POSTURE, **certain, **options)
    # Composite control damps bending by its fast part alone, and needs more, which is its default.
    unsure = {} if kind is fa.Composite else {"rigidity_uncertainty": 0.3}
    assert growth(plain) > 1.0
    assert growth(kind(robust_arm(), POSTURE, **unsure, **options)) < -0.5


@pytest.mark.parametrize("sample_time", [0.0005, 0.004])
def test_a_composite_with_default_arguments_is_stable_half_a_radian_away(sample_time):
    """Undamped links, at the higher sample time above half of the sampling frequency."""
    arm = two_links()
    controller = fa.Composite(arm, [0.4, 0.1], sample_time=sample_time)
    for change in (-0.5, -0.25, 0.0, 0.25, 0.5):
        assert controller.loop_poles(posture=[0.4, 0.1 + change]).real.max() < 0.0
    certain = {"rigidity_uncertainty": 0.0, "recovery": 0.0}
    plain = fa.Composite(arm, [0.4, 0.1], sample_time=sample_time, **certain)
    assert plain.loop_poles(posture=[0.4, 0.6]).real.max() > 10.0


def test_margins_of_a_loop_with_a_pole_on_the_unit_circle():
    """A sensitivity that is infinite at a frequency of the grid has no margin there."""
    loop = fa.Composite(two_links(), [0.4, 0.1], recovery=0.0, sample_time=0.004)
    margin = fa.loop_margins(loop, two_links(), [0.4, 0.1]).disk_margin
    assert 0.0 < float(margin.min()) < 0.5


#: Lengths, rigidities, masses per length and hub inertias: SciPy cannot order the equation of the
#: first regulator, and rounds the covariance of the second filter.
STIFF = {
    "regulator": ((0.4, 1.34), (288.0, 121.0), (0.219, 2.17), (0.0183, 0.0282)),
    "filter": ((0.6, 0.5), (900.0, 900.0), (0.25, 0.25), (0.1, 0.1)),
}


@pytest.mark.parametrize("name", STIFF)
def test_stiff_arms_have_a_design_for_an_uncertain_rigidity(name):
    lengths, rigidities, masses, hubs = STIFF[name]
    links = [
        fa.Link(
            length=length, flexural_rigidity=rigidity, mass_per_length=mass, elements=2,
            gauges=[fa.Gauge(station=0.03, distance=0.005)], damping=fa.ModalDamping(ratio=0.01),
        )
        for length, rigidity, mass in zip(lengths, rigidities, masses, strict=True)
    ]  # fmt: skip
    gravity = (0.0, -9.81) if name == "filter" else (0.0, 0.0)
    joints = [fa.Joint(hub_inertia=hub) for hub in hubs]
    arm = fa.Arm(links=links, joints=joints, gravity=gravity)
    posture = [0.4, -0.9] if name == "regulator" else [0.4, 0.5]
    controller = fa.Composite(arm, posture)
    assert controller.loop_poles().real.max() < 0.0


def test_recovery_restores_the_margins_of_state_feedback():
    margins = [
        float(fa.loop_margins(fa.LQG(robust_arm(), POSTURE, recovery=recovery)).disk_margin.min())
        for recovery in (0.0, 1.0, 10.0)
    ]
    assert margins[0] < margins[1] < margins[2]


def test_composite_has_its_bandwidth_under_gravity():
    """State feedback at the design's posture: the joints' poles are near the bandwidth."""
    for integral, slowest in ((False, [2.0] * 4), (True, [0.6] * 2 + [2.0] * 4)):
        certain = {"rigidity_uncertainty": 0.3, "integral": integral}
        slow = fa.Composite(robust_arm(), POSTURE, bandwidth=2.0, **certain)
        z = np.linalg.eigvals(regulated(slow.designs[0])[1])
        decay = np.sort(-np.log(np.abs(z)) / slow.sample_time)[: len(slowest)]
        # The bend that moves with the joints is slow, not zero: the small parameter is 0.05.
        np.testing.assert_allclose(decay, slowest, rtol=0.5)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_design_for_a_margin_reaches_it_or_reports_the_best():
    plants = {name: robust_arm(*change) for name, change in list(PLANTS.items())[-1:]}
    made = fa.LQG.for_margin(robust_arm(), POSTURE, plants=plants, disk_margin=0.2)
    assert float(fa.loop_margins(made, plants).worst_disk_margin.min()) >= 0.2
    with pytest.raises(fa.InputError, match=r"disk_margin of .* cannot be reached"):
        fa.Composite.for_margin(robust_arm(), POSTURE, plants=plants, disk_margin=1.9)


def test_least_margin_of_several_arms_is_that_of_the_worst():
    arm, inertia = turntable()
    heavy = fa.Arm(arm.spec.replace(joints=[fa.Joint(hub_inertia=0.05 + 2.0 * inertia)]))
    controller = fa.JointPD(5.0, D, sample_time=STEP)
    each = [float(fa.loop_margins(controller, a, [0.0]).disk_margin.min()) for a in (arm, heavy)]
    assert 1.0 < each[1] < each[0]
    assert _least(controller, [arm, heavy], [0.0], 0.0) == each[1]


def test_unsupported_loops_are_rejected():
    arm, _ = turntable()
    with pytest.raises(fa.InputError, match="step"):
        fa.loop_margins(Plain(lambda t, measurement, reference: [0.0]), arm)
    with pytest.raises(fa.InputError, match="plants"):
        fa.loop_margins(fa.JointPD(1.0, 1.0))
    slow = fa.Hardware([fa.Instrument("joint_angle", sample_time=4e-3, rate_cutoff=20.0)])
    with pytest.raises(fa.InputError, match="sample_time"):
        fa.loop_margins(fa.JointPD(1.0, 1.0), arm, hardware=slow)


def soft(rigidity, gravity=9.81):
    rod = {"flexural_rigidity": rigidity, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    joints = [0.1, {"mass": 0.4, "hub_inertia": 0.05}]
    return chain((0.8, 0.6), joints, gauge=(0.05, 0.004), gravity=(0.0, -gravity), **rod)


@pytest.mark.parametrize(
    "call",
    [
        lambda arm: fa.LQG(arm, POSTURE),
        lambda arm: fa.Composite(arm, POSTURE),
        lambda arm: fa.loop_margins(fa.JointPD(3.0, 0.3), [arm, soft(6.0)], [POSTURE, [0.0, 0.0]]),
        lambda arm: fa.LQG(soft(6.0, 0.0), POSTURE).loop_poles(arm),
        lambda arm: fa.LQG.for_margin(arm, POSTURE, plants=[soft(6.0)], disk_margin=0.01),
        lambda arm: fa.simulate(arm, 0.3, controller=fa.StrainFeedback(30.0, 3.0, 0.1)),
        lambda arm: fa.ExtendedKalmanFilter(
            arm, [fa.Instrument("joint_angle", noise=1e-4)], payload_deviation=0.1
        ).correct(fa.Measurement(joint_angle=np.array(POSTURE))),
    ],
)
def test_one_call_warns_once_of_bending(call):
    with pytest.warns(fa.LargeDeflectionWarning) as caught:
        call(soft(5.0))
    assert len(caught) == 1
    assert caught[0].filename == __file__


def test_a_kept_model_warns_again():
    """Also of what the linear model does not contain: straight links rest in the gap."""
    gap = fa.Joint(hub_inertia=0.1, rotor_inertia=0.1, stiffness=500.0, backlash=0.1)
    arm = fa.Arm(soft(5.0, 0.0).spec.replace(joints=[gap, gap]))
    texts = []
    for _ in range(2):
        with pytest.warns(fa.FlexarmWarning, match="between the contacts") as caught:
            fa.loop_margins(fa.JointPD(3.0, 0.3), arm, [0.0, 0.0])
        texts.append([str(warning.message) for warning in caught])
    assert texts[0] == texts[1]


def test_times_and_plants_of_the_wrong_kind_are_rejected():
    arm = two_links()
    motion = fa.joint_motion(arm, [0.1, 0.2], [0.2, 0.3], 1.0)
    for postures, message in (([], "are empty"), ("x", "postures"), ([[0.1], [0.1, 0.2]], "post")):
        with pytest.raises(fa.InputError, match=message):
            fa.loop_margins(fa.JointPD(3.0, 0.3), arm, postures, reference=motion)
    with pytest.raises(fa.InputError, match=r"LQG\.for_margin: plants must be an Arm, or .* got 3"):
        fa.LQG.for_margin(arm, plants=3)


@pytest.mark.thorough
def test_torque_rate_limits_are_not_part_of_the_linear_loop():
    """A change of one reading from one update to the next would exceed them."""
    found = [
        fa.loop_margins(fa.MPC(robust_arm(), POSTURE, torque_limit=200.0, torque_rate=rate))
        for rate in (None, 20.0)
    ]
    np.testing.assert_array_equal(found[0].growth, found[1].growth)


def test_truth_values_of_a_memory_are_constant():
    class Switched(fa.Controller):
        sample_time = SAMPLE_TIME

        def initial_memory(self, readings, inputs):
            return {"on": False, "sum": 0.0}

        def step(self, memory, readings, inputs):
            on = memory["on"] or bool(readings["joint_rate"][0] > 1.0)
            total = memory["sum"] + 0.25 * readings["joint_angle"][0]
            return {"on": on, "sum": total}, np.array([3.0 * total if on else total])

    for rate, gain in ((0.0, 1.0), (2.0, 3.0)):
        measured = {"joint_angle": np.zeros(1), "joint_rate": np.array([rate])}
        found = linear_controller(Switched(), measured)
        np.testing.assert_allclose(found.A, [[1.0]], atol=1e-9)  # rounding of differences
        np.testing.assert_allclose(found.C, [[gain]], atol=1e-9)


def test_times_that_are_no_numbers_are_called_times():
    """With a reference, ``postures`` are times; two joint angles each are not."""
    arm = soft(6.0, 0.1)
    motion = fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    with pytest.raises(fa.InputError, match=r"postures, with a reference its times \(s\), must"):
        fa.loop_margins(fa.JointPD(1.0, 1.0), arm, [POSTURE], reference=motion)
