"""Drive trains of joints: motors driven by a voltage, and backlash of elastic gears."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.model import Scenario, StudySpec
from flexarm.model.paths import with_number

WINDING = fa.Winding(torque_constant=0.04, resistance=1.5)
RATIO, ROTOR = 80.0, 2e-5


def bar(inertia, **joint):
    """A rigid link of a given inertia about its joint."""
    link = fa.Link(length=1.0, mass_per_length=3.0 * inertia, flexible=False)
    return fa.Arm(links=[link], joints=[fa.Joint(**joint)])


def motor(**joint):
    return bar(0.3, rotor_inertia=ROTOR, gear_ratio=RATIO, winding=WINDING, **joint)


def test_step_of_the_voltage():
    """Steady speed V / (r K) and time constant J R / (r K)^2, in closed form."""
    arm, volts = motor(), 12.0
    result = fa.simulate(arm, 0.4, torque=lambda t: arm.motor_torque([volts]), rate=100.0)
    inertia = 0.3 + RATIO**2 * ROTOR
    constant = inertia * 1.5 / (RATIO * 0.04) ** 2
    speed = volts / (RATIO * 0.04) * (1.0 - np.exp(-result.time.values / constant))
    # The default tolerance of a run of a second is about 1e-6 m of the tip, which is at 1 m.
    np.testing.assert_allclose(result.joint_rate.values[:, 0], speed, rtol=0, atol=1e-6 * 3.75)


def test_torque_of_a_motor():
    arm = motor()
    gain = RATIO * 0.04 / 1.5
    assert arm.motor_torque([6.0])[0] == pytest.approx(gain * 6.0)
    at_rate = arm.motor_torque([[6.0], [0.0]], [[1.0], [-1.0]])[:, 0]
    assert at_rate == pytest.approx(gain * np.array([6.0 - RATIO * 0.04, RATIO * 0.04]))
    no_load = 6.0 / (RATIO * 0.04)
    assert arm.motor_torque([6.0], [no_load])[0] == pytest.approx(0.0, abs=1e-12)


def test_motors_at_some_of_the_joints():
    link = fa.Link(length=1.0, flexible=False, mass_per_length=0.9)
    joints = [fa.Joint(), fa.Joint(rotor_inertia=ROTOR, gear_ratio=RATIO, winding=WINDING)]
    arm = fa.Arm(links=[link, link], joints=joints)
    gain = RATIO * 0.04 / 1.5
    np.testing.assert_allclose(arm.motor_torque([[0.0, 6.0]]), [[0.0, gain * 6.0]], rtol=1e-14)
    with pytest.raises(InputError, match=r"arm\.joints\[0\] has no winding, so its voltage must"):
        arm.motor_torque([1.0, 6.0])


def test_voltages_are_inputs_of_linear_models():
    """The response at low frequency is the speed per voltage 1 / (r K) over i omega."""
    arm = motor()
    model = fa.linearize(arm, inputs=["voltage"], outputs=["joint_angle"])
    assert model.inputs == ("voltage[1]",)
    assert model.units["voltage[1]"] == "V"
    omega = 1e-3
    response = model.frequency_response(omega)
    assert response.shape == (1, 1)
    constant = (0.3 + RATIO**2 * ROTOR) * 1.5 / (RATIO * 0.04) ** 2
    expected = 1.0 / (RATIO * 0.04) / (1j * omega * (1.0 + 1j * omega * constant))
    np.testing.assert_allclose(response, [[expected]], rtol=1e-9)
    assert np.array_equal(model.frequency_response([omega, 1.0])[0], response)
    with pytest.raises(InputError, match="contain voltage, but no joint has a winding"):
        fa.linearize(bar(0.3), inputs=["voltage"])


def in_volts(**changes):
    """A scenario of the motor under 12 V for 0.6 s, in which it reaches its steady rate."""
    samples = {"rate": 10.0, "interpolation": "hold", "values": [[12.0]] * 7}
    drive = {"kind": "torque", "quantity": "voltage", **samples}
    return {"arm": motor().spec, "drive": drive, "run": {"duration": 0.6}, **changes}


def studied(**changes):
    """A study of the same run."""
    given = in_volts(**changes)
    drives = {"volts": given.pop("drive")}
    motion = {"kind": "joint", "start": [0.0], "end": [0.5], "duration": 0.5}
    return {**given, "drives": drives, "motions": {"turn": motion}}


def test_sampled_winding_and_gear_convert_the_voltage():
    """The torque at standstill is that of the simulated motor, in a batch and in a single run."""
    numbers = {
        "joints[0].winding.resistance": {"kind": "values", "values": [1.5, 6.0]},
        "joints[0].gear_ratio": {"kind": "values", "values": [80.0, 40.0]},
    }
    study = studied(vary=numbers, samples={"method": "grid"})
    found = fa.Study(study).run(workers=1)
    resistance, ratio = (found[path].values for path in numbers)
    wanted = 12.0 * ratio * 0.04 / resistance
    # Not exact, because the torque is scaled by the ratio of two motors.
    assert len(wanted) == 4
    np.testing.assert_allclose(found.torque_peak.values.squeeze(), wanted, rtol=1e-12)
    other = fa.Arm(with_number(motor().spec, "joints[0].winding.resistance", 6.0))
    prepared = PreparedStudy(StudySpec(**study))
    one, _ = prepared.one("volts", "as believed", "turn", other, rate=100.0)
    alone = fa.simulate(other, 0.6, torque=lambda t: other.motor_torque([12.0]), rate=100.0)
    # The default tolerance of a run of a second is about 1e-6 m of the tip, which is at 1 m.
    np.testing.assert_allclose(one.joint_angle, alone.joint_angle, rtol=0, atol=1e-6)


@pytest.mark.parametrize("path", ["joints[0].winding.resistance", "joints[0].gear_ratio"])
def test_motors_driven_by_a_voltage_do_not_change(path):
    change = {"path": path, "at": 0.3, "to": 3.0}
    rule = r"changes\[0\]\.path cannot be combined with a drive with quantity: voltage"
    with pytest.raises(InputError, match=rule):
        Scenario(**in_volts(changes=[change]))
    with pytest.raises(InputError, match=r"plants\.changed\." + rule):
        StudySpec(**studied(plants={"changed": {"changes": [change]}}))
    rubs = {"path": "joints[0].damping", "at": 0.3, "to": 3.0}
    assert Scenario(**in_volts(changes=[rubs])).changes


def test_voltage_without_a_winding():
    rule = r"\.quantity voltage is not supported without arm\.joints\[0\]\.winding"
    with pytest.raises(InputError, match="drive" + rule):
        Scenario(**in_volts(arm=bar(0.3).spec))
    with pytest.raises(InputError, match=r"drives\.volts" + rule):
        StudySpec(**studied(arm=bar(0.3).spec))
    link, joint = motor().spec.links[0], motor().spec.joints[0]
    arm = fa.Arm(links=[link, link], joints=[joint, fa.Joint(fixed=True)])
    assert Scenario(**in_volts(arm=arm.spec)).arm.joints[1].fixed


def test_linear_model_has_the_pole_of_the_motor():
    arm = motor()
    poles = np.linalg.eigvals(fa.linearize(arm).A)
    inertia = 0.3 + RATIO**2 * ROTOR
    assert min(poles.real) == pytest.approx(-((RATIO * 0.04) ** 2) / (1.5 * inertia), rel=1e-9)


def test_voltage_in_a_file(tmp_path):
    (tmp_path / "motor.yaml").write_text(
        "flexarm: 1\n"
        "arm:\n"
        "  links: [{length: 1.0, mass_per_length: 0.9, flexible: false}]\n"
        "  joints:\n"
        "    - rotor_inertia: 2.0e-5\n"
        "      gear_ratio: 80\n"
        "      winding: {torque_constant: 0.04, resistance: 1.5}\n"
        "drive: {kind: torque, quantity: voltage, rate: 10, interpolation: hold,\n"
        "        values: [[12.0], [12.0], [-6.0]]}\n"
        "run: {duration: 0.3}\n"
    )
    found = fa.run_scenario(tmp_path / "motor.yaml")
    gain = RATIO * 0.04 / 1.5
    assert found.torque.values[0, 0] == pytest.approx(12.0 * gain)
    assert found.torque.values[-1, 0] == pytest.approx(-6.0 * gain)
    constant = (0.3 + RATIO**2 * ROTOR) * 1.5 / (RATIO * 0.04) ** 2
    rate = found.joint_rate.sel(time=0.2, method="nearest")
    assert rate[0] == pytest.approx(3.75 * (1.0 - np.exp(-0.2 / constant)), abs=4e-6)


def gap(x, backlash):
    """Return the twist of the spring beyond a dead zone."""
    return np.sign(x) * max(0.0, abs(x) - 0.5 * backlash)


def test_backlash_against_scipy():
    """Two inertias on a spring with a dead zone; the motor is shaken through it."""
    inertia, rotor, k, d, backlash = 0.2, 0.15, 800.0, 0.3, 0.02
    arm = bar(inertia, rotor_inertia=rotor, stiffness=k, damping=d, backlash=backlash)

    def torque(t):
        return 3.0 * np.sin(15.0 * t)

    def rates(t, y):
        moment = -k * gap(y[1], backlash) - d * y[3]
        motor = (torque(t) - moment) / rotor
        return [y[2], y[3], motor, moment / inertia - motor]

    result = fa.simulate(arm, 1.5, torque=lambda t: [torque(t)], rate=100.0)
    times = result.time.values
    # Short steps, because no method keeps its order across the corners of the dead zone.
    exact = solve_ivp(
        rates, (0.0, 1.5), np.zeros(4), "DOP853", times, rtol=1e-10, atol=1e-12, max_step=1e-3
    ).y
    assert np.abs(exact[1]).max() > 0.6 * backlash  # beyond both ends of the dead zone
    # Stops repeat the run at tolerances of 1e-12; the rest are SciPy's corners, 1e-8.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], exact[0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.joint_twist.values[:, 0], exact[1], rtol=0, atol=1e-7)


def test_describing_function_of_the_backlash():
    """The mean stiffness over a sine of the twist is that of the dead zone's describing function.

    N(A) = k (1 - 2/pi (asin z + z sqrt(1 - z^2))), z = b / (2 A) (Gelb and Vander Velde,
    Multiple-input describing functions, 1968, table in appendix B).
    """
    k, backlash, amplitude = 800.0, 0.02, 0.025
    arm = bar(0.2, rotor_inertia=0.15, stiffness=k, backlash=backlash)
    phase = 2.0 * np.pi * (np.arange(4000) + 0.5) / 4000
    force = [arm.bias_force([0.0, amplitude * np.sin(x)], [0.0, 0.0])[1] for x in phase]
    found = 2.0 * np.mean(force * np.sin(phase)) / amplitude
    z = 0.5 * backlash / amplitude
    exact = k * (1.0 - 2.0 / np.pi * (np.arcsin(z) + z * np.sqrt(1.0 - z * z)))
    assert found == pytest.approx(exact, rel=1e-5)  # the rule of 4,000 points at two corners


def test_weight_presses_the_gear_against_one_side():
    k, backlash = 800.0, 0.02
    arm = bar(0.2, rotor_inertia=0.15, stiffness=k, backlash=backlash)
    arm = fa.Arm(arm.spec.replace(gravity=(0.0, -9.81)))
    found = fa.equilibrium(arm, [0.3])
    weight = 0.6 * 9.81 * 0.5 * np.cos(0.3 + found.q[1])
    assert found.q[1] == pytest.approx(-0.5 * backlash - weight / k, rel=1e-9)
    assert found.torque[0] == pytest.approx(weight, rel=1e-9)
    pressed = fa.modes(arm, found, joints="locked").frequency_hz[0]
    turned = 0.6 * 9.81 * 0.5 * np.sin(0.3 + found.q[1])
    assert pressed == pytest.approx(np.sqrt((k - turned) / 0.2) / (2 * np.pi), rel=1e-6)


def test_rigid_model_has_no_backlash():
    arm = bar(0.2, rotor_inertia=0.15, stiffness=800.0, backlash=0.02)
    assert arm.rigid().spec.joints[0].backlash == 0.0


def test_derivatives_by_the_numbers_of_a_drive():
    """Derivatives of a run against central differences; the gear stays on one side."""
    numbers = {"rotor_inertia": 0.15, "stiffness": 800.0, "damping": 2.0, "backlash": 0.02}
    winding = fa.Winding(torque_constant=0.4, resistance=1.5)
    arm = bar(0.2, winding=winding, **numbers)
    paths = ["joints[0].backlash", "joints[0].winding.resistance"]
    start = arm.rest([0.0])
    start[1] = -0.012

    def run(arm):
        return fa.simulate(
            arm, 0.05, torque=lambda t: [4.0], initial=start, rate=100.0,
            integrator="dormand_prince_8", rtol=1e-11, atol=1e-13,
        )  # fmt: skip

    found = fa.sensitivities(
        arm, 0.05, parameters=paths, torque=lambda t: [4.0], initial=start, rate=100.0,
        integrator="dormand_prince_8", rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    for path, value in zip(paths, (0.02, 1.5), strict=True):
        step = 1e-4 * value
        above, below = (run(fa.Arm(with_number(arm.spec, path, value + s))) for s in (step, -step))
        slope = (above.joint_twist - below.joint_twist).values[-1, 0] / (2.0 * step)
        exact = found.joint_twist.sel(parameter=path).values[-1].item()
        assert exact == pytest.approx(slope, rel=1e-4), path


@pytest.mark.parametrize("backlash", [0.0, 0.01])
def test_batches_give_the_numbers_of_single_runs(backlash):
    """Lanes compute the arm without backlash, which is a pair of stops that they do not support."""
    rubs = fa.Friction(coulomb=0.3, viscous=0.05, coulomb_negative=0.5, viscous_negative=0.1)
    gear = {"rotor_inertia": ROTOR, "gear_ratio": RATIO, "stiffness": 900.0, "damping": 1.0}
    joint = fa.Joint(winding=WINDING, friction=rubs, backlash=backlash, **gear)
    beam = {"flexural_rigidity": 20.0, "mass_per_length": 0.4, "modes": 2}
    arm = fa.Arm(links=[fa.Link(length=0.8, hub_radius=0.1, **beam)], joints=[joint])
    starts = [arm.rest([angle]) for angle in (-0.2, 0.0, 0.3)]
    torque = arm.motor_torque(12.0 * np.sin(np.arange(41))[:, None])
    batch = fa.simulate_batch(arm, 0.1, initial=starts, torque=torque, rate=400.0)
    for k, start in enumerate(starts):
        one = fa.simulate(arm, 0.1, initial=start, torque=torque, rate=400.0)
        np.testing.assert_array_equal(batch.tip.values[k], one.tip.values)


def test_linear_model_between_the_contacts_is_reported():
    """No spring acts there, so a design for it would not be one of the arm."""
    arm = bar(0.2, rotor_inertia=0.15, stiffness=800.0, backlash=0.02)
    for function in (fa.modes, fa.linearize):
        with pytest.warns(fa.FlexarmWarning, match=r"joints\[0\]: between the contacts"):
            function(arm)
    pressed = np.array([0.0, 0.015])
    assert fa.modes(arm, q=pressed).frequency_hz[-1] > 0.0  # on a contact, without a warning
