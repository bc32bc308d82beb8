"""Friction with bristles in other calls than single runs, and the calls that refuse them."""

import copy

import numpy as np
import pytest

import flexarm as fa
from bristled_joints import NUMBERS, RUBBING, turning
from flexarm.base.errors import AccuracyWarning, InputError


def test_plant_keeps_the_deflection():
    """A plant and its copy continue as the run with the same zero-order-hold torques."""
    torques = np.array([[0.7], [0.5], [-0.7], [-0.4]])
    whole = fa.simulate(
        turning(), 0.08, torque=np.repeat(torques, 20, axis=0), torque_interpolation="hold",
        rate=1000.0,
    )  # fmt: skip
    plant = fa.Plant(turning(), sample_time=0.02)
    for torque in torques[:2]:
        plant.step(torque)
    other = copy.deepcopy(plant)
    for torque in torques[2:]:
        plant.step(torque)
        other.step(torque)
    assert other.q[0] == plant.q[0]
    assert plant.q[0] == pytest.approx(whole.joint_angle.values[-1, 0], abs=1e-9)
    assert abs(plant.q[0]) > 1e-4


def test_batch_runs_alone():
    arm = turning()
    torque = np.full((21, 1), 0.6)
    channels = ["joint_angle", "bristle_deflection"]
    plain = turning(numbers={"coulomb": 0.5})
    batch = fa.simulate_batch([plain, arm], 0.2, torque=torque, rate=100.0, channels=channels)
    single = fa.simulate(arm, 0.2, torque=torque, rate=100.0)
    for name in channels:
        assert (batch[name].values[1] == single[name].values).all(), name


def test_event_and_change_keep_the_deflection():
    """After a change at an event the joint still holds the torque of its bristles."""
    event = fa.Event(lambda t, q, qd: t - 0.5, "half")
    result = fa.simulate(
        turning(), 1.0, torque=[[0.5]] * 101, rate=100.0, events=[event],
        changes=[fa.Change("joints[0].friction.viscous", at="half", to=0.2)],
    )  # fmt: skip
    assert np.ptp(result.joint_angle.values[48:, 0]) < 1e-8


def test_change_of_the_bristles_stiffness_changes_their_energy():
    """The deflection remains, so the energy of a held joint grows with the stiffness."""
    change = fa.Change("joints[0].friction.bristle_stiffness", at=0.5, to=1e4)
    result = fa.simulate(turning(), 1.0, torque=[[0.5]] * 101, rate=100.0, changes=[change])
    before = result.sel(time=0.49).strain_energy.item()
    assert before == pytest.approx(0.5 * 0.5**2 / 5000.0, rel=0.05)  # the torque over the stiffness
    np.testing.assert_allclose(result.change_energy, [before], rtol=0.05)


def test_functions_of_q_and_qd_warn_once_for_all_joints():
    joint = fa.Joint(hub_inertia=0.1, friction=fa.Friction(**NUMBERS))
    arm = fa.Arm(
        links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)] * 2, joints=[joint] * 2
    )
    for call in (lambda: fa.modes(arm, [0.1, 0.2], joints="free"), lambda: fa.linearize(arm)):
        with pytest.warns(AccuracyWarning) as found:
            call()
        assert [str(one.message).split(":")[0] for one in found] == ["arm.joints[0], arm.joints[1]"]
    with pytest.raises(InputError, match="the separation cannot be combined with bristles"):
        fa.simulate_separated(arm, fa.joint_motion(arm, [0.0, 0.5], [0.2, 0.6], 1.0))


def test_derivatives_by_the_numbers_of_bristles():
    numbers = RUBBING
    torque = 1.5 * np.sin(2.0 * np.pi * np.linspace(0.0, 0.5, 51))[:, None]
    options = {"torque": torque, "rate": 100.0, "rtol": 1e-9, "atol": 1e-12}
    keys = "bristle_stiffness", "bristle_damping", "viscous"
    paths = [f"joints[0].friction.{key}" for key in keys]
    found = fa.sensitivities(
        turning(numbers=numbers), 0.5, parameters=paths, channels=["joint_angle"], **options
    )
    for path, key in zip(paths, keys, strict=True):
        step = 1e-3 * numbers[key]
        ends = [
            fa.simulate(turning(numbers={**numbers, key: numbers[key] + side}), 0.5, **options)
            for side in (step, -step)
        ]
        slope = (ends[0].joint_angle - ends[1].joint_angle).values / (2.0 * step)
        exact = found.joint_angle.sel(parameter=path).values
        # Central differences: 1e-6 of the third derivative, and errors of the runs over the step.
        assert np.abs(exact - slope).max() < 1e-3 * np.abs(slope).max() + 1e-9 / step


def test_derivatives_of_the_deflection_are_refused():
    """The message does not take a channel that exists for a spelling error."""
    with pytest.raises(InputError) as refused:
        fa.sensitivities(
            turning(), 0.1, ["joints[0].friction.coulomb"], channels=["bristle_deflection"]
        )
    text = str(refused.value)
    assert "must be a channel that follows from q and qd, got 'bristle_deflection'" in text
    assert "Known: joint_angle" in text


@pytest.mark.thorough
def test_identification_of_bristles():
    """The numbers of a record with noise of a microradian, from starting values 30 % too small."""
    true = {**RUBBING, "bristle_stiffness": 2000.0}
    times = np.arange(501) / 500.0
    torque = 0.9 * np.sin(3.0 * np.pi * times) + 0.4 * np.sin(20.0 * times)
    options = {"rate": 500.0, "torque_interpolation": "hold"}
    data = fa.simulate(turning(numbers=true), 1.0, torque=torque[:, None], **options)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(data.joint_angle.shape)
    data["joint_angle"] = data.joint_angle + noise
    record = fa.MeasuredRecord(data, interpolation="hold", outputs=["joint_angle"])
    keys = "bristle_stiffness", "bristle_damping"
    start = {**true, **{key: 0.7 * true[key] for key in keys}}
    free = [f"joints[0].friction.{key}" for key in keys]
    found = fa.identify(turning(numbers=start), {"bench": record}, free, progress=False)
    for path, key in zip(free, keys, strict=True):
        assert found[path] == pytest.approx(true[key], rel=5e-3)
    with pytest.raises(InputError, match="'prediction_error' cannot be combined with bristles"):
        fa.identify(turning(), {"bench": record}, free, method="prediction_error")


def test_functions_of_the_rate_have_the_steady_state():
    """Inverse dynamics and linear models have the friction without bristles, with a warning."""
    arm = turning()
    plain = turning(numbers={**NUMBERS, "bristle_damping": 0.0, "bristle_stiffness": None})
    for rate in (0.02, -1.0):
        assert arm.inverse_dynamics([0.1], [rate], [0.0]) == plain.inverse_dynamics(
            [0.1], [rate], [0.0]
        )
    with pytest.warns(AccuracyWarning, match="Bristles"):
        model = fa.linearize(arm, [0.0])
    with pytest.warns(fa.FlexarmWarning, match="friction holds"):
        assert (model.A == fa.linearize(plain, [0.0]).A).all()


def test_contradictory_numbers():
    with pytest.raises(InputError, match="requires bristle_stiffness"):
        fa.Friction(coulomb=0.5, bristle_damping=1.0)
    for zero in ("coulomb", "coulomb_negative"):
        with pytest.raises(InputError, match=f"{zero} must be positive with bristles"):
            fa.Friction(**{"coulomb": 0.5, zero: 0.0}, bristle_stiffness=1e3)
