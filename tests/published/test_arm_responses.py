"""Motions and deflections of arms against published or closed-form numbers."""

import json
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from arm_states import modal_parts

DATA = json.loads(
    (Path(__file__).parents[1] / "data" / "arm_responses.json").read_text(encoding="utf-8")
)


@pytest.mark.thorough_cases("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_slewing_step(theory):
    """The step of hub torque is so small that the theories agree and angles are linear."""
    case, torque = DATA["slewing"], 1e-3
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=16)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=case["hub_inertia"])], theory=theory)
    result = fa.simulate(arm, 1.0, torque=lambda t: [torque], rate=200.0, rtol=1e-8, atol=1e-12)
    at = result.sel(time=case["time"])
    # The step excites every mode; those with mesh errors have 1e-6 of the response. Terms of second
    # order are 1e-6 of it at this torque.
    np.testing.assert_allclose(at.link_angle.values[:, 0] / torque, case["angle"], atol=2e-6)
    np.testing.assert_allclose(
        at.link_tip_deflection.values[:, 0] / torque, case["deflection"], atol=2e-6
    )
    # The tip vibrates about the static deflection under the rigid acceleration.
    acceleration = 1.0 / (1.0 / 3.0 + case["hub_inertia"])
    constants = arm.assembly.links[0]
    mean = -constants.P @ (constants.a * acceleration / constants.w2)
    assert mean == pytest.approx(case["mean_deflection"], abs=6e-9)


def spin_up_acceleration(t):
    """Return the second derivative of Kane's angle (rad/s^2)."""
    return 0.4 * (1.0 - np.cos(2 * np.pi * t / 15.0)) if t < 15.0 else 0.0


def spin_up(theory, duration):
    """Return the beam on a hub of such inertia that the prescribed motion is a torque."""
    case = DATA["spin_up"]
    link = fa.Link(
        length=case["length"],
        flexural_rigidity=case["flexural_rigidity"],
        mass_per_length=case["mass_per_length"],
        elements=24,
        modes=10,
    )
    # The beam's reaction (400 kg m^2) changes the prescribed angle by a part in 1e8.
    hub = 4e10
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=hub)], theory=theory)
    result = fa.simulate(
        arm,
        duration,
        torque=lambda t: [hub * spin_up_acceleration(t)],
        rate=1000.0,
        rtol=1e-9,
        atol=1e-10,
    )
    return result.time.values, result.link_tip_deflection.values[:, 0], result


def test_spin_up_of_kane_ryan_and_banerjee():
    """Second-order theory: rotation stiffens the beam, and it comes to rest straight."""
    case = DATA["spin_up"]["stiffened"]
    time, deflection, result = spin_up("second_order", 20.0)
    lowest = np.argmin(deflection)
    # The published problem is linear in the deflection; the terms of third order that keep the mass
    # matrix positive change these numbers by 2.4e-4 m and two percent at most.
    assert deflection[lowest] == pytest.approx(case["extreme"], abs=3e-4)
    assert time[lowest] == pytest.approx(case["extreme_time"], abs=3e-3)
    found = np.interp(case["time"], time, deflection)
    np.testing.assert_allclose(found, case["deflection"], rtol=0, atol=2.5e-4)
    after = deflection[time > 15.0]
    assert abs(after).max() == pytest.approx(case["residual_amplitude"], rel=0.015)
    assert result.link_rate.values[-1, 0] == pytest.approx(6.0, abs=1e-6)


def test_spin_up_in_the_papers_theory_diverges():
    """Without foreshortening the beam loses its stiffness."""
    case = DATA["spin_up"]["unstiffened"]
    with pytest.warns(fa.LargeDeflectionWarning):
        time, deflection, _ = spin_up("linear", 10.0)
    found = np.interp(case["time"], time, deflection)
    # Five or more digits are printed; the instability amplifies the mesh error.
    np.testing.assert_allclose(found, case["deflection"], rtol=1e-5)


def table_one_arm(elements, gravity):
    section = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    links = [
        fa.Link(length=length, elements=count, **section)
        for length, count in zip((1.4142, 1.0), elements, strict=True)
    ]
    return fa.Arm(links=links, gravity=gravity)


def linear_statics(arm):
    """Return first-order nodal values and tip of the horizontal arm under its weight, joints
    locked."""
    elastic = modal_parts(arm)
    straight = arm.rest(np.zeros(arm.n_joints))
    load = -arm.bias_force(straight, np.zeros(arm.dof))
    level = fa.Arm(arm.spec.model_copy(update={"gravity": (0.0, 0.0)}))
    K = level.stiffness_matrix(straight)
    q = np.zeros(arm.dof)
    q[elastic] = np.linalg.solve(K[np.ix_(elastic, elastic)], load[elastic])
    return arm.nodal(q), arm.tip_velocity(straight, q)


@pytest.mark.parametrize("elements", [(1, 1), (2, 1), (5, 7)])
def test_sag_of_the_table_one_arm(elements):
    """Cubic elements are exact at their nodes, however few."""
    case = DATA["statics"]
    nodal, tip = linear_statics(table_one_arm(elements, (0.0, -9.81)))
    # Ten decimals are published.
    assert -nodal[0][-1, 0] == pytest.approx(case["elbow_sag"], abs=6e-11)
    assert -nodal[0][-1, 1] == pytest.approx(case["elbow_slope"], abs=6e-11)
    assert -tip[1] == pytest.approx(case["tip_sag"], abs=6e-11)


@pytest.mark.parametrize("elements", [1, 3])
def test_cantilever_under_tip_loads(elements):
    """P L^3 / 3 EI, P L^2 / 2 EI and M L^2 / 2 EI, M L / EI."""
    length, rigidity, force, moment = 1.3, 40.0, 2.0, 0.7
    link = fa.Link(
        length=length, flexural_rigidity=rigidity, mass_per_length=1.0, elements=elements
    )
    arm = fa.Arm(links=[link])
    rest, zero = arm.rest([0.0]), np.zeros(arm.dof)
    K = arm.stiffness_matrix(rest)[1:, 1:]
    for load, deflection, slope in [
        ((0.0, force, 0.0), force * length**3 / 3, force * length**2 / 2),
        ((0.0, 0.0, moment), moment * length**2 / 2, moment * length),
    ]:
        q = zero.copy()
        q[1:] = np.linalg.solve(K, -arm.inverse_dynamics(rest, zero, zero, load)[1:])
        np.testing.assert_allclose(
            arm.nodal(q)[0][-1], [deflection / rigidity, slope / rigidity], rtol=1e-11
        )


def test_slow_loading_ends_in_the_static_shape():
    """The same sag by simulation: gravity acts on a damped arm with stiff joints."""
    link = fa.Link(
        length=1.0,
        flexural_rigidity=50.0,
        mass_per_length=0.5,
        elements=1,
        damping=fa.ModalDamping(ratio=0.7),
    )
    hub = 1e9  # practically locked: it turns by 1e-9 in this time
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=hub)], gravity=(0.0, -9.81))
    result = fa.simulate(arm, 3.0, rate=10.0, rtol=1e-10, atol=1e-13)
    weight = 0.5 * 9.81
    sag = weight / (8 * 50.0)
    # Vibrations have decayed by exp(-0.7 * 35 * 3); the hub's rotation turns gravity by 1e-8.
    assert result.link_tip_deflection.values[-1, 0] == pytest.approx(-sag, rel=1e-6)
    assert result.link_tip_slope.values[-1, 0] == pytest.approx(-weight / (6 * 50.0), rel=1e-6)
