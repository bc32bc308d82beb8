"""Loops that changes of the arm make unstable give the warning that the changed arm alone gives."""

import warnings

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from arms import chain
from flexarm.cli.main import app
from random_arms import random_spec

HUB = "joints[0].hub_inertia"
#: The lag of a filtered rate makes the loop of a light hub unstable.
ENCODER = fa.Hardware([fa.Instrument("joint_angle", rate_cutoff=40.0, delay=0.004)])


def one_link(hub=0.5, **payload):
    rod = {"flexural_rigidity": 400.0, "mass_per_length": 1.0, "modes": 2, "damping": 0.005}
    return chain([1.0], [hub], payload=fa.Payload(**payload), **rod)


LAW = fa.JointPD(60.0, 10.0)
LIGHT = fa.Change(HUB, at=0.5, factor=0.04)


def warned(arm, duration=2.0, **options):
    """Return the warnings of an unstable loop in a run, and its result, also if it fails."""
    motion = fa.joint_motion(arm, [0.0], [0.05], 1.0)
    options = {"controller": LAW, "reference": motion, "hardware": ENCODER, "rate": 200.0} | options
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = fa.simulate(arm, duration, **options)
        except fa.SimulationError as error:
            result = error.result
    texts = [str(w.message) for w in caught if w.category is fa.UnstableLoopWarning]
    assert result.attrs["unstable_loop"] == "".join(texts)
    return texts, result


@pytest.mark.thorough
def test_change_gives_the_warning_of_the_changed_arm():
    arm = one_link()
    assert not warned(arm)[0]
    (of_plant,) = warned(arm, plant=one_link(0.02))[0]
    (of_change,) = warned(arm, changes=[LIGHT])[0]
    assert "unstable at the start" in of_plant
    assert "unstable after the change of the arm at t = 0.5 s" in of_change
    # A brief change, and one near the end of the run, do not let it grow.
    back = fa.Change(HUB, at=0.52, factor=1.0)
    assert not warned(arm, changes=[LIGHT, back])[0]
    assert not warned(arm, 0.52, changes=[LIGHT])[0]


def test_combined_changes_are_examined_in_their_order():
    """The loop is stable with half of each of two masses of the hub, but not with half of both."""
    arm, first, second = one_link(), 0.25, 0.02
    steps = [fa.Change(HUB, at=0.3, to=first), fa.Change(HUB, at=0.6, to=second)]
    assert not warned(arm, changes=steps[:1])[0]
    (text,) = warned(arm, changes=steps)[0]
    assert "at t = 0.6 s" in text
    heavier = fa.Change("payload.mass", at=0.6, to=0.4)
    (text,) = warned(arm, changes=[*steps, heavier])[0]
    assert text.split(":")[1] == warned(one_link(second, mass=0.4))[0][0].split(":")[1]


@pytest.mark.thorough
def test_change_at_an_event_and_along_a_table():
    arm = one_link()
    event = fa.joint_event(arm, 1, 0.02, name="gate")
    slip = fa.Change(HUB, at="gate", factor=0.04)
    (text,) = warned(arm, events=[event], changes=[slip])[0]
    assert "after the change of the arm at t = 0." in text
    never = fa.joint_event(arm, 1, 0.5, name="gate")
    assert not warned(arm, events=[never], changes=[slip])[0]
    lighter = fa.Change(HUB, factor=([0.0, 1.0], [1.0, 0.04]), interval=0.01)
    assert len(warned(arm, changes=[lighter])[0]) == 1


def test_compare_and_failed_runs_name_the_change():
    arm, law = one_link(), {"pd": LAW}
    motion = {"step": fa.joint_motion(arm, [0.0], [0.05], 1.0)}
    plants = {"nominal": arm, "lighter": (arm, [LIGHT])}
    with pytest.warns(fa.UnstableLoopWarning, match="'pd' on 'lighter'"):
        table = fa.compare(arm, law, 2.0, motion, plants, hardware=ENCODER, rate=200.0)
    texts = [f"{table[kind].sel(plant='lighter').item()}" for kind in ("warning", "failure")]
    assert "after the change" in "".join(texts)
    assert not table.warning.sel(plant="nominal").item()


@pytest.mark.sampled("0.5")
@pytest.mark.parametrize("at", ["0.5", "gate"])
def test_check_examines_the_changes_of_a_file(tmp_path, at):
    text = f"""
flexarm: 1
arm:
  links: [{{length: 1.0, flexural_rigidity: 400.0, mass_per_length: 1.0, modes: 2,
           damping: {{kind: modal, ratio: 0.005}}}}]
  joints: [{{hub_inertia: 0.5}}]
motion: {{kind: joint, start: [0.0], end: [0.05], duration: 1.0}}
drive: {{kind: joint_pd, proportional: 60.0, derivative: 10.0}}
hardware: {{instruments: [{{signal: joint_angle, rate_cutoff: 40.0, delay: 0.004}}]}}
events: [{{kind: joint_angle, joint: 1, angle: 0.02, name: gate}}]
changes: [{{path: "joints[0].hub_inertia", at: {at}, factor: FACTOR}}]
run: {{duration: 2.0, rate: 100}}
"""
    for factor, expected in (("0.9", False), ("0.04", True)):
        path = tmp_path / "scenario.yaml"
        path.write_text(text.replace("FACTOR", factor), encoding="utf-8")
        result = CliRunner().invoke(app, ["check", str(path)])
        assert result.exit_code == 0, result.output
        assert ("the sampled loop is unstable after the change" in result.stderr) == expected


@pytest.mark.thorough
def test_warnings_agree_with_the_growth_on_random_arms():
    """Growth: of the joint rate within the last 1.5 s of the run."""
    rng = np.random.default_rng(2)
    counts = {True: 0, False: 0}
    for _ in range(14):
        spec = random_spec(rng, links=1, rigid=False, gravity=False, theory="linear", elements=1)
        hub = 0.5 * float(fa.Arm(spec).rigid().mass_matrix([0.0])[0, 0])
        arm = fa.Arm(spec.replace(joints=[fa.Joint(hub_inertia=hub)]))
        lag, pace = 0.01, float(rng.uniform(5.0, 20.0))
        instrument = fa.Instrument("joint_angle", rate_cutoff=1.0 / (2.0 * np.pi * lag))
        texts, run = warned(
            arm,
            4.0,
            controller=fa.JointPD(hub * pace**2, 1.4 * hub * pace),
            reference=fa.joint_motion(arm, [0.0], [1e-4], 0.2),
            hardware=fa.Hardware([instrument.replace(delay=lag)]),
            changes=[fa.Change(HUB, at=0.3, factor=float(np.exp(rng.uniform(-3.0, 0.0))))],
        )
        rates = abs(run.joint_rate.values[:, 0])
        early, late = rates[-400:-300].max(), rates[-100:].max()
        ended = run.attrs["ended_by"] == "failure"
        if not texts:
            assert not ended
            assert late < 3.0 * early
        elif float(texts[0].split("tenfold every ")[1].split()[0]) < 1.0:
            # Large motion is nonlinear and may stop growing.
            assert ended or late > 5.0 * early or late > 1e3 * rates[:30].max()
        counts[bool(texts)] += 1
    assert min(counts.values()) >= 3  # both answers occur
