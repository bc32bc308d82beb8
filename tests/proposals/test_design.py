"""``fa.design``: candidates, gains, margins, reasons, and the scenario that it writes."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
import xarray as xr
from proposal_requirements import needs_of, one_link, two_links

import flexarm as fa
from arms import chain
from flexarm.base.errors import Problem
from flexarm.cases.scenario.scenario import prepare
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.planning.proposals.candidates import Assessed, Candidate, Loops, candidates_of
from flexarm.planning.proposals.design import _best, _chosen, _lacking, _refusal, reasons_of
from flexarm.planning.proposals.requirements import case_of, plants_of
from flexarm.simulation.calls.compare import Evaluation
from flexarm.simulation.run import progress
from flexarm.simulation.run.progress import stage


@pytest.fixture(scope="module")
def moved():
    """Return the design of a motion of one uncertain link."""
    return fa.design(
        one_link(),
        "point_to_point",
        payload_uncertainty=1.0,
        rigidity_uncertainty=0.3,
        progress=False,
    )


@pytest.mark.parametrize("law", [fa.IntegralResonantControl, fa.PositivePositionFeedback])
def test_poles_of_strain_damping_are_those_of_sliding_joints(law):
    arms = [one_link(friction=fa.Friction(coulomb=c, viscous=0.1)) for c in (0.5, 0.0)]
    inner = fa.JointPD(500.0, 50.0, sample_time=1e-3)
    growth = [float(fa.loop_margins(law(arm, inner), arm)["growth"].max()) for arm in arms]
    assert growth[0] == pytest.approx(growth[1], rel=1e-9)


def test_linear_designs_are_those_of_sliding_joints():
    """Dry friction at rest is a damper of a hundred times its torque, which moving joints lack.

    Three geared links of the bench of unfamiliar arms: designed with that damper, the loop is
    unstable as soon as a joint moves. Oracle: poles with the same arm without dry friction.
    """
    joints = [
        fa.Joint(hub_inertia=h, rotor_inertia=r, gear_ratio=86.0, friction=fa.Friction(coulomb=c))
        for h, r, c in ((0.04, 1e-4, 0.63), (0.0123, 1.2e-5, 0.13), (1.3e-3, 8.8e-7, 0.033))
    ]
    rod = {"flexural_rigidity": [884.0, 212.0, 51.0], "mass_per_length": [1.7, 1.0, 0.6]}
    arms = {
        friction: chain(
            (0.48, 0.42, 0.38),
            [joint.replace(friction=joint.friction if friction else None) for joint in joints],
            **rod,
            elements=1,
            damping=0.011,
            payload=0.23,
        )
        for friction in (True, False)
    }
    laws = {
        friction: fa.LQG(arm, posture=[0.25, 0.75, 0.75], measured={"joint_angle": 5e-4})
        for friction, arm in arms.items()
    }
    np.testing.assert_allclose(laws[True].designs[0].gain, laws[False].designs[0].gain, rtol=1e-9)
    poles = [fa.loop_margins(law, arms[False])["growth"].max() for law in laws.values()]
    assert max(poles) < 0.0
    # The analysis with the friction, too, is that of sliding joints.
    assert fa.loop_margins(laws[True], arms[True])["growth"].max() == pytest.approx(poles[0])


@pytest.mark.thorough
def test_the_proposal_has_the_required_margin_on_all_arms(moved):
    chosen = moved.table.sel(candidate=moved.chosen)
    assert chosen.disk_margin >= 0.4
    arm = one_link()
    plants = [
        fa.varied(arm, payload_factor=payload, flexural_rigidity_factor=rigidity)
        for payload in (0.0, 1.0, 2.0)
        for rigidity in (0.7, 1.0, 1.3)
    ]
    hardware = moved.scenario.hardware
    postures = [[0.0], [0.25], [0.5]]
    margins = fa.loop_margins(moved.controller, plants, postures, hardware=hardware)
    assert margins.growth.max() < 0.0
    # The design has tried the model and the corners, which are every second of these arms.
    tried = margins.isel(plant=slice(None, None, 2))
    assert tried.disk_margin.min() == pytest.approx(chosen.disk_margin.item(), rel=1e-6)
    assert tried.growth.max() == pytest.approx(chosen.growth.item(), rel=1e-6)


@pytest.mark.thorough
def test_the_candidate_with_the_least_error_in_the_worst_case_is_proposed(moved):
    table = moved.table
    delay = moved.scenario.hardware.motors.delay
    enough = (table.delay_margin >= delay) & (table.damping_ratio >= 0.02)
    enough = enough & (table.disk_margin >= 0.4)
    worst = table.score.max("plant").where(enough, drop=True)
    assert moved.chosen == worst.candidate.values[worst.argmin("candidate")]
    assert table.sizes["candidate"] == 3
    assert table.plant.values.tolist() == ["nominal", "heavy, soft", "light, stiff"]


@pytest.mark.thorough
def test_the_scenarios_give_the_errors_of_the_table(moved):
    simulated = moved.table.failure.sel(plant="nominal") == ""
    assert simulated.any()
    for name in simulated.candidate.values[simulated]:  # refused candidates are not simulated
        scenario = moved.scenarios[name]
        result = fa.run_scenario(scenario, progress=False)
        end = scenario.motion.start_time + scenario.motion.duration
        # Two thirds of the rest, rounded, are excluded as settling time.
        settling = float(f"{(scenario.run.duration - end) * 2.0 / 3.0:.2g}")
        # The reference of a flexible arm ends after the motion.
        end = prepare(scenario).followed.motion.end_time
        tip = result.tip.values[result.time.values >= end + settling]
        mean = tip.mean(axis=0)
        goal = 0.8 * np.array([np.cos(0.5), np.sin(0.5)])
        away = np.hypot(*(mean - goal)) + np.hypot(*(tip - mean).T).max()
        expected = moved.table.score.sel(candidate=name, plant="nominal").item()
        assert away == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.thorough
def test_the_reasons_name_every_candidate_and_the_file_begins_with_them(moved, tmp_path):
    words = " ".join(moved.reasons)
    for name in moved.table.candidate.values:
        assert str(name) in words
    place = tmp_path / "folder" / "design.yaml"
    moved.save(place)
    text = place.read_text()
    assert text.startswith(f"# {moved.chosen} for the task point_to_point")
    assert fa.load_scenario(place) == moved.scenario
    with pytest.raises(fa.InputError, match="already exists"):
        moved.save(place)
    moved.save(place, overwrite=True)
    with pytest.raises(fa.InputError, match=r"end in \.yaml or \.yml"):
        moved.save(tmp_path / "design.txt")


@pytest.mark.thorough
def test_little_computing_power_excludes_models_in_the_controller():
    found = fa.design(one_link(), "hold", computing="low", progress=False)
    assert found.table.candidate.values.tolist() == ["integral resonant", "joint PD"]
    assert found.table.states.max() <= 2
    assert "more computing power" in " ".join(found.reasons)


@pytest.mark.thorough
def test_without_gauges_the_joints_are_controlled_and_the_reasons_recommend_gauges():
    found = fa.design(one_link(), "hold", sensors="joints", progress=False)
    assert found.table.candidate.values.tolist() == ["LQG", "loop shaping", "joint PD"]
    assert "Strain gauges" in " ".join(found.reasons)


def test_a_push_on_a_held_tip_would_bend_the_arm_by_a_hundredth_of_its_length():
    needs = needs_of(one_link(), "hold", start=[0.3])
    (load,) = case_of(needs)["loads"]
    force = np.array(load["force"])
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    assert force == pytest.approx(np.hypot(*force) * across, rel=1e-3)  # rounded to 3 digits
    # The deflection of a cantilever under a force at its tip; one element is exact for it.
    assert np.hypot(*force) * 0.8**3 / (3.0 * 20.0) == pytest.approx(0.008, rel=1e-3)


def test_the_plants_are_the_corners_of_the_uncertainty():
    needs = needs_of(one_link(), "hold", payload_uncertainty=1.5, rigidity_uncertainty=0.2)
    found = plants_of(needs)
    assert found["heavy, soft"] == {"payload_factor": 2.5, "flexural_rigidity_factor": 0.8}
    assert found["light, stiff"] == {"payload_factor": 0.0, "flexural_rigidity_factor": 1.2}
    assert len(found) == 5
    assert list(plants_of(needs_of(one_link(), "hold", rigidity_uncertainty=0.2))) == [
        "nominal",
        "soft",
        "stiff",
    ]


def test_the_wall_of_a_force_faces_the_base():
    needs = needs_of(two_links(), "force", start=[1.0, -0.2], end=[1.0, 0.3])
    (contact,) = case_of(needs)["contacts"]
    assert contact["surface"]["normal"] == pytest.approx([-1.0, 0.0])
    other = needs_of(two_links(), "force", start=[1.0, 0.3], end=[1.0, -0.2])
    assert case_of(other)["contacts"][0]["surface"]["normal"] == pytest.approx([-1.0, 0.0])


@pytest.mark.thorough
def test_a_force_is_followed():
    options = {"force": 2.0, "duration": 1.0, "progress": False}
    found = fa.design(two_links(gauges=False), "force", hardware=fa.Hardware(), **options)
    chosen = found.table.sel(candidate=found.chosen, plant="nominal")
    assert chosen.failure.item() == ""
    assert chosen.disk_margin > 0.4
    assert chosen.force_error_rms < 0.1  # 5 % of the force
    assert found.refusal == ""
    needs = needs_of(two_links(gauges=False), "force", force=2.0)
    assert {item.signal for item in needs.hardware.instruments} == {"joint_angle", "contact_force"}


def assessed(needs, disk_margin, growth):
    margins = {"gain_margin": 2.0, "phase_margin": 0.5, "delay_margin": 0.01, "damping_ratio": 0.1}
    return Assessed(needs, {}, {"disk_margin": disk_margin, "growth": growth, **margins}, 2)


def test_loops_near_instability_or_without_damping_are_refused():
    needs = needs_of(one_link(), "hold")
    assert needs.delay == 1e-3  # one sample of the typical drive
    table = scores(only=[1e-3])
    sound = assessed(needs, 0.5, -1.0)
    assert _refusal(needs, {"only": sound}, table, "only") == ""
    for name, value, text in (
        ("delay_margin", 0.81e-3, "permits a delay of only 1.81 ms, less than 2 times the 1 ms"),
        ("damping_ratio", 0.006, "has a damping ratio of 0.006, less than 0.02"),
        ("growth", 0.0, "an error does not fall to a hundredth"),
        ("growth", 2.0, "No candidate is stable on the model"),
        (
            "growth",
            -0.1,
            "is too slow: an error takes 46 s to fall to a hundredth, which may take 5.1 s",
        ),
    ):
        poor = sound._replace(margins={**sound.margins, name: value})
        assert text in _refusal(needs, {"only": poor}, table, "only")
        # Another one is proposed, even with more error and less margin.
        found, errors = (
            {"poor": poor, "sound": assessed(needs, 0.1, -1.0)},
            scores(poor=[1e-3], sound=[1.0]),
        )
        assert _chosen(needs, found, errors) == "sound"
    for error, text in (
        (np.nan, "does not complete"),
        (0.041, "its error (RMS error of the tip) is 41 mm, more"),
    ):
        assert text in _refusal(needs, {"only": sound}, scores(only=[error]), "only")
    assert _refusal(needs, {"only": sound}, scores(only=[0.039]), "only") == ""  # 5 % of 0.8 m


def test_joint_loops_are_limited_by_the_delay_of_the_drive():
    """The derivative gain times the lag stays below 0.7 of the inertia near the motor."""
    arm = one_link()
    inverse = np.linalg.inv(arm.mass_matrix(arm.rest([0.0])))
    near = 1.0 / inverse[0, 0]
    encoder = fa.Instrument("joint_angle", rate_cutoff=80.0)
    gains = {}
    for delay in (0.0, 0.01):
        hardware = fa.Hardware(instruments=[encoder], motors=fa.Motors(delay=delay))
        needs = needs_of(arm, "hold", hardware=hardware)
        (candidate,) = (one for one in candidates_of(needs) if one.name == "joint PD")
        gains[delay] = max(drive["derivative"][0] for drive in candidate.drives)
        lag = delay + 0.5 / (np.pi * 80.0) + 0.5 * needs.sample_time
        assert gains[delay] * lag < 0.7 * near * 1.01  # the gains are rounded
    assert gains[0.01] < 0.5 * gains[0.0]


def test_joint_loops_use_the_damping_of_their_joint():
    """An encoder and a motor that are late, and a bearing that damps more than the inertia needs.

    The gains for the inertia alone move the joint against this damping with a time constant of
    more than 20 periods of the link.
    """
    hardware = fa.Hardware(
        instruments=[fa.Instrument("joint_angle", rate_cutoff=10.0)],
        motors=fa.Motors(delay=0.03),
    )
    needs = needs_of(one_link(damping=8.0), "point_to_point", hardware=hardware, sensors="joints")
    (found,) = simplest_of(needs).values()
    assert found.refusal == ""
    assert found.margins["disk_margin"] > 0.4


def test_the_damping_of_a_joint_and_its_friction_is_a_part_of_that_of_the_loop():
    """2 zeta w J = damping + viscous friction + derivative gain, for a rigid link of inertia J.

    A joint that is damped more moves with the slowest pole of the loop that it replaces.
    """

    def loops(**joint):
        arm = chain([0.5], [joint], mass_per_length=8.0, flexible=False)
        needs = needs_of(arm, "point_to_point", hardware=fa.Hardware(), duration=1.0)
        return candidates_of(needs)[-1].drives

    friction = fa.Friction(coulomb=0.0, viscous=3.0, viscous_negative=2.0)
    for free, damped in zip(loops(), loops(damping=1.5, friction=friction), strict=True):
        passive = 1.5 + 2.0  # the least of both directions
        wanted = free["derivative"][0]
        assert damped["derivative"][0] == pytest.approx(
            max(wanted - passive, 0.0), abs=0.01 * wanted
        )
        slow = passive / wanted if passive > wanted else 1.0
        expected = pytest.approx(slow * free["proportional"][0], rel=0.01)  # the gains are rounded
        assert damped["proportional"][0] == expected


@pytest.mark.thorough
def test_three_links_have_a_linear_quadratic_design():
    """The tip does not determine three joints, so that their angles are weighted, too."""
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    arm = chain((0.4, 0.3, 0.3), [0.05, 0.03, 0.02], gauge=(0.02, 0.004), payload=0.1, **rod)
    found = fa.design(arm, "hold", progress=False)
    assert "LQG" in found.table.candidate
    assert found.table.growth.sel(candidate="LQG") < 0.0


ENCODER = fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=50.0)


def test_the_hardware_of_the_machine_replaces_the_typical_drive():
    machine = fa.Hardware(
        [ENCODER, fa.Instrument("strain", delay=5e-4)],
        motors=fa.Motors(torque_limit=3.0, delay=1e-3, time_constant=2e-3),
    )
    needs = needs_of(one_link(), "hold", hardware=machine)
    assert not needs.typical
    assert needs.hardware == machine
    assert needs.sensors == {"joints", "gauges"}
    assert needs.delay == pytest.approx(3.5e-3)
    assert needs.torque_limit == pytest.approx([3.0])
    assert case_of(needs)["hardware"] == machine
    blind = fa.Hardware([ENCODER])
    assert needs_of(one_link(), "hold", hardware=blind).sensors == {"joints"}
    assert needs_of(one_link(), "hold", hardware=fa.Hardware()).delay == 0.0
    limited = needs_of(one_link(), "hold", hardware=blind, torque_limit=2.0)
    assert limited.hardware.motors.torque_limit == pytest.approx([2.0])


def test_a_delay_of_many_sample_times_is_refused():
    needs = needs_of(one_link(), "hold")
    slow = fa.Hardware(motors=fa.Motors(delay=199.0 * needs.sample_time))
    assert needs_of(one_link(), "hold", hardware=slow).delay == pytest.approx(0.199)
    slower = fa.Hardware(motors=fa.Motors(delay=0.5))
    with pytest.raises(fa.InputError, match=r"at most 0\.2 s \(200 sample times\), got 0\.5 s"):
        needs_of(one_link(), "hold", hardware=slower)


@pytest.mark.thorough
@pytest.mark.parametrize(("limit", "weak"), [(0.01, True), (20.0, False)])
def test_the_reasons_name_motors_that_are_too_weak(limit, weak):
    options = {"computing": "low", "torque_limit": limit, "progress": False}
    refused = pytest.warns(fa.UnstableLoopWarning, match="more than 5% of the reach")
    with refused if weak else nullcontext():
        proposal = fa.design(one_link(), "point_to_point", **options)
    assert any("motor is at its limit" in reason for reason in proposal.reasons) == weak


def test_the_typical_drive_has_an_encoder_a_filter_and_a_delay():
    needs = needs_of(one_link(), "hold")
    encoder, gauges = needs.hardware.instruments
    assert encoder.resolution == pytest.approx(2.0 * np.pi / 2**17, rel=1e-3)
    assert encoder.rate_cutoff == pytest.approx(0.1 / needs.sample_time)
    assert (gauges.signal, needs.hardware.motors.delay) == ("strain", needs.sample_time)
    # A small arm is sampled faster, and its drive is faster by as much.
    small = chain([0.02], [1e-9], flexural_rigidity=1e-4, mass_per_length=1e-3, elements=1)
    fast = needs_of(small, "hold")
    assert fast.sample_time < needs.sample_time
    assert fast.hardware.instruments[0].rate_cutoff == pytest.approx(
        0.1 / fast.sample_time, rel=0.01
    )


def scores(**values):
    found = xr.DataArray(list(values.values()), dims=("candidate", "plant"))
    plants = ["nominal", "heavy"][: found.sizes["plant"]]
    score = found.assign_coords(candidate=list(values), plant=plants)
    return xr.Dataset({"score": score, "saturation": xr.zeros_like(score)})


def test_a_stable_candidate_is_proposed_before_an_unstable_one_with_less_error():
    needs = needs_of(one_link(), "hold")
    found = {"unstable": assessed(needs, 0.0, 3.0), "stable": assessed(needs, 0.2, -1.0)}
    table = scores(unstable=[1e-3], stable=[5e-3])
    assert _chosen(needs, found, table) == "stable"
    found["margin"] = assessed(needs, 0.5, -1.0)
    table = scores(unstable=[1e-3], stable=[5e-3], margin=[9e-3])
    assert _chosen(needs, found, table) == "margin"


def test_of_errors_that_no_run_resolves_the_simplest_candidate_is_proposed():
    needs = needs_of(one_link(), "hold")  # a reach of 0.8 m
    found = {name: assessed(needs, 0.5, -1.0) for name in ("rich", "simple")}
    assert _chosen(needs, found, scores(rich=[1e-7], simple=[7e-6])) == "simple"
    assert _chosen(needs, found, scores(rich=[1e-7], simple=[9e-6])) == "rich"


def test_a_proposal_that_is_not_stable_is_reported_first(monkeypatch, tmp_path):
    assess = Loops.assess

    def unstable(self, drive):
        one, _ = assess(self, drive)
        return one._replace(margins={**one.margins, "growth": 1.0, "disk_margin": 0.0}), []

    monkeypatch.setattr(Loops, "assess", unstable)
    with pytest.warns(fa.UnstableLoopWarning, match="No candidate is stable on the model"):
        found = fa.design(one_link(), "hold", computing="low", sensors="joints", progress=False)
    assert found.reasons[0].startswith("No candidate is stable on the model")
    assert found.text.startswith("# No candidate is stable on the model")
    assert found.refusal == found.reasons[0]
    with pytest.raises(fa.InputError, match="the proposal is refused"):
        found.save(tmp_path / "design.yaml")
    assert not list(tmp_path.iterdir())


def test_the_torque_limit_is_that_of_the_motors_of_all_candidates():
    options = {"torque_limit": 0.5, "duration": 0.4, "sensors": "joints"}
    found = fa.design(one_link(), "point_to_point", computing="low", **options, progress=False)
    assert found.scenario.drive.kind == "joint_pd"
    assert found.table.torque_peak.max() <= 0.5 + 1e-12
    assert found.scenario.hardware.motors.torque_limit == pytest.approx([0.5])


def test_a_proposal_that_fails_on_an_arm_names_it():
    needs = needs_of(one_link(), "hold")
    table, candidate = scores(one=[1e-3, np.nan]), Candidate("one", "A reason.", ())
    found = {"one": assessed(needs, 0.5, -1.0)}
    reasons = reasons_of(needs, [candidate], found, table, "one")
    begin = "one for the task hold: it does not complete its run on 'heavy'. A reason."
    assert reasons[0] == begin


def test_no_complete_run_on_the_model_is_an_error(monkeypatch):
    def failing(self, *run):
        return Evaluation(failure="the state is not finite")

    monkeypatch.setattr(PreparedStudy, "evaluation", failing)
    with pytest.raises(fa.SimulationError, match=r"no candidate completes.*state is not finite"):
        fa.design(one_link(), "hold", computing="low", sensors="joints", progress=False)


def test_refused_candidates_are_not_simulated_and_failing_designs_give_their_reason(monkeypatch):
    assess = Loops.assess

    def poor(self, drive):
        if drive["kind"] == "lqg":
            raise fa.InputError(Problem("acceptable", "gives no weight to a mode"))
        one, loops = assess(self, drive)
        if drive["kind"] == "joint_pd":
            return one, loops
        return one._replace(margins={**one.margins, "growth": 1.0}), []

    monkeypatch.setattr(Loops, "assess", poor)
    found = fa.design(one_link(), "hold", sensors="joints", duration=0.5, progress=False)
    assert found.chosen == "joint PD"
    assert "LQG could not be designed: acceptable gives no weight to a mode." in found.reasons
    shaped = found.table.sel(candidate="loop shaping", plant="nominal")
    assert shaped.failure.item() == "It is not simulated, because it is unstable."
    assert np.isnan(shaped.score)
    assert found.table.score.sel(candidate="joint PD", plant="nominal") > 0.0


def elbow(**joint):
    """Return two links of which the outer motor has the inertia of ``joint``."""
    arm = two_links()
    joints = [arm.spec.joints[0], fa.Joint(mass=0.5, **joint)]
    return fa.Arm(arm.spec.replace(joints=joints, gravity=(0.0, -9.81)))


def simplest_of(needs):
    """Return the assessed setting of the simplest candidate, by its name."""
    return _best(needs, case_of(needs), candidates_of(needs)[-1:])[0]


def advice_for(**joint):
    """Return the advice of a design with the simplest candidate alone."""
    needs = needs_of(elbow(**joint), "point_to_point")
    return _lacking(needs, simplest_of(needs), candidates_of(needs))


def test_the_advice_for_an_elbow_without_inertia_names_what_makes_its_loop_stable():
    """The inertia at the missing place alone, of the size that the advice names, is the cure."""
    advice = advice_for(hub_inertia=0.03)
    begin = "The arm has no inertia of motors: with joints[1] housing_inertia of "
    assert advice.startswith(begin)
    assert advice.endswith(" kg m^2, joint PID is accepted.")
    inertia = float(advice.removeprefix(begin).split()[0])
    accepted = {}
    for size in (0.0, inertia):
        heavier = needs_of(elbow(hub_inertia=0.03, housing_inertia=size), "point_to_point")
        accepted[size] = simplest_of(heavier)["joint PID"].refusal == ""
    assert accepted == {0.0: False, inertia: True}
    assert advice_for(hub_inertia=0.03, housing_inertia=0.03) == ""


def test_the_advice_for_slow_hardware_names_a_delay_with_which_the_loop_is_accepted():
    def needs_with(delay):
        hardware = fa.Hardware(
            instruments=[fa.Instrument("joint_angle", rate_cutoff=100.0)],
            motors=fa.Motors(delay=delay),
        )
        joints = [fa.Joint(hub_inertia=0.05), fa.Joint(hub_inertia=0.05, housing_inertia=0.05)]
        rod = {"flexural_rigidity": [30.0, 12.0], "mass_per_length": [0.6, 0.4], "elements": 1}
        arm = chain((0.7, 0.5), joints, **rod, damping=0.01, payload=0.2)
        return needs_of(arm, "point_to_point", hardware=hardware)

    slow = needs_with(0.03)
    advice = _lacking(slow, simplest_of(slow), candidates_of(slow))
    begin, end = "With ", " ms of delay and lag of the hardware, joint PD is accepted."
    assert advice.startswith(begin)
    assert advice.endswith(end)
    delay = 1e-3 * float(advice.removeprefix(begin).removesuffix(end))
    refusals = [simplest_of(needs_with(t))["joint PD"].refusal for t in (0.03, delay)]
    assert [refusal == "" for refusal in refusals] == [False, True]


def test_the_reason_why_nothing_can_be_designed_is_named(monkeypatch):
    def failing(self, drive):
        raise fa.InputError(Problem("acceptable", "gives no weight to a mode"))

    monkeypatch.setattr(Loops, "assess", failing)
    with pytest.raises(fa.InputError, match="acceptable gives no weight to a mode"):
        fa.design(one_link(), "hold", computing="low", progress=False)


@pytest.mark.thorough
def test_the_progress_of_a_design_grows_from_candidate_to_candidate():
    needs = needs_of(one_link(), "hold", computing="low")
    fractions = []
    candidates = [each._replace(drives=each.drives[:2]) for each in candidates_of(needs)]
    _best(needs, case_of(needs), candidates, stage(fractions.append, 0.0, 0.5))
    assert fractions == [0.0, 0.125, 0.25, 0.375]


@pytest.mark.thorough
def test_a_long_design_writes_its_progress(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PATIENCE_FOR_LINES", 0.0)
    fa.design(one_link(), "hold", computing="low")
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("designing: ") for line in lines)
    percent = [int(line.split()[1]) for line in lines]
    assert percent == sorted(percent)
    assert percent[0] < 20  # designs
    assert percent[-1] > 50  # simulations


def test_an_uncertain_payload_requires_a_payload():
    bare = fa.Arm(links=one_link().spec.links, joints=one_link().spec.joints)
    with pytest.raises(fa.InputError, match="not supported for an arm without payload"):
        fa.design(bare, "hold", payload_uncertainty=0.5)
    with pytest.raises(fa.InputError, match="sensors are gauges, but the arm has no gauges"):
        fa.design(two_links(gauges=False), "hold", sensors="gauges")
