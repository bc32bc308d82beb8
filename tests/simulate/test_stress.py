"""Stresses against closed forms of bending and fatigue, and those of a filter with a wrong arm."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import xarray as xr

import flexarm as fa

TUBE = fa.Tube(outer_diameter=0.1, thickness=0.004)
LENGTH, LOAD, GRAVITY = 2.0, 20.0, 9.81


def cantilever(**fields: object) -> fa.Arm:
    """Return a horizontal steel tube with a load at its tip."""
    given = {"length": LENGTH, "material": "steel", "section": TUBE} | fields
    link = fa.Link(**{name: value for name, value in given.items() if value is not None})
    return fa.Arm(links=[link], payload=fa.Payload(mass=LOAD), gravity=(0.0, -GRAVITY))


def held(arm: fa.Arm) -> xr.Dataset:
    """Return a run at rest, the joint held."""
    posture = fa.equilibrium(arm, [0.0])
    still = fa.joint_motion(arm, start=[0.0], end=[0.0], duration=0.01)
    return fa.simulate(arm, 0.01, prescribed={1: still}, initial=posture.q, stations=5)


def test_a_cantilever_has_the_stresses_of_its_moment() -> None:
    stress = fa.stress(held(cantilever()), [-1.0, 0.0, 0.5, 1.0])
    assert stress.dims == ("time", "link", "station", "fibre")
    assert stress.units == "Pa"
    outboard = LENGTH * (1.0 - stress.station.values)
    weight = 7850.0 * TUBE.area * GRAVITY
    moment = LOAD * GRAVITY * outboard + 0.5 * weight * outboard**2
    edge = 0.5 * 0.1 / TUBE.second_moment
    expected = moment[:, None] * edge * np.array([-1.0, 0.0, 0.5, 1.0])
    # The tip sags by 7 mm: its slope of 0.5 % gives an axial force of 2 N, 1.6 kPa.
    found = stress.isel(time=0, link=0).values
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=4e3)


def test_an_axial_force_acts_on_the_whole_section() -> None:
    arm = fa.Arm(
        links=[fa.Link(length=LENGTH, material="steel", section=TUBE)],
        payload=fa.Payload(mass=LOAD),
        gravity=(GRAVITY, 0.0),
    )
    stress = fa.stress(held(arm)).isel(time=0, link=0, station=0)
    weight = (7850.0 * TUBE.area * LENGTH + LOAD) * GRAVITY
    np.testing.assert_allclose(stress.values, weight / TUBE.area, rtol=1e-9)


def test_a_section_can_be_given_for_a_link_without_one() -> None:
    rod = {"flexural_rigidity": 210e9 * TUBE.second_moment, "mass_per_length": 7850.0 * TUBE.area}
    run = held(cantilever(material=None, section=None, **rod))
    stress = fa.stress(run, sections={1: TUBE})
    np.testing.assert_allclose(stress, fa.stress(held(cantilever())), rtol=1e-9, atol=1.0)
    with pytest.raises(fa.InputError, match="sections are missing: no link has one"):
        fa.stress(run)
    with pytest.raises(fa.InputError, match="numbers of links, 1 to 1"):
        fa.stress(run, sections={2: TUBE})


def test_one_section_for_a_tapered_link_gives_a_warning() -> None:
    rigidity = 210e9 * TUBE.second_moment
    table = fa.SectionTable(
        x=[0.0, LENGTH], flexural_rigidity=[rigidity, 0.4 * rigidity], mass_per_length=[2.0, 2.0]
    )
    run = held(cantilever(material=None, section=None, table=table))
    with pytest.warns(fa.AccuracyWarning, match="rigidity falls to 40% along it"):
        fa.stress(run, sections={1: TUBE})


def test_what_is_missing_is_named() -> None:
    run = held(cantilever())
    with pytest.raises(fa.InputError, match=r"no forces inside the links.*stations"):
        fa.stress(run.drop_vars("bending_moment"))
    with pytest.raises(fa.InputError, match="fibres must be within -1 and 1"):
        fa.stress(run, [0.05, 2.0])
    with pytest.raises(fa.InputError, match="stress must have at least three times"):
        fa.fatigue_damage(fa.stress(run).isel(time=0), 71e6)


def cycles(amplitude: float, count: int, samples: int) -> xr.DataArray:
    """Return an hour with a number of equal cycles, and a point without stress."""
    times = np.linspace(0.0, 3600.0, count * samples + 1)
    values = amplitude * np.sin(2.0 * np.pi * count * times / 3600.0)
    points = np.stack([values, 0.0 * values], axis=1)
    return xr.DataArray(points, {"time": times}, ("time", "point"))


@pytest.mark.parametrize(("factor", "slope"), [(2.0, 3), (1.0, 3), (0.6, 5), (0.3, 0)])
def test_equal_cycles_have_the_damage_of_the_standard(factor: float, slope: int) -> None:
    pytest.importorskip("fatpack")
    category, count = 71e6, 50
    damage = fa.fatigue_damage(cycles(0.5 * factor * category, count, 40), category)
    # EN 1993-1-9, 7.1: two million cycles at the category, five million at the knee.
    knee = (2.0 / 5.0) ** (1.0 / 3.0)
    life = {3: 2e6 / factor**3, 5: 5e6 * (knee / factor) ** 5, 0: np.inf}[slope]
    # The count rounds ranges to 1/4096 of the largest.
    np.testing.assert_allclose(damage.values, [count / life, 0.0], rtol=5 / 4096)
    assert damage.units == "1/h"


def test_damage_does_not_depend_on_where_a_repeated_history_begins() -> None:
    """A history that ends at its largest stress, joined to its start by a fall, too."""
    pytest.importorskip("fatpack")
    corners = np.array([45.0, -47.0, 95.0, 20.0, 60.0]) * 1e6
    # Twenty samples from one corner to the next, and back to the first.
    weight = np.linspace(0.0, 1.0, 20, endpoint=False)
    pairs = zip(corners, np.roll(corners, -1), strict=True)
    history = np.concatenate([(1.0 - weight) * a + weight * b for a, b in pairs])
    times = {"time": np.linspace(0.0, 3600.0, len(history))}
    rolled = xr.DataArray([np.roll(history, k) for k in range(100)], times, ("start", "time"))
    # The cycles have ranges of 142, 40 and, at the joint of end and start, 15 MPa.
    total = 0.0
    for size in (142e6, 40e6):
        values = 0.5 * size * np.sin(2.0 * np.pi * np.arange(41) / 40)
        once = xr.DataArray(values, {"time": np.linspace(0.0, 3600.0, 41)}, ("time",))
        total += fa.fatigue_damage(once, 71e6).item()
    # The count rounds ranges to 1/4096 of the largest.
    np.testing.assert_allclose(fa.fatigue_damage(rolled, 71e6), total, rtol=5e-3)


@pytest.mark.parametrize(
    "shape", [np.linspace(0.0, 1.0, 50), np.linspace(1.0, -0.2, 50) ** 3, np.repeat([0.0, 1.0], 25)]
)
def test_a_history_that_only_rises_or_falls_is_one_cycle(shape: np.ndarray) -> None:
    """It returns to its start when it repeats."""
    pytest.importorskip("fatpack")
    history = 3e8 * shape
    there_and_back = np.concatenate([history, history[::-1]])
    expected, damage = (
        fa.fatigue_damage(
            xr.DataArray(h, {"time": np.linspace(0.0, 3600.0, len(h))}, ("time",)), 71e6
        )
        for h in (there_and_back, history)
    )
    assert float(expected) > 1e-5
    # The largest range is rounded to 1/4096, of which the damage is the third power.
    assert float(damage) == pytest.approx(float(expected), rel=1e-3)


def test_missed_peaks_are_reported() -> None:
    pytest.importorskip("fatpack")
    with pytest.warns(fa.AccuracyWarning, match="less than ten samples a cycle"):
        fa.fatigue_damage(cycles(71e6, 50, 7), 71e6)


def test_a_category_in_megapascal_is_noticed() -> None:
    pytest.importorskip("fatpack")
    with pytest.warns(fa.ImplausibleValueWarning, match="71 Pa is none of a metal"):
        fa.fatigue_damage(cycles(71e6, 50, 40), 71.0)


def test_a_batch_of_other_sections_is_refused() -> None:
    arm = cantilever()
    posture, options = fa.equilibrium(arm, [0.0]).q, {"rate": 100.0, "stations": 5}
    options["channels"] = ["axial_force", "bending_moment"]
    one = fa.stress(fa.simulate(arm, 0.05, initial=posture, rate=100.0, stations=5))
    runs = fa.simulate_batch(arm, 0.05, initial=[posture, posture], **options)
    np.testing.assert_allclose(fa.stress(runs).isel(run=1).values, one.values, rtol=1e-9)
    with pytest.raises(fa.InputError, match="channels="):
        fa.stress(runs.drop_vars("axial_force"))
    numbers = {"links[0].section.thickness": [0.004, 0.005]}
    other = fa.simulate_batch(arm, 0.05, parameters=numbers, initial=posture, **options)
    with pytest.raises(fa.InputError, match="of several arms, whose sections may differ"):
        fa.stress(other)


def boom(payload: float, softer: float = 1.0, motor: float = 8.0) -> fa.Arm:
    """Return a boom of three boxes with a gauge near each root."""
    links = [
        fa.Link(
            length=length,
            material=fa.Material(density=7850.0, youngs_modulus=210e9 * softer),
            section=fa.Box(width=0.8 * height, height=height, thickness=0.004),
            elements=2,
            modes=2,
            damping=fa.ModalDamping(ratio=0.01),
            gauges=[fa.Gauge(station=0.2, distance=height / 2)],
        )
        for length, height in ((3.0, 0.16), (2.4, 0.13), (1.8, 0.10))
    ]
    joints = [
        fa.Joint(hub_inertia=80.0),
        fa.Joint(mass=motor, hub_inertia=40.0, housing_inertia=2.0),
        fa.Joint(mass=motor, hub_inertia=20.0, housing_inertia=1.0),
    ]
    gravity = (0.0, -GRAVITY)
    return fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=payload), gravity=gravity)


@pytest.mark.thorough
def test_a_filter_with_a_wrong_arm_finds_payload_and_stress() -> None:
    # 60 kg more than the filter expects, links 5 % softer, motors 0.5 kg heavier.
    plant, model = boom(160.0, 0.95, 8.5), boom(100.0)
    start = [0.5, -0.4, -0.3]
    motion = fa.joint_motion(model, start=start, end=[0.9, -0.8, 0.2], duration=3.0)
    noises = {"joint_angle": 2e-5, "joint_rate": 1e-3, "strain": 1e-6}
    instruments = [fa.Instrument(name, noise=noise) for name, noise in noises.items()]
    run = fa.simulate(
        plant,
        4.0,
        controller=fa.JointPD([4e4, 1.5e4, 5e3], [8e3, 1.5e3, 400.0], sample_time=1e-3),
        reference=motion,
        hardware=fa.Hardware(instruments, seed=1),
        initial=fa.equilibrium(plant, start).q,
        stations=12,
    )
    settings = {"sample_time": 1e-3, "torque_noise": 5.0, "payload_deviation": 60.0}
    estimator = fa.ExtendedKalmanFilter(model, instruments, **settings)
    torque = run.torque_command.values[:-1]
    readings = {name: run[f"measured_{name}"].values for name in noises}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.InconsistentEstimateWarning)  # the arm is wrong
        found = estimator.run(torque, readings)
    assert found.payload_mass[-1] == pytest.approx(160.0, rel=0.01)
    fibres = np.linspace(-1.0, 1.0, 28)
    options = {"estimator": estimator, "torque": torque, "stations": 12}
    estimated = fa.stress(found, fibres, **options)
    true = fa.stress(run, fibres)
    assert estimated[0].size == 1008
    settled = {"time": slice(1000, 4000)}
    missed = np.abs(estimated.isel(settled).values - true.isel(settled).values)
    assert missed.max() < 0.03 * float(np.abs(true).max())
    with pytest.raises(fa.InputError, match="torque is missing for Estimates"):
        fa.stress(found, estimator=estimator)
