"""Integrators chosen by ``integrator="auto"``, and the accuracy of their results."""

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
START = (np.pi / 4, -np.pi / 2)


def table_one(elements, modes=None, **options):
    return table_one_arm(elements=elements, modes=modes, **options)


def torque(t):
    return np.array([4.0, 1.5]) * np.sin(2 * np.pi * t) if t <= 1.0 else np.zeros(2)


def run(arm, duration=0.3, **settings):
    return fa.simulate(
        arm,
        duration,
        torque=torque,
        initial=arm.rest(START),
        rate=100.0,
        progress=False,
        **settings,
    )


def apart(a, b):
    """Return the largest distance of the tips (m)."""
    return float(np.linalg.norm((a.tip - b.tip).values, axis=1).max())


@pytest.mark.parametrize(
    ("arm", "rtol", "wanted"),
    [
        (table_one(16, modes=3), 1e-7, "dormand_prince_8"),
        (table_one(16, modes=4), 1e-7, "dormand_prince_8"),
        (table_one(16), 1e-5, "kennedy_carpenter_5"),
        (table_one(32), 1e-7, "kennedy_carpenter_5"),
        (table_one(1).rigid(), 1e-4, "dormand_prince_8"),
    ],
    ids=["3 modes", "4 modes", "full mesh, loose", "full mesh", "rigid"],
)
def test_auto_depends_on_stiffness_and_tolerance(arm, rtol, wanted):
    result = run(arm, duration=0.01, rtol=rtol, atol=rtol / 100)
    assert result.integrator == wanted
    assert ("implicit" in result.integrator_reason) == (wanted != "dormand_prince_8")


def test_strong_damping_is_stiff():
    damped = fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=1.0)
    links = [fa.Link(length=1.0, elements=4, modes=4, damping=damped, **ROD)]
    arm = fa.Arm(links=links)
    result = fa.simulate(arm, 0.01, initial=arm.rest([0.1]), rate=100.0, progress=False)
    assert result.integrator == "kennedy_carpenter_5"


@pytest.mark.parametrize(
    ("smoothing_rate", "options", "wanted"),
    [
        (0.01, {}, "kennedy_carpenter_5"),
        (10.0, {}, "dormand_prince_8"),
        (0.1, {"rtol": 1e-12, "atol": 1e-14}, "dormand_prince_8"),
    ],
    ids=["steep", "flat", "tight tolerance"],
)
def test_steep_friction_is_stiff(smoothing_rate, options, wanted):
    joint = fa.Joint(friction=fa.Friction(coulomb=0.5, smoothing_rate=smoothing_rate))
    assert run(table_one(1, joints=[joint] * 2), 0.01, **options).integrator == wanted


def test_friction_of_prescribed_joints_does_not_decide():
    steep, flat = (
        fa.Joint(friction=fa.Friction(coulomb=0.5, smoothing_rate=rate)) for rate in (0.01, 10.0)
    )
    arm = table_one(1, joints=[steep, flat])
    still = fa.PrescribedAngle(*[lambda t: 0.0] * 3)
    assert run(arm, 0.3).integrator == "kennedy_carpenter_5"
    assert run(arm, 0.3, prescribed={1: still}).integrator == "dormand_prince_8"
    assert run(arm, 0.3, prescribed={2: still}).integrator == "kennedy_carpenter_5"
    batch = fa.simulate_batch(arm, 0.3, initial=np.zeros((1, arm.dof)), prescribed={1: still})
    assert batch.integrator.values.tolist() == ["dormand_prince_8"]


def test_stops_leave_only_very_steep_friction_to_an_implicit_method():
    """Runs through impacts are repeated with tolerances at which order 5 is expensive."""
    friction = fa.Friction(coulomb=0.5, smoothing_rate=0.1)
    limits = fa.JointLimits(lower=-3.0, upper=3.0, stiffness=1e4)
    free, stopped = (
        run(table_one(1, joints=[fa.Joint(friction=friction, limits=stops)] * 2), 0.3)
        for stops in (None, limits)
    )
    assert free.integrator == "kennedy_carpenter_5"
    assert stopped.integrator == "dormand_prince_8"


def test_friction_in_a_run_of_few_steps_leaves_the_explicit_method():
    """The same arm as above: what counts is the friction over the run, whatever the unit."""
    joint = fa.Joint(friction=fa.Friction(coulomb=0.5, smoothing_rate=0.1))
    assert run(table_one(1, joints=[joint] * 2), 0.01).integrator == "dormand_prince_8"


def test_number_of_steps_of_a_full_mesh_does_not_grow_with_refinement():
    """The explicit method's steps would double twice from 8 to 16 elements."""
    steps = [
        run(table_one(n), integrator="kennedy_carpenter_5", rtol=1e-5, atol=1e-7).steps
        for n in (8, 16, 32)
    ]
    assert max(steps) < 1.5 * min(steps)


@pytest.mark.thorough_cases("32")
@pytest.mark.parametrize("elements", [8, 32])
def test_default_tolerances_on_a_full_mesh(elements):
    """1e-6 of the reach, against a run with a tenth of the tolerance."""
    arm = table_one(elements)
    assert apart(run(arm), run(arm, rtol=1e-8, atol=1e-10)) < 1e-6 * 2.4142


def test_cowell_conserves_the_energy_of_a_vibration():
    """Small vibrations for 20 s, 700 periods of the slowest mode; rk4 needs twice the
    evaluations."""
    arm = fa.Arm(links=[fa.Link(length=1.0, elements=2, modes=2, **ROD)])
    start = arm.from_nodal([0.0], [[[0.00004, 0.0001], [0.0001, 0.00014]]])

    def kept(integrator, step):
        result = fa.simulate(
            arm, 20.0, initial=start, integrator=integrator, step=step, rate=10.0, progress=False
        )
        energy = (result.kinetic_energy + result.strain_energy).values
        return np.polyfit(result.time.values, energy, 1)[0] * 20.0 / energy[0]

    assert abs(kept("cowell_4", 5e-4)) < 2e-5
    assert kept("rk4", 1e-3) < -1e-2


def fixed(arm, step, **settings):
    return run(arm, rtol=1e-9, atol=1e-11, step=step, **settings)


def test_auto_with_a_step_chooses_rk4_where_it_is_stable():
    arm = table_one(2, modes=2)
    result = fixed(arm, 5e-4)
    assert (result.integrator, result.warning) == ("rk4", "")


def test_auto_with_a_step_too_long_for_rk4_warns_and_damps_fast_vibrations():
    arm = table_one(8)
    with pytest.raises(fa.SimulationError):
        run(arm, integrator="rk4", step=1e-3)
    with pytest.warns(fa.AccuracyWarning, match=r"at which rk4 is unstable.*halve it once"):
        result = fixed(arm, 1e-3)
    assert result.integrator == "generalized_alpha"
    assert "halve it once and compare" in result.warning
    named = run(arm, integrator="generalized_alpha", step=1e-3, rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(result.q, named.q)
    # Of order 2: a thousandth of the reach, where the explicit method diverges.
    assert apart(result, run(arm)) < 1e-3 * 2.4142


def sticking(modes=2):
    joint = fa.Joint(friction=fa.Friction(coulomb=0.5, static=0.8, smoothing_rate=1e-3))
    return table_one(2, modes=modes, joints=[joint] * 2)


TOO_LONG = r"too long for friction, .*: above 1\.6e-06 s, rk4 shakes a joint"


@pytest.mark.parametrize("how", [{}, {"integrator": "rk4"}], ids=["auto", "rk4"])
def test_fixed_step_too_long_for_friction_warns(how):
    """The loop of the step is bounded, unlike that of a vibration, but the motion is wrong."""
    arm = sticking()
    with pytest.warns(fa.AccuracyWarning, match=TOO_LONG):
        result = run(arm, step=1e-4, **how)
    assert "too long for friction" in result.warning
    assert apart(result, run(arm)) > 1e-4


def test_fixed_step_that_follows_friction_does_not_warn():
    arm = sticking().rigid()
    assert run(arm, step=1e-4).warning == ""
    assert run(arm, step=1e-3, integrator="kennedy_carpenter_5").warning == ""  # the first one


def test_friction_of_controlled_arms_and_plants_warns_of_a_fixed_step():
    arm = sticking()
    loop = {"controller": fa.JointPD([0.5, 0.5], [0.01, 0.01]), "progress": False}
    with pytest.warns(fa.AccuracyWarning, match=TOO_LONG):
        fa.simulate(arm, 0.01, step=1e-4, **loop)
    with pytest.warns(fa.FlexarmWarning, match="2 of 2 runs have warnings"):
        batch = fa.simulate_batch(arm, 0.01, initial=np.zeros((2, arm.dof)), step=1e-4, **loop)
    assert all("too long for friction" in text for text in batch.warning.values)
    with pytest.warns(fa.AccuracyWarning, match=TOO_LONG):
        fa.Plant(arm, step=1e-4)
    # Steps end at sample times, so a longer one is not taken.
    loop["controller"] = fa.JointPD([0.5, 0.5], [0.01, 0.01], sample_time=1e-4)
    assert fa.simulate(sticking().rigid(), 0.01, step=0.01, **loop).warning == ""


def test_friction_that_appears_during_a_run_warns_of_a_fixed_step():
    friction = fa.Friction(coulomb=0.01, smoothing_rate=0.01)
    arm = table_one(2, modes=2, joints=[fa.Joint(friction=friction)] * 2)
    change = fa.Change("joints[0].friction.coulomb", at=0.005, to=50.0)
    with pytest.warns(fa.AccuracyWarning, match="too long for friction"):
        run(arm, 0.01, step=1e-4, changes=[change])


def test_torque_that_truncates_the_steps_keeps_rk4():
    """Constant for 0.2 ms, whatever the step: the lengths of truncated steps decide."""
    arm = table_one(2, modes=2)
    samples = np.stack([torque(t) for t in np.arange(0.0, 0.05, 2e-4)])
    result = fa.simulate(
        arm, 0.05, torque=samples, torque_interpolation="hold", rate=5000.0, step=0.01
    )
    assert result.integrator == "rk4"
    assert result.steps >= 250


def test_closed_loop_keeps_rk4():
    """Its steps end at each sample time."""
    arm = table_one(2, modes=2)
    loop = fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=2e-4)
    motion = fa.joint_motion(arm, START, [0.5, -1.2], 0.02)
    result = fa.simulate(arm, 0.02, controller=loop, reference=motion, step=0.01)
    assert result.integrator == "rk4"


def _pulse(t):
    return np.exp(-(((t - 3.1) / 0.01) ** 2))


@pytest.mark.parametrize(
    "acting",
    [
        {"loads": [fa.Load(2, (0.0, 5.0), factor=_pulse)]},
        {"torque": np.outer(_pulse(np.arange(701) / 200.0), [8.0, 2.0])},
        {"base_acceleration": lambda t: (0.0, 50.0 * _pulse(t))},
    ],
)
@pytest.mark.parametrize("rigidity", [20.0, 1e8])
def test_a_late_pulse_on_an_arm_at_rest_is_not_passed_over(acting, rigidity):
    """Long steps of order 5 were cheap for an arm at rest, and it never moved."""
    link = fa.Link(length=1.0, flexural_rigidity=rigidity, mass_per_length=0.5, elements=2)
    arm = fa.Arm(links=[link, link], joints=[fa.Joint(hub_inertia=0.05)] * 2)
    run = {**acting, "rate": 200.0, "progress": False}
    exact = fa.simulate(arm, 3.5, rtol=1e-9, integrator="kennedy_carpenter_5", **run)
    result = fa.simulate(arm, 3.5, **run)
    assert np.ptp(exact.tip.values, axis=0).max() > 0.02
    np.testing.assert_allclose(result.tip, exact.tip, atol=2e-5)
    batch = fa.simulate_batch([arm], 3.5, **run)
    np.testing.assert_array_equal(batch.tip.values[0], result.tip.values)
