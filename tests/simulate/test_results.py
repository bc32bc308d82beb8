"""Results of a run: labels, units, attributes, exact times and files."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from arms import unit_link
from flexarm.simulation.run.channels import CHANNELS

#: Channels of runs with contacts; torque_command is that of closed loops.
CONTACT = ("contact_force", "contact_gap", "contact_energy")


@pytest.fixture(scope="module")
def arm():
    gauges = [fa.Gauge(station=0.05, distance=0.004), fa.Gauge(station=0.5, distance=-0.004)]
    links = [
        fa.Link(length=0.8, flexural_rigidity=30.0, mass_per_length=0.5, elements=2, gauges=gauges),
        fa.Link(length=0.5, mass_per_length=0.3, flexible=False),
        fa.Link(length=0.6, flexural_rigidity=20.0, mass_per_length=0.4, elements=2, modes=3),
    ]
    payload = fa.Payload(mass=0.2, inertia=0.001, offset=(0.03, -0.01))
    return fa.Arm(links=links, payload=payload, gravity=(1.0, -9.0), theory="second_order")


@pytest.fixture(scope="module")
def result(arm):
    return fa.simulate(
        arm,
        0.2,
        torque=lambda t: [4.0 * np.cos(5 * t), 1.0, -0.5 * t],
        initial=arm.rest([0.3, -0.2, 0.6]),
        initial_rate=arm.rest([0.5, 0.0, -0.5]),
        rate=500.0,
        stations=4,
    )


def test_every_channel_has_its_dimensions_units_and_description(result, arm):
    sizes = {"joint": 3, "link": 3, "axis": 2, "coordinate": arm.dof, "gauge": 2}
    sizes["station"] = 4
    absent = {"torque_command", "bristle_deflection", "closure_force", *CONTACT}
    absent |= {"base_position", "base_velocity"}
    assert set(result.data_vars) == set(CHANNELS) - absent
    for name in result.data_vars:
        channel, variable = CHANNELS[name], result[name]
        assert variable.dims == ("time", *channel.dims)
        assert variable.shape == (101, *(sizes[dim] for dim in channel.dims))
        assert variable.attrs == {"units": channel.unit, "long_name": channel.meaning}
        assert variable.dtype == np.float64
        assert np.all(np.isfinite(variable))


def test_every_arm_has_its_own_labels_and_values():
    """Results of arms with equal labels share them, so runs of different arms alternate here."""

    def arm(station, modes, segments):
        link = fa.Link(
            length=1.0,
            flexural_rigidity=20.0,
            mass_per_length=0.4,
            elements=2,
            modes=modes,
            segments=segments,
            gauges=[fa.Gauge(station=station, distance=0.004)],
        )
        return fa.Arm(links=[link])

    def names(modes, segments):
        one = ["link_1"] if segments == 1 else [f"link_1_segment_{n + 1}" for n in range(segments)]
        return ["joint_1", *(f"{piece}_mode_{k + 1}" for piece in one for k in range(modes))]

    runs = {(0.1, 2, 1): [], (0.2, 2, 1): [], (0.1, 3, 1): [], (0.1, 2, 2): []}
    for _ in range(2):
        for choice, results in runs.items():
            torque = [[sum(choice)]] * 5
            results.append(fa.simulate(arm(*choice), 0.1, torque=torque, rate=50.0))
    for (station, *rest), (first, second) in runs.items():
        assert first.gauge.values == [f"link 1 at {station:g} m"]
        assert list(first.coordinate.values) == names(*rest)
        np.testing.assert_array_equal(first.torque, sum((station, *rest)))
        del first.attrs["wall_seconds"], second.attrs["wall_seconds"]
        xr.testing.assert_identical(first, second)


def test_results_that_share_labels_are_independent_datasets():
    """The constructor without checks gives what xarray's own copy does."""
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.4)])
    first, second = (fa.simulate(arm, 0.1, rate=50.0, torque=[[size]] * 6) for size in (1.0, 2.0))
    values = {name: variable.values for name, variable in second.data_vars.items()}
    copied = first.copy(data=values).assign_attrs(second.attrs)
    xr.testing.assert_identical(second, copied)
    assert copied.sizes == second.sizes
    assert second.xindexes.keys() == copied.xindexes.keys()
    xr.testing.assert_identical(second.sel(axis="x", time=0.04), copied.sel(axis="x", time=0.04))
    first.time.attrs["units"] = "ms"
    first.tip.attrs["units"] = "mm"
    first["link"] = [7]
    first["extra"] = ("time", first.time.values)
    del first["tip"]
    xr.testing.assert_identical(second, copied)
    third = fa.simulate(arm, 0.1, rate=50.0, torque=[[2.0]] * 6)
    third.attrs["wall_seconds"] = second.attrs["wall_seconds"]
    xr.testing.assert_identical(third, second)


def test_coordinates_are_labelled(result):
    names = {"time", "joint", "link", "axis", "coordinate", "gauge", "station", "position"}
    assert set(result.coords) == names
    np.testing.assert_array_equal(result.joint, [1, 2, 3])
    np.testing.assert_array_equal(result.link, [1, 2, 3])
    assert result.axis.values.tolist() == ["x", "y"]
    names = ["joint_1", *(f"link_1_mode_{k}" for k in range(1, 5)), "joint_2", "joint_3"]
    names += [f"link_3_mode_{k}" for k in range(1, 4)]
    assert result.coordinate.values.tolist() == names
    assert result.gauge.values.tolist() == ["link 1 at 0.05 m", "link 1 at 0.5 m"]
    assert result.time.attrs["units"] == "s"


def test_attributes_describe_the_run(result, arm):
    attributes = result.attrs
    assert attributes["flexarm_version"] == fa.__version__
    assert attributes["accuracy"] == pytest.approx(1e-5 * arm.lengths.sum(), rel=1e-12)
    assert attributes["integrator"] == "dormand_prince_8"
    assert attributes["integrator_reason"]
    assert attributes["rtol"] == 1e-7
    assert attributes["atol"] == pytest.approx(1e-9 * arm.lengths.sum(), rel=1e-12)
    assert 0 < attributes["steps"] < attributes["evaluations"]
    assert attributes["rejected_steps"] >= 0
    assert attributes["wall_seconds"] > 0.0
    assert attributes["failure"] == ""
    assert all(isinstance(value, int | float | str) for value in attributes.values())
    assert "lengths" not in attributes["arm"]
    assert "flexural_rigidity: 30" in attributes["arm"]


def test_result_contains_its_arm(result, arm, tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(result.attrs["arm"], encoding="utf-8")
    assert fa.load_arm(path).spec == arm.spec


@pytest.mark.thorough
def test_netcdf_round_trip(result, tmp_path):
    path = tmp_path / "run.nc"
    result.to_netcdf(path, engine="h5netcdf")
    with xr.open_dataset(path, engine="h5netcdf") as file:
        back = file.load()
    xr.testing.assert_identical(back, result)


def test_dataframe(result):
    frame = result[["tip_angle", "kinetic_energy"]].to_dataframe()
    assert list(frame.columns) == ["tip_angle", "kinetic_energy"]
    assert frame.index.name == "time"


def test_channels_equal_the_methods_of_the_arm(result, arm):
    """Every sample is compared, one state at a time."""
    lengths = arm.lengths
    for k in range(0, 101, 10):
        now = result.isel(time=k)
        q, qd = now.q.values, now.qd.values
        exact = {"rtol": 0, "atol": 1e-14}
        np.testing.assert_array_equal(now.joint_angle, arm.joint_angles(q))
        np.testing.assert_array_equal(now.joint_rate, arm.joint_angles(qd))
        tip, velocity = arm.tip(q), arm.tip_velocity(q, qd)
        np.testing.assert_allclose(now.tip, tip[:2], **exact)
        np.testing.assert_allclose(now.tip_angle, tip[2], **exact)
        np.testing.assert_allclose(now.tip_velocity, velocity[:2], **exact)
        np.testing.assert_allclose(now.tip_angle_rate, velocity[2], **exact)
        energy = arm.energy(q, qd)
        np.testing.assert_allclose(
            [now.kinetic_energy, now.strain_energy, now.gravity_energy], energy[:3], rtol=1e-14
        )
        np.testing.assert_allclose(now.strain, arm.strain(q), rtol=1e-14)
        tips, rates = arm.nodal(q), arm.nodal(qd)
        deflection, slope = np.array([nodal[-1] for nodal in tips]).T
        np.testing.assert_allclose(now.link_tip_deflection, deflection, **exact)
        np.testing.assert_allclose(now.link_tip_slope, slope, **exact)
        deflection_rate, slope_rate = np.array([nodal[-1] for nodal in rates]).T
        np.testing.assert_allclose(now.link_tip_deflection_rate, deflection_rate, rtol=1e-12)
        np.testing.assert_allclose(now.link_tip_slope_rate, slope_rate, rtol=1e-12)
        # Absolute angles: each joint turns from the tip of the bent link before it.
        inboard = np.concatenate([[0.0], slope[:-1]])
        np.testing.assert_allclose(
            now.link_angle, np.cumsum(now.joint_angle.values + inboard), **exact
        )
        inboard = np.concatenate([[0.0], slope_rate[:-1]])
        np.testing.assert_allclose(
            now.link_rate, np.cumsum(now.joint_rate.values + inboard), rtol=0, atol=1e-13
        )
        shape = arm.shape(q, stations=2)
        np.testing.assert_allclose(shape[-1, -1], now.tip, rtol=0, atol=1e-13)
        chord = np.linalg.norm(shape[:, 1] - shape[:, 0], axis=1)
        assert np.all(abs(chord - lengths) < 0.01)


def test_rates_are_the_derivatives_of_their_channels(arm):
    """Differences at 20 kHz, at which the fastest mode turns by a radian per sample."""
    result = fa.simulate(
        arm, 0.02, initial_rate=arm.rest([0.5, 0.0, -0.5]), rate=20_000.0, rtol=1e-9, atol=1e-11
    )
    for name, rate in [
        ("joint_angle", "joint_rate"),
        ("link_angle", "link_rate"),
        ("link_tip_deflection", "link_tip_deflection_rate"),
        ("link_tip_slope", "link_tip_slope_rate"),
        ("tip", "tip_velocity"),
        ("tip_angle", "tip_angle_rate"),
        ("q", "qd"),
    ]:
        values, slopes = result[name].values, result[rate].values
        gained = (values[2:] - values[:-2]) * 10_000.0
        mean = (slopes[2:] + 4 * slopes[1:-1] + slopes[:-2]) / 6  # Simpson's rule
        assert abs(gained - mean).max() < 0.01 * abs(slopes).max(), name


@pytest.mark.thorough
@settings(max_examples=60)
@given(st.integers(1, 400), st.sampled_from([1.0, 3.0, 10.0, 30.0, 44.1, 100.0, 1000.0, 1 / 3]))
def test_samples_are_at_multiples_of_the_period_despite_rounding(count, rate):
    """Durations are sums of periods, as in a loop of a user."""
    duration = float(np.sum([1.0 / rate] * count))
    result = fa.simulate(unit_link(), duration, initial_rate=[1.0], rate=rate)
    assert result.sizes["time"] == count + 1
    np.testing.assert_allclose(result.time, np.arange(count + 1) / rate, rtol=1e-13)
    np.testing.assert_allclose(result.joint_angle[:, 0], result.time, rtol=1e-12)


@pytest.mark.parametrize(
    ("duration", "rate", "count"),
    [(1.0, 1000.0, 1001), (0.25, 10.0, 3), (0.05, 10.0, 1), (1 / 3, 30.0, 11), (2.0, 0.3, 1)],
)
def test_last_sample_is_within_the_duration(duration, rate, count):
    result = fa.simulate(unit_link(), duration, initial_rate=[1.0], rate=rate)
    assert result.sizes["time"] == count
    np.testing.assert_allclose(result.joint_angle[:, 0], np.arange(count) / rate, rtol=1e-12)


def test_run_continues_after_the_last_sample():
    """The joint crosses a line between the last sample, at 0.1 s, and the end."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=0.3, flexible=False)])
    events = [fa.joint_event(arm, 1, angle) for angle in (0.10025, 0.10045)]
    result = fa.simulate(arm, 0.1004, initial_rate=[1.0], events=events)
    np.testing.assert_array_equal(result.time, np.arange(101) / 1000.0)
    assert result.attrs["ended_by"] == "duration"
    np.testing.assert_allclose(result.event_time, [0.10025], rtol=1e-12)


def test_sample_rate_does_not_change_the_motion(arm):
    fine = fa.simulate(arm, 0.1, initial_rate=arm.rest([1.0, 0.0, 0.0]), rate=2000.0)
    coarse = fa.simulate(arm, 0.1, initial_rate=arm.rest([1.0, 0.0, 0.0]), rate=10.0)
    np.testing.assert_array_equal(fine.q.values[-1], coarse.q.values[-1])
    assert fine.attrs["steps"] == coarse.attrs["steps"]


def test_equal_calls_give_equal_digits(arm):
    start = arm.rest([1.0, 0.0, 0.0])
    runs = [fa.simulate(arm, 0.3, initial_rate=start, stations=3) for _ in range(2)]
    for name in runs[0].data_vars:
        np.testing.assert_array_equal(runs[0][name].values, runs[1][name].values)


def test_rigid_arms_and_arms_without_gauges():
    result = fa.simulate(unit_link(), 0.01, rate=100.0)
    assert "strain" not in result
    assert "gauge" not in result.dims
    assert "bending_moment" not in result
    assert "station" not in result.coords
    assert result.coordinate.values.tolist() == ["joint_1"]
    assert np.all(result.strain_energy == 0.0)
