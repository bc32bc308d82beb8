"""Changes of arms at events, in closed loops, plants, tables and files, with every integrator."""

import copy
import pickle

import numpy as np
import pytest

import flexarm as fa
from arms import changing_link, changing_links, moving, with_payload
from flexarm.integrate import INTEGRATORS

pytestmark = [
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    # The links have no damping, so that a delay makes their fastest vibrations unstable.
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]


class TestEvents:
    def test_a_payload_is_picked_up_at_an_event(self):
        arm = changing_link()
        event = fa.joint_event(arm, 1, 0.3, name="there", direction=1)
        pick = fa.Change("payload.mass", at="there", to=1.2)
        options = {"initial_rate": [0.5], "rate": 100.0}
        run = fa.simulate(arm, 1.0, events=[event], changes=[pick], **options)
        assert run.ended_by == "duration"
        np.testing.assert_allclose(run.change_time.values, [0.6], rtol=1e-9)
        assert run.event_time.values.tolist() == run.change_time.values.tolist()
        timed = pick.replace(at=float(run.change_time.item()))
        other = fa.simulate(arm, 1.0, changes=[timed], **options)
        np.testing.assert_allclose(run.q.values, other.q.values, rtol=0, atol=1e-12)
        assert run.time.size == 101

    def test_only_the_first_occurrence_counts(self):
        arm = changing_link(stiffness=60.0)
        event = fa.joint_event(arm, 1, 0.1, name="there")
        drop = fa.Change("payload.mass", at="there", to=0.0)
        run = fa.simulate(arm, 4.0, initial=[0.3], events=[event], changes=[drop], rate=100.0)
        assert run.event_time.size > 2
        assert run.change_time.size == 1
        assert run.change_time.item() == run.event_time.values[0]

    def test_event_that_does_not_occur(self):
        arm = changing_link()
        event = fa.joint_event(arm, 1, 3.0, name="never")
        drop = fa.Change("payload.mass", at="never", to=0.0)
        run = fa.simulate(arm, 0.2, initial_rate=[0.5], events=[event], changes=[drop])
        assert (run.event_time.size, run.change_time.size) == (0, 0)

    def test_in_a_closed_loop(self):
        arm = changing_links()
        event = fa.joint_event(arm, 1, 0.3, name="there")
        line = fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.5)
        pick = fa.Change("payload.mass", at="there", to=0.5)
        controller = fa.JointPD([20.0, 5.0], [2.0, 0.5], 0.002)
        options = {"controller": controller, "reference": line, "rate": 500.0}
        run = fa.simulate(arm, 0.6, events=[event], changes=[pick], **options)
        timed = pick.replace(at=float(run.change_time.item()))
        other = fa.simulate(arm, 0.6, changes=[timed], **options)
        np.testing.assert_allclose(run.q.values, other.q.values, rtol=0, atol=1e-7)


@pytest.mark.sampled("gauss_6", "kennedy_carpenter_5", "dormand_prince_8")
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_events_stop_every_integrator_for_a_change(integrator):
    """A terminal event later than the change still ends the run."""
    arm = changing_links()
    q, qd = moving(arm)
    pick = fa.Change("payload.mass", at="there", to=0.6)
    runs = []
    for method in ("auto", integrator):
        there = fa.joint_event(arm, 1, 0.45, name="there", direction=1)
        end = fa.joint_event(arm, 1, 0.6, name="end", terminal=True)
        options = {"events": [there, end], "changes": [pick], "integrator": method, "rate": 100.0}
        runs.append(fa.simulate(arm, 0.4, initial=q, initial_rate=qd, **options))
    assert [run.ended_by for run in runs] == ["end"] * 2
    # The default step of fixed-step methods allows more than they need here.
    np.testing.assert_allclose(*(run.change_time.values for run in runs), rtol=1e-5)
    np.testing.assert_allclose(*(run.time.values[-1] for run in runs), rtol=1e-5)
    np.testing.assert_allclose(*(run.tip.values for run in runs), rtol=0, atol=1e-5)


FIXED = [name for name, kind in INTEGRATORS.items() if not kind.adaptive]
STEPS = [
    fa.Change("payload.mass", at=0.1, to=0.5),
    fa.Change("links[0].flexural_rigidity", factor=([0.0, 0.2], [1.0, 0.7])),
    fa.Change("payload.mass", at=0.1503, to=0.2),  # between two sample times
]
HARDWARE = fa.Hardware(
    [
        fa.Instrument("joint_angle"),
        fa.Instrument("joint_rate"),
        fa.Instrument("strain", noise=1e-6),
    ],
    fa.Motors(delay=0.0005, time_constant=0.002),
    seed=2,
)


@pytest.mark.thorough
@pytest.mark.parametrize("hardware", [None, HARDWARE], ids=["exact", "hardware"])
def test_plant_gives_the_same_digits(hardware):
    arm = changing_links()
    controller = fa.StrainFeedback([20.0, 5.0], [2.0, 0.5], 5.0, sample_time=0.002)
    motion = fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3)
    start = arm.rest([0.2, -0.4])
    run = fa.simulate(
        arm, 0.3, controller=controller, reference=motion, hardware=hardware, changes=STEPS,
        rate=500.0,
    )  # fmt: skip
    plant = fa.Plant(arm, 0.002, hardware, changes=STEPS)
    for copied in (lambda p: p, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p))):
        controller.reset()
        reading = plant.reset(start)
        for k in range(150):
            if k == 60:
                plant = copied(plant)
            reading = plant.step(controller.update(k * 0.002, reading, motion))
        np.testing.assert_array_equal(plant.q, run.q.values[-1])
    assert run.change_path.values.tolist()[0] == "links[0].flexural_rigidity"


def test_an_accelerometer_measures_the_changed_arm():
    arm = changing_links()
    light = fa.Arm(with_payload(arm, mass=0.0))
    q, qd = (0.3 * part for part in moving(arm))
    hardware = fa.Hardware([fa.Instrument(fa.Sensor("acceleration", 2))])
    drop = fa.Change("payload.mass", at=0.0105, to=0.0)
    plant = fa.Plant(arm, 0.001, hardware, changes=[drop])
    plant.reset(q, qd)
    for _ in range(11):
        reading = plant.step([0.0, 0.0])
    fresh = fa.Plant(light, 0.001, hardware)
    wanted = fresh.reset(plant.q, plant.qd).acceleration
    old = fa.Plant(arm, 0.001, hardware).reset(plant.q, plant.qd).acceleration
    np.testing.assert_allclose(reading.acceleration, wanted, rtol=1e-9)
    assert abs(old - wanted).max() > 0.1


@pytest.mark.sampled("cowell_4")
@pytest.mark.parametrize("integrator", ["rk4", "generalized_alpha", "gauss_6", "cowell_4"])
def test_every_kind_of_integrator_goes_on(integrator):
    arm = changing_links()
    q, qd = moving(arm)
    options = {"initial": q, "initial_rate": qd, "changes": STEPS, "rate": 100.0}
    exact = fa.simulate(arm, 0.3, rtol=1e-10, atol=1e-12, **options)
    run = fa.simulate(arm, 0.3, integrator=integrator, **options)
    # The default step of fixed-step methods allows 1e-4 of the reach.
    np.testing.assert_allclose(run.tip.values, exact.tip.values, rtol=0, atol=3e-4)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_integrator_starts_again(integrator):
    """With equal steps the part after the change is the run of a new arm from there."""
    arm = changing_links()
    q, qd = moving(arm)
    options = {"integrator": integrator, "step": 1e-3, "rate": 100.0, "rtol": 1e-9, "atol": 1e-11}
    drop = fa.Change("payload.mass", at=0.1, to=0.0)
    run = fa.simulate(arm, 0.2, initial=q, initial_rate=qd, changes=[drop], **options)
    light = fa.Arm(with_payload(arm, mass=0.0))
    start = {"initial": run.q.values[10], "initial_rate": run.qd.values[10]}
    after = fa.simulate(light, 0.1, **start, **options)
    # Times differ by rounding, and adaptive methods begin with another step.
    limit = 1e-12 if integrator in FIXED else 1e-7
    np.testing.assert_allclose(run.q.values[10:], after.q.values, rtol=0, atol=limit)


def test_a_run_with_impacts_is_repeated_with_the_changes():
    stops = fa.JointLimits(lower=-1.0, upper=0.4, stiffness=500.0)
    arm = changing_link(limits=stops)
    pick = fa.Change("payload.mass", at=0.5, to=1.2)
    run = fa.simulate(arm, 2.0, initial_rate=[0.5], changes=[pick], rate=100.0)
    assert run.impact_steps > 0
    assert run.change_time.values.tolist() == [0.5]
    exact = fa.simulate(
        arm, 2.0, initial_rate=[0.5], changes=[pick], rate=100.0, rtol=1e-12, atol=1e-14
    )
    np.testing.assert_allclose(run.q.values, exact.q.values, rtol=0, atol=1e-8)


def test_contacts_and_section_forces_go_on():
    arm = changing_links(gravity=(0.0, -1.0))
    wall = fa.Contact(fa.Wall((0.0, -0.5), (0.0, 1.0)), 2e3, damping=0.5)
    options = {"initial": arm.rest([0.1, -0.2]), "contacts": [wall], "stations": 3, "rate": 200.0}
    drop = fa.Change("payload.mass", at=1.0, to=0.0)
    run = fa.simulate(arm, 2.0, changes=[drop], **options)
    before = fa.simulate(arm, 1.0, **options)
    np.testing.assert_allclose(run.contact_force[:201], before.contact_force, rtol=0, atol=1e-6)
    light = fa.Arm(with_payload(arm, mass=0.0))
    start = {"initial": before.q.values[-1], "initial_rate": before.qd.values[-1]}
    after = fa.simulate(light, 1.0, **{**options, **start})
    for name in ("contact_force", "bending_moment", "tip"):
        own, other = run[name].values[201:], after[name].values[1:]
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-4 * abs(other).max())


def test_compare_takes_changes_of_one_plant_and_of_all():
    arm = changing_links()
    line = fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3)
    pick = fa.Change("payload.mass", at=0.1, to=0.5)
    plants = {"nominal": arm, "picks up": (arm, [pick])}
    pd = {"PD": fa.JointPD([20.0, 5.0], [2.0, 0.5], 0.002)}
    table = fa.compare(arm, pd, 0.5, {"line": line}, plants, rate=200.0)
    everywhere = fa.compare(arm, pd, 0.5, {"line": line}, {"all": arm}, changes=[pick], rate=200.0)
    errors = table.tip_error_rms.sel(controller="PD", reference="line")
    assert errors.sel(plant="picks up") != errors.sel(plant="nominal")
    assert everywhere.tip_error_rms.item() == errors.sel(plant="picks up").item()


def test_runs_of_a_batch_are_those_of_simulate():
    arm = changing_links()
    q, qd = (0.3 * part for part in moving(arm))
    options = {"changes": STEPS[:2], "rate": 100.0}
    batch = fa.simulate_batch(arm, 0.2, initial=[q, 0.5 * q], initial_rate=qd, **options)
    for k, start in enumerate((q, 0.5 * q)):
        run = fa.simulate(arm, 0.2, initial=start, initial_rate=qd, specialized=False, **options)
        np.testing.assert_array_equal(batch.tip.values[k], run.tip.values)


SCENARIO = """
flexarm: 1
arm:
  links:
    - {length: 1.4, flexural_rigidity: 105, mass_per_length: 0.6, elements: 2}
    - {length: 1.0, flexural_rigidity: 105, mass_per_length: 0.6, elements: 1}
  joints: [{hub_inertia: 0.1}, {hub_inertia: 0.02}]
  payload: {mass: 0.1}
initial: {joint_angle: [0.2, -0.4], joint_rate: [0.5, 0]}
events: [{kind: joint_angle, joint: 1, angle: 0.25, name: there}]
changes:
  - {path: payload.mass, at: there, to: 0.5, velocity: [0.1, 0.2]}
  - {path: "links[0].flexural_rigidity", factor: {times: [0, 0.2], values: [1, 0.7]}}
run: {duration: 0.3, rate: 100}
"""


def test_file_gives_the_same_run(tmp_path):
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO)
    arm = fa.load_arm(path)
    wanted = fa.simulate(
        arm,
        0.3,
        initial=arm.rest([0.2, -0.4]),
        initial_rate=arm.rest([0.5, 0.0]),
        events=[fa.joint_event(arm, 1, 0.25, name="there")],
        changes=[
            fa.Change("payload.mass", at="there", to=0.5, velocity=(0.1, 0.2)),
            fa.Change("links[0].flexural_rigidity", factor=([0.0, 0.2], [1.0, 0.7])),
        ],
        rate=100.0,
    )
    found = fa.run_scenario(path)
    np.testing.assert_array_equal(found.q.values, wanted.q.values)
    assert found.change_time.values.tolist() == wanted.change_time.values.tolist()


def test_change_after_the_end_is_rejected_with_the_other_problems():
    late = fa.Change("payload.mass", to=0.2, at=0.3)
    with pytest.raises(fa.InputError, match=r"changes\[0\].at must be at most 0.1 s") as found:
        fa.simulate(changing_links(), 0.1, changes=[late, fa.Change("payload.mas", to=1.0)])
    assert "changes[1]" in str(found.value)
    at_the_end = fa.Change("payload.mass", to=0.2, at=0.1)
    run = fa.simulate(changing_links(), 0.1, changes=[at_the_end])
    assert run.time.values[-1] == 0.1
