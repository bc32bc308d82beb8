"""Section forces over a run equal those of the arm's method, with the loads of each sample."""

import numpy as np
import pytest

import flexarm as fa
from controllers import Plain
from flexarm.simulation.run.stepping import SECTION_CHANNELS

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
STATIONS = 5


def two_links(hub=0.02, **fields):
    links = [
        fa.Link(length=1.4142, elements=2, segments=2, **ROD),
        fa.Link(length=1.0, elements=1, rotary_inertia_per_length=0.01, **ROD),
    ]
    joints = [fa.Joint(hub_inertia=hub, damping=0.4), fa.Joint(mass=0.5, housing_inertia=0.01)]
    fields = {"gravity": (0.0, -9.81), "payload": fa.Payload(mass=0.3, offset=(0.1, 0.0))} | fields
    return fa.Arm(links=links, joints=joints, **fields)


def torque(t):
    return [8.0 + np.sin(5 * t), 3.0 * np.cos(4 * t)]


def stacked(result):
    """Return an array (samples, links, stations, 3)."""
    return np.stack([result[name].values for name in SECTION_CHANNELS], axis=-1)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_every_sample_with_loads_and_a_base_that_change(theory):
    arm, factor = two_links(theory=theory), lambda t: 1.0 + np.sin(9 * t)
    shaken = lambda t: (np.sin(3 * t), 1.0)  # noqa: E731
    point = fa.Load(1, (0.5, 2.0), 0.3, station=0.7, factor=factor)
    wind = fa.Load(1, (0.0, 3.0), spread=(0.3, 1.2), frame="link", factor=factor)
    result = fa.simulate(
        arm,
        0.3,
        torque=torque,
        tip_force=(1.0, 2.0),
        loads=[point, wind],
        base_acceleration=shaken,
        rate=100,
        stations=STATIONS,
    )
    for k in (0, 7, 30):
        t = result.time.values[k]
        now = [
            fa.Load(1, factor(t) * np.array([0.5, 2.0]), 0.3 * factor(t), station=0.7),
            fa.Load(1, (0.0, 3.0 * factor(t)), spread=(0.3, 1.2), frame="link"),
        ]
        around = ((1.0, 2.0), now, shaken(t))
        q, qd = result.q.values[k], result.qd.values[k]
        qdd = arm.forward_dynamics(q, qd, torque(t), *around)
        exact = arm.section_forces(q, qd, qdd, STATIONS, *around)
        # Factors are interpolated to 1e-9; stiff modes respond with forces of 1e3.
        np.testing.assert_allclose(stacked(result)[k], exact, rtol=0, atol=1e-6)


def test_results_do_not_depend_on_the_chunks():
    """Each chunk of samples is evaluated at once."""
    arm = two_links()
    dense = fa.simulate(arm, 0.5, torque=torque, rate=20000, stations=3)
    sparse = fa.simulate(arm, 0.5, torque=torque, rate=100, stations=3)
    np.testing.assert_allclose(
        stacked(dense)[::200], stacked(sparse), rtol=0, atol=1e-9 * abs(stacked(sparse)).max()
    )


def test_prescribed_joint_at_rest_has_static_forces():
    hold = fa.PrescribedAngle(lambda t: 0.3, lambda t: 0.0, lambda t: 0.0)
    arm = two_links(theory="linear")
    held = fa.equilibrium(arm, [0.3, 0.3], tip_force=(1.0, 2.0, 0.3))
    result = fa.simulate(
        arm,
        0.05,
        prescribed={1: hold, 2: hold},
        initial=held.q,
        tip_force=(1.0, 2.0, 0.3),
        rate=100,
        stations=STATIONS,
    )
    still = arm.section_forces(held.q, 0 * held.q, 0 * held.q, STATIONS, (1.0, 2.0, 0.3))
    # Rest has the tolerance of the run, 1e-9 m at the tip.
    np.testing.assert_allclose(stacked(result)[-1], still, rtol=0, atol=1e-5)


def test_closed_loop_on_another_plant():
    """Forces are those of the plant, under the torque of each sample time."""
    arm = two_links()
    plant = two_links(payload=fa.Payload(mass=0.6))
    motion = fa.joint_motion(arm, [0.0, 0.0], [0.2, -0.1], 0.1)
    control = fa.JointPD(20.0, 1.0, sample_time=0.001)
    result = fa.simulate(
        arm, 0.1, controller=control, reference=motion, plant=plant, rate=200, stations=3
    )
    k = 13
    q, qd, held = (result[name].values[k] for name in ("q", "qd", "torque"))
    exact = plant.section_forces(q, qd, plant.forward_dynamics(q, qd, held), 3)
    np.testing.assert_allclose(
        stacked(result)[k], exact, rtol=0, atol=1e-12 * abs(stacked(result)).max()
    )


def test_forces_at_root_and_tip_equal_joint_reactions():
    """Without a hub the root transmits the whole reaction of the joint."""
    result = fa.simulate(two_links(hub=0.0), 0.2, torque=torque, rate=100, stations=3)
    root = result.sel(station=0.0)
    np.testing.assert_allclose(root.bending_moment, -result.joint_moment, rtol=1e-12)
    force = np.linalg.norm(result.joint_force, axis=-1)
    np.testing.assert_allclose(np.hypot(root.axial_force, root.shear_force), force, rtol=1e-12)
    # Root sections have the angles of their links.
    c, s = np.cos(result.link_angle), np.sin(result.link_angle)
    up = s * root.axial_force + c * root.shear_force
    np.testing.assert_allclose(
        up, -result.joint_force.sel(axis="y"), rtol=0, atol=1e-12 * abs(up).max()
    )


def test_labels_of_sections():
    arm = two_links()
    result = fa.simulate(arm, 0.01, rate=100, stations=STATIONS)
    assert result.bending_moment.dims == ("time", "link", "station")
    np.testing.assert_array_equal(result.station, [0.0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(result.position.sel(link=1), 1.4142 * result.station, rtol=1e-15)
    assert result.position.attrs["units"] == "m"
    middle = result.shear_force.sel(link=2, station=0.5)
    assert middle.dims == ("time",)
    assert float(middle.position) == 0.5


def test_partial_result_has_section_forces():
    fails = Plain(lambda t, measurement, reference: [np.nan if t > 0.02 else 0.0, 0.0], 0.005)
    with pytest.raises(fa.SimulationError) as reported:
        fa.simulate(two_links(), 0.1, controller=fails, rate=1000, stations=3)
    kept = reported.value.result
    assert kept.bending_moment.shape == (kept.sizes["time"], 2, 3)
    assert np.all(np.isfinite(kept.bending_moment))


def test_from_a_scenario_file(tmp_path):
    text = (
        "flexarm: 1\n"
        "arm:\n"
        "  gravity: [0, -9.81]\n"
        "  links: [{length: 1.0, flexural_rigidity: 20.0, mass_per_length: 0.5}]\n"
        "run: {duration: 0.01, rate: 1000, stations: 3}\n"
    )
    path = tmp_path / "run.yaml"
    path.write_text(text)
    result = fa.run_scenario(path)
    assert result.bending_moment.shape == (11, 1, 3)
    again = tmp_path / "again.yaml"
    again.write_text(result.attrs["scenario"])
    assert "stations: 3" in result.attrs["scenario"]
    np.testing.assert_array_equal(fa.run_scenario(again).bending_moment, result.bending_moment)
    path.write_text(text.replace("stations: 3", "stations: 1"))
    with pytest.raises(fa.ModelError, match=r"run\.stations must be 0, or at least 2"):
        fa.run_scenario(path)
