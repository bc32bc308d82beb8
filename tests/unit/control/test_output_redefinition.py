"""Output redefinition against closed forms, strain feedback, and python-control."""

import control
import numpy as np
import pytest

import flexarm as fa
from arms import chain
from controllers import Law
from flexarm.control.analysis.margins import loop_at
from flexarm.control.design.nominal import FlexibleModel
from flexarm.control.hardware.measurement import Measurement

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}


def echo():
    """Return an inner controller whose torques are the angles of its reference."""
    return Law(lambda readings, inputs: inputs["reference_angle"], 1e-3)


def one_link(count=1, hub=0.0, **changes):
    """Return a link with ``count`` modes and gauges."""
    gauges = [fa.Gauge(station=0.05 + 0.7 * k / count, distance=0.005) for k in range(count)]
    link = fa.Link(length=1.0, elements=6, modes=count, gauges=gauges, **ROD)
    return fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=hub)], **changes)


def three_links():
    """Return an arm of two joints whose first link has two parts."""
    joints = [0.1, {"fixed": True}, 0.05]
    return chain((0.8, 0.5, 0.6), joints, gauge=(0.05, 0.005), elements=1, **ROD)


def test_chords_are_the_angles_of_a_rigid_arm_with_the_same_tip():
    arm, posture = three_links(), np.array([0.3, 0.7])
    model, rng = FlexibleModel(arm), np.random.default_rng(1)
    bend = 1e-4 * rng.normal(size=model.elastic.size)
    q = arm.rest(posture)
    q[model.elastic] = bend
    moved = arm.rigid().tip(posture + model.chords(posture) @ bend)[:2]
    straight = arm.tip(arm.rest(posture))
    # Deviations are of second order in rotations of 1e-3.
    np.testing.assert_allclose(moved, arm.tip(q)[:2], atol=1e-6)
    assert np.hypot(*(arm.tip(q) - straight)[:2]) > 1e-3
    np.testing.assert_allclose(model.chords(np.zeros(2)), model.chords(posture), atol=1e-6)


def test_largest_damping_weight_of_a_uniform_beam_on_a_pin():
    """Closed form: tan b = tanh b; the tip is at 2 sin b where the slope is b (1 + sin b / sinh b).

    The rate of the output is passive up to 1 / (1 - ratio), by the first mode, and the reflected
    tip, like every negative weight, is passive in all modes (Wang and Vidyasagar 1992).
    """
    b = np.array([3.92660231, 7.06858275, 10.21017612])
    ratio = 2.0 * np.sin(b) / (b * (1.0 + np.sin(b) / np.sinh(b)))
    controller = fa.OutputRedefinition(one_link(5), echo())
    lowest, largest = controller.damping_weights()
    assert lowest == -np.inf
    # Five modes of a clamped link represent the first ones of a link on a pin to this accuracy.
    assert largest == pytest.approx(np.min(1.0 / (1.0 - ratio)), rel=5e-3)


def test_heavy_payload_makes_every_weight_below_one_passive():
    """Damaren (1995): vibrations of an arm with a large payload have a node at the tip."""
    largest = []
    for mass in (0.5, 50.0):
        arm = one_link(3, payload=fa.Payload(mass=mass))
        largest.append(fa.OutputRedefinition(arm, echo()).damping_weights()[1])
    assert largest[0] < largest[1] < 1.0
    assert largest[1] > 0.99


@pytest.mark.parametrize("weight", [-1.0, 0.6])
def test_law_written_out_for_one_link(weight):
    """The chord by one gauge, through Tustin's rule for 1 / (1 + s / w) and for its rate."""
    arm, tick, w = one_link(1, hub=0.2), 1e-3, 2.0 * np.pi * 8.0
    inner = fa.JointPD(8.0, 0.7, sample_time=tick)
    controller = fa.OutputRedefinition(arm, inner, weight=weight, cutoff=8.0)
    shape = fa.modes(arm).shapes[0]
    C = fa.linearize(arm, outputs=["strain", "tip"]).C[:, : arm.dof]
    chord = (C[2] @ shape) / (C[0] @ shape)  # the deflection is across the link, which has 1 m
    rng = np.random.default_rng(2)
    slow = rate = before = held = 0.0
    for k in range(30):
        angle, speed, strain = rng.normal(size=3) * [0.1, 1.0, 1e-4]
        turned = chord * strain
        new = ((2.0 - w * tick) * slow + w * tick * (turned + before)) / (2.0 + w * tick)
        rate = 2.0 / tick * (new - slow) - rate
        slow, before = new, turned
        held = held if k else angle
        wanted = -8.0 * (angle - held + weight * slow)
        wanted -= 0.7 * (speed + weight * rate)
        reading = Measurement(
            joint_angle=np.array([angle]), joint_rate=np.array([speed]), strain=np.array([strain])
        )
        found = controller.update(k * tick, reading, None)
        assert found[0] == pytest.approx(wanted, rel=1e-6, abs=1e-9)


def poles_of(arm, weight, proportional, derivative):
    """Return the poles by python-control: u = -(p + d s) (angle + weight * chord)."""
    outputs = ["joint_angle", "link_tip_deflection"]
    model = fa.linearize(arm, outputs=outputs)
    C = np.array([[1.0, weight]]) @ model.C
    # The rate of the output is C A x, because C B is zero.
    gain = proportional * C + derivative * C @ model.A
    return control.ss(model.A - model.B @ gain, model.B, C, 0.0).poles()


@pytest.mark.parametrize("weight", [-1.0, -0.5, 0.5])
def test_poles_are_those_of_python_control(weight):
    arm = one_link(2, hub=0.1)
    inner = fa.JointPD(6.0, 1.2, sample_time=1e-5)
    controller = fa.OutputRedefinition(arm, inner, weight=weight, cutoff=2e4)
    found = loop_at(controller, arm, np.zeros(1)).poles()
    found = found[abs(found) < 1e3]
    wanted = poles_of(arm, weight, 6.0, 1.2)
    # The delay of half a sample and of the filter, 13 us, moves poles of up to 300 rad/s.
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(wanted), rtol=1e-2)


@pytest.mark.thorough
def test_tip_returns_under_an_unknown_load():
    """At rest the tip has the share 1 - weight of the deflection that its load causes."""
    arm = one_link(1, hub=0.2)
    load = [fa.Load(1, (0.0, 0.5))]
    inner = fa.JointPID(30.0, 4.0, 30.0)
    found = []
    for weight in (0.0, 0.5, 1.0):
        controller = fa.OutputRedefinition(arm, inner, weight=weight)
        run = fa.simulate(arm, 40.0, controller=controller, loads=load, rate=10.0)
        found.append(run.tip.values[-20:, 1].mean())
    deflection = 0.5 / (3.0 * ROD["flexural_rigidity"])  # N / (3 E I), of a link of 1 m
    # With one bending coordinate the gauge determines the bending exactly.
    np.testing.assert_allclose(found, deflection * np.array([1.0, 0.5, 0.0]), atol=1e-5)


def test_neither_sign_of_the_weight_damps_a_soft_and_a_stiff_loop_better():
    """The lowest vibration of a link with a payload, around joint loops of the same gains.

    Negative weights lower the frequency that a stiff joint leaves, and with it the damping.
    """
    arm = one_link(1, hub=0.02, payload=fa.Payload(mass=0.5))
    ratios = {}
    for weight in (-1.0, 0.0, 0.5):
        poles = poles_of(arm, weight, 40.0, 8.0)
        poles = poles[poles.imag > 1.0]
        lowest = poles[np.argmin(abs(poles))]
        ratios[weight] = -lowest.real / abs(lowest)
    assert 0.0 < ratios[-1.0] < 0.7 * ratios[0.0]
