"""Exported stress and fatigue damage, compiled, against ``fa.stress`` and fatpack."""

import numpy as np
import pytest

import flexarm as fa
from bridges.c_code_tools import Library, make

CATEGORY = 71e6
PAYLOAD = 160.0


def boom(**fields: object) -> fa.Arm:
    """Return a boom of two steel links; the rod between them has no section."""
    links = [
        fa.Link(
            length=length,
            material="steel",
            section=fa.Box(width=0.1, height=height, thickness=0.004),
            modes=2,
            damping=fa.ModalDamping(ratio=0.01),
        )
        for length, height in ((3.0, 0.16), (2.4, 0.12))
    ]
    rod = fa.Link(length=0.5, mass_per_length=12.0, flexible=False)
    given = {
        "links": [links[0], rod, links[1]],
        "joints": [fa.Joint(hub_inertia=80.0)] * 3,
        "payload": fa.Payload(mass=PAYLOAD, offset=(0.2, 0.1)),
        "gravity": (0.0, -9.81),
    }
    return fa.Arm(**(given | fields))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Folder of the boom with three stations and damage; the payload is an argument."""
    pytest.importorskip("fatpack")
    folder = tmp_path_factory.mktemp("stress")
    options = {"stations": 3, "detail_category": CATEGORY}
    fa.export_c(boom(), folder, parameters=["payload.mass"], **options)
    return folder


@pytest.fixture(scope="module")
def library(exported):
    return Library(exported)


def test_recorded_run(exported):
    done = make(exported, "test")
    assert done.returncode == 0, done.stdout + done.stderr
    assert {"stress", "damage", "ok"} <= {line.split()[0] for line in done.stdout.splitlines()}


@pytest.mark.parametrize("mass", [0.5 * PAYLOAD, 2.0 * PAYLOAD])
def test_stress_follows_the_payload_that_a_filter_estimates(library, mass):
    """The stress at samples of a run under a constant torque is that of ``fa.stress``."""
    arm = boom(payload=fa.Payload(mass=mass, offset=(0.2, 0.1)))
    torque = np.array([2000.0, -500.0, 800.0])
    run = fa.simulate(
        arm, 0.05, torque=np.tile(torque, (51, 1)), initial=arm.rest([0.3, -0.2, 0.4]), stations=3
    )
    expected = fa.stress(run)
    assert expected["link"].values.tolist() == [1, 3]
    stress = np.zeros(int(library.macros["stresses"]))
    for k in (0, 25, 50):
        state = (np.ascontiguousarray(one.values[k]) for one in (run.q, run.qd))
        library("stress", *state, torque, np.array([mass]), stress)
        wanted = expected.isel(time=k).values.ravel()
        # The samples of a run have errors of integration, which accelerations magnify.
        np.testing.assert_allclose(stress, wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())


def damage_of(library, histories):
    """Return the damage (points,) of histories (samples, points) of the first points."""
    count = int(library.macros["stresses"])
    memory, damage = np.zeros(int(library.macros["damage_memory"])), np.zeros(count)
    for row in np.pad(histories, ((0, 0), (0, count - histories.shape[1]))):
        library("damage_update", np.ascontiguousarray(row), memory)
    library("damage", memory, damage)
    assert not damage[histories.shape[1] :].any()
    return damage[: histories.shape[1]]


def per_hour(histories):
    """Return the damage of ``fa.fatigue_damage`` over histories that last one hour."""
    import xarray as xr

    times = {"time": np.linspace(0.0, 3600.0, len(histories))}
    return fa.fatigue_damage(xr.DataArray(histories, times, ("time", "point")), CATEGORY).values


def smooth_noise(seed, samples=4000, points=4):
    """Return histories with twenty samples in the fastest period, Pa."""
    random = np.random.default_rng(seed)
    t = np.arange(samples)[:, None, None]
    waves = 2.0 * np.pi / random.uniform(20.0, 900.0, (1, points, 12))
    phases = random.uniform(0.0, 2.0 * np.pi, waves.shape)
    return 0.5 * CATEGORY * np.sin(waves * t + phases).sum(axis=2)


@pytest.mark.parametrize("seed", [1, 2])
def test_damage_sample_by_sample_is_that_of_the_whole_history(library, seed):
    histories = smooth_noise(seed)
    # fa.fatigue_damage rounds ranges to 1/4096 of the largest.
    np.testing.assert_allclose(damage_of(library, histories), per_hour(histories), rtol=5e-3)


def test_a_decaying_vibration_has_more_open_cycles_than_the_memory(library):
    """Ranges fall by 1 % in a half period, so that over 300 are open above the cut-off limit."""
    turn = np.arange(0.0, 600.0, 0.05)
    history = 8.0 * CATEGORY * np.exp(-0.01 * turn) * np.cos(np.pi * turn)
    found, expected = damage_of(library, history[:, None]), per_hour(history[:, None])
    # Cycles of neighbouring ranges, which differ by 1 %, are counted for each other.
    np.testing.assert_allclose(found, expected, rtol=0.03)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_stress_that_is_not_finite_does_no_damage_and_hides_none(library, wrong):
    """A reading that fails at a peak, at the start, and in between."""
    history = np.array([0.0, 3.0, -1.0, 2.0, 0.0]) * CATEGORY
    gaps = np.insert(history, [0, 1, 2, 4], wrong)
    expected = damage_of(library, history[:, None])
    assert expected[0] > 0.0
    np.testing.assert_array_equal(damage_of(library, gaps[:, None]), expected)


def test_the_filter_has_the_modes_of_the_arm_whose_stress_is_exported(tmp_path):
    """The estimates of a filter with fewer modes are no state of the arm."""
    arm = fa.Arm(links=[boom().spec.links[0].replace(modes=3)], joints=[fa.Joint(hub_inertia=80.0)])
    small = fa.Arm(arm.spec.replace(links=[arm.spec.links[0].replace(modes=1)]))
    encoder = fa.Instrument(signal="joint_angle", noise=1e-4)
    known = fa.ExtendedKalmanFilter(small, [encoder], sample_time=1e-3, torque_noise=5.0)
    with pytest.raises(fa.InputError, match=r"stations need a filter with the coordinates"):
        fa.export_c(arm, tmp_path, observer=known, stations=3)
    files = fa.export_c(small, tmp_path, observer=known, stations=3)
    assert "arm_stress(" in files[0].read_text()


def test_what_cannot_be_exported_is_named(tmp_path):
    rods = [fa.Link(length=1.0, mass_per_length=1.0, flexural_rigidity=100.0)]
    with pytest.raises(fa.InputError, match=r"stations need a link with a section.*material"):
        fa.export_c(fa.Arm(links=rods), tmp_path, stations=5)
    with pytest.raises(fa.InputError, match=r"detail_category needs stations"):
        fa.export_c(boom(), tmp_path, detail_category=CATEGORY)
    words = r"parameters\[0\] must be a number of the payload, if the export has stations"
    with pytest.raises(fa.InputError, match=words):
        fa.export_c(boom(), tmp_path, stations=3, parameters=["joints[0].hub_inertia"])
    pytest.importorskip("fatpack")
    with pytest.warns(fa.ImplausibleValueWarning, match="71 Pa is none of a metal"):
        fa.export_c(boom(), tmp_path, stations=3, detail_category=71.0)


def test_zero_stations_are_none(tmp_path):
    files = fa.export_c(boom(), tmp_path, stations=0)
    assert "stress" not in files[0].read_text()
    with pytest.raises(fa.InputError, match=r"stations must be 0, or at least 2 \(root and tip\)"):
        fa.export_c(boom(), tmp_path, stations=1)
