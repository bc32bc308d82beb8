"""Metrics of runs, and tables of them."""

import numpy as np
import pytest

import flexarm as fa
from arms import two_rods
from controllers import Plain
from flexarm.simulation.calls.metrics import METRICS, metrics_of, tip_reference


@pytest.fixture(scope="module")
def arm():
    return two_rods()


@pytest.fixture(scope="module")
def motion(arm):
    return fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3, start_time=0.1)


def gains(factor=1.0):
    return fa.JointPD([20.0 * factor, 8.0 * factor], [2.0, 0.8])


def test_metrics_of_a_synthetic_run(arm, motion):
    """The tip has an error of 3 mm in x and vibrates by 2 mm in y; joint 1 lags by 1 mrad."""
    result = fa.simulate(arm, 0.8, rate=1000.0, controller=gains(), reference=motion).copy(
        deep=True
    )
    t = result.time.values
    vibration = 2e-3 * np.sin(2 * np.pi * 50.0 * (t - 0.4))
    wanted = motion.tip(t)
    result["tip"].values[:] = wanted + np.stack([np.full_like(t, 3e-3), vibration], axis=1)
    result["joint_angle"].values[:] = motion.joint_angle(t) - [1e-3, 0.0]
    result["torque"].values[:] = [3.0, -4.0]
    result.attrs |= {"controller_calls": 4, "controller_seconds": 1e-5}
    found = metrics_of(result, arm, motion)
    assert set(found) == {metric.name for metric in METRICS}
    # The motion lasts sixteen whole periods of the sine and one more sample.
    assert found["tip_error_rms"] == pytest.approx(np.sqrt(9e-6 + 2e-6), rel=1e-2)
    assert found["tip_error_peak"] == pytest.approx(np.hypot(3e-3, 2e-3), rel=1e-6)
    assert found["tip_error_settled"] == pytest.approx(3e-3, rel=1e-3)
    assert found["residual_vibration"] == pytest.approx(2e-3, rel=1e-2)
    assert found["joint_error_rms"] == pytest.approx(1e-3, rel=1e-9)
    assert found["torque_rms"] == pytest.approx(5.0)
    assert found["torque_peak"] == 4.0
    assert found["controller_time"] == pytest.approx(2.5e-6)
    assert found["torque_activity"] == 0.0
    assert np.isnan(found["force_error_rms"])
    # Torques that jump between their limits, and one that rises steadily, over 800 intervals.
    result["torque"].values[:] = np.stack([3.0 * (-1.0) ** np.arange(t.size), t], axis=1)
    busy = metrics_of(result, arm, motion)["torque_activity"]
    assert busy == pytest.approx((6.0 + 0.8 / 800) / (6.0 + 0.8))
    # Vibration more than a second later does not count.
    result["tip"].values[t < 0.7, 1] += 0.1
    late = metrics_of(result, arm, motion, settling=0.3)
    assert late["residual_vibration"] == pytest.approx(2e-3, rel=1e-2)


def test_any_object_with_joint_functions_is_a_reference(arm, motion):
    class Plain:
        joint_angle, joint_rate = motion.joint_angle, motion.joint_rate
        joint_acceleration = motion.joint_acceleration

    times = np.linspace(0.0, 0.5, 7)
    np.testing.assert_allclose(
        tip_reference(arm, Plain(), times), motion.tip(times), rtol=0, atol=1e-14
    )
    result = fa.simulate(
        arm, 0.5, controller=gains(), reference=Plain(), initial=arm.rest([0.2, -0.4])
    )
    found = metrics_of(result, arm, Plain())
    assert found["tip_error_rms"] > 0.0
    assert np.isnan(found["residual_vibration"])  # without an end time


def test_table_has_every_combination(arm, motion):
    heavy = fa.Arm(links=arm.spec.links, joints=arm.spec.joints, payload=fa.Payload(mass=0.3))
    back = fa.joint_motion(arm, [0.9, 0.5], [0.2, -0.4], 0.3)
    table = fa.compare(
        arm,
        {"soft": gains(0.5), "stiff": gains()},
        0.6,
        {"there": motion, "back": back},
        {"nominal": arm, "heavy": heavy},
        rate=200.0,
    )
    assert table.sizes == {"controller": 2, "plant": 2, "reference": 2}
    for metric in METRICS:
        assert table[metric.name].attrs == {"units": metric.unit, "long_name": metric.meaning}
    short = fa.compare(arm, {"soft": gains(0.5)}, 0.2, {"back": back}, rate=200.0)
    assert np.isnan(short.residual_vibration.item())
    for name in ("residual_vibration", "tip_error_settled"):
        assert "extend the duration" in short[name].attrs["comment"]
    assert "comment" not in short.tip_error_rms.attrs
    alone = fa.simulate(arm, 0.6, controller=gains(0.5), reference=back, plant=heavy, rate=200.0)
    one = table.sel(controller="soft", plant="heavy", reference="back")
    for name, value in metrics_of(alone, arm, back).items():
        if name != "controller_time":
            assert one[name].item() == pytest.approx(value, rel=1e-12, nan_ok=True)
    assert (table.failure == "").all()
    assert (
        table.tip_error_rms.sel(controller="stiff") < table.tip_error_rms.sel(controller="soft")
    ).all()


@pytest.mark.thorough
def test_load_on_one_plant_moves_a_joint_by_its_torque_over_the_gain():
    """At rest gain times angle is the moment of the force, and the link bends by F L^3 / 3 EI.

    The gain of computed torque is the rigid inertia times its frequency squared. If the controller
    knew the force, it would compensate it and the error would be smaller.
    """
    length, rigidity, force, goal = 1.0, 60.0, 1.5, 0.3
    link = fa.Link(
        length=length,
        flexural_rigidity=rigidity,
        mass_per_length=0.5,
        elements=1,
        damping=fa.ModalDamping(ratio=0.1),
    )
    held = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.2)])
    move = fa.joint_motion(held, [0.0], [goal], 0.5)
    frequency_hz, inertia = 0.8, 0.5 * length**3 / 3.0 + 0.2
    gain = {"PD": 12.0, "computed torque": inertia * (2.0 * np.pi * frequency_hz) ** 2}
    controllers = {
        "PD": fa.JointPD([gain["PD"]], [4.0]),
        "computed torque": fa.ComputedTorque(held, frequency_hz),
    }
    push = fa.Load(1, (0.0, force))
    plants = {"free": held, "pushed": (held, [push])}
    options = {"settling": 7.0, "rate": 20.0}
    table = fa.compare(held, controllers, 8.0, {"move": move}, plants, **options)
    for name, stiffness in gain.items():
        turned = goal
        for _ in range(60):  # a contraction, because the moment changes little with the angle
            bent = force * np.cos(turned) * length**3 / (3.0 * rigidity)
            moment = force * (length * np.cos(turned) - bent * np.sin(turned))
            turned = goal + moment / stiffness
        along, across = np.array([[1, 1j], [1j, -1]]) @ [np.cos(turned), np.sin(turned)]
        missed = abs(length * along + bent * across - length * np.exp(1j * goal))
        of_one = table.sel(controller=name)
        # After 7 s the remaining motion is below a millionth.
        assert of_one.tip_error_settled.sel(plant="pushed").item() == pytest.approx(
            missed, rel=1e-5
        )
        assert of_one.tip_error_settled.sel(plant="free").item() < 1e-6
    # Loads on all plants and on one plant are added.
    back = fa.compare(
        held, controllers, 8.0, {"move": move}, plants, loads=[fa.Load(1, (0.0, -force))], **options
    )
    assert (back.tip_error_settled.sel(plant="pushed") < 1e-6).all()
    assert (back.tip_error_settled.sel(plant="free") > 0.1).all()


@pytest.mark.parametrize(
    "wrong", [3, (3, []), "arm", ("arm", [3]), ("arm", fa.Load(1, (0.0, 1.0))), ("arm", [], [])]
)
def test_plant_is_an_arm_or_an_arm_with_loads(arm, motion, wrong):
    if isinstance(wrong, tuple) and wrong[0] == "arm":
        wrong = (arm, *wrong[1:])
    words = r"plants\['pushed'\] must be an Arm, or a pair of an Arm and a list of Load and Change"
    with pytest.raises(fa.InputError, match=words):
        fa.compare(arm, {"pd": gains()}, 0.1, {"move": motion}, {"pushed": wrong})


def test_noise_is_the_same_for_all_controllers_and_in_repeated_calls(arm, motion):
    hardware = fa.Hardware([fa.Instrument("joint_angle", noise=1e-3, rate_cutoff=50.0)], seed=5)
    tables = [
        fa.compare(arm, {"a": gains(), "b": gains()}, 0.5, {"move": motion}, hardware=hardware)
        for _ in range(2)
    ]
    np.testing.assert_array_equal(tables[0].tip_error_rms, tables[1].tip_error_rms)
    a, b = tables[0].tip_error_rms.values.ravel()
    assert a == b > 0.0


def test_failed_run_is_reported_and_the_others_continue(arm, motion):
    broken = Plain(lambda t, measurement, reference: [np.nan if t > 0.1 else 0.0, 0.0])
    table = fa.compare(arm, {"broken": broken, "pd": gains()}, 0.5, {"move": motion})
    assert "torque[0] must be finite" in table.failure.sel(controller="broken").item()
    assert "t = 0.11 s" in table.failure.sel(controller="broken").item()
    assert np.isnan(table.tip_error_peak.sel(controller="broken")).all()
    assert np.isfinite(table.tip_error_peak.sel(controller="pd")).all()


def test_rejected_run_does_not_lose_the_others(arm, motion):
    controllers = {"one": gains(), "other": fa.ComputedTorque(arm, 1.0)}
    three = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)] * 3)
    controllers["misfit"] = fa.ComputedTorque(three, 1.0)
    table = fa.compare(arm, controllers, 0.2, {"line": motion})
    assert table.failure.values[:2].ravel().tolist() == ["", ""]
    assert "is for 3 joints" in table.failure.sel(controller="misfit").item()
    first = {"misfit": controllers["misfit"], "one": controllers["one"]}
    with pytest.raises(fa.InputError, match="is for 3 joints"):
        fa.compare(arm, first, 0.2, {"line": motion})


def test_runs_that_an_event_ends_have_no_metrics(arm, motion):
    early = fa.joint_event(arm, 1, 0.4, terminal=True)
    table = fa.compare(arm, {"pd": gains()}, 0.5, {"move": motion}, events=[early])
    assert table.failure.item().startswith("ended by the event")
    assert np.isnan(table.tip_error_rms.item())


def test_diverging_loop_is_stopped(arm, motion):
    """Rates are fed back with the wrong sign: the linear theory would bend the links by
    kilometres."""

    class Unstable(fa.Controller):
        sample_time = 0.002

        def update(self, t, measurement, reference):
            return 0.3 * measurement.joint_rate - 20.0 * measurement.joint_angle

    with pytest.raises(
        fa.SimulationError, match=r"times its length: the loop is unstable"
    ) as caught:
        fa.simulate(arm, 30.0, controller=Unstable(), initial=arm.rest([0.2, -0.1]))
    assert caught.value.result is not None
    stopped = caught.value.time
    assert stopped < 30.0
    # Every sample is checked, also the last one, so that a run that ends there is stopped, too.
    with pytest.raises(fa.SimulationError, match="times its length") as caught:
        fa.simulate(arm, stopped, controller=Unstable(), initial=arm.rest([0.2, -0.1]))
    assert caught.value.time == pytest.approx(stopped)
