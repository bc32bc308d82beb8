"""Samples that are simulated together have the numbers of single runs, to the last bit."""

import numpy as np
import pytest
from small_study import PD, READING, content

import flexarm as fa
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.studies import execution
from flexarm.cases.studies.execution import RECORDED, Executor
from flexarm.model import StudySpec, file_text
from flexarm.simulation.batch import lanes
from flexarm.simulation.calls.metrics import metrics_of

MASS = content()["vary"]["payload.mass"]
#: A motion that is slow enough for a quasi-static reference.
SLOW = {"kind": "joint", "start": [0.2, -0.4], "end": [0.2001, -0.3999], "duration": 0.04}
#: Studies by what differs from sample to sample.
VARIED = {
    "arm": {},
    "torque": {"vary": {"payload.mass": MASS, "motions.move.duration": {**MASS, "low": 0.03}}},
    "duration": {"vary": {"run.duration": {"kind": "values", "values": [0.05, 0.06]}}},
    "believed arm": {"vary": {"arm.payload.mass": MASS}},
    "gains": {
        "vary": {"drives.PD.proportional[0]": {"kind": "values", "values": [20.0, 25.0]}},
        "drives": {"PD": PD, "PID": {**PD, "kind": "joint_pid", "integral": [2.0, 1.0]}},
        "hardware": READING,
    },
    "noise": {
        "drives": {"PD": PD, "torque": {"kind": "rigid_inverse_dynamics"}},
        "hardware": READING,
        "samples": {"method": "random", "count": 12, "noise": "different"},
    },
    "diverging": {
        "vary": {"drives.PD.derivative": {"kind": "values", "values": [1.0, 1e6]}},
        "drives": {"PD": {**PD, "proportional": 1.0, "derivative": 1.0, "sample_time": 0.01}},
    },
    "failing": {"vary": {"payload.mass": {"kind": "values", "values": [0.1, -1.0, 1e40]}}},
    "plants": {
        "plants": {
            "softer": {"flexural_rigidity_factor": 0.7},
            "loaded": {"loads": [{"link": 2, "force": [0.0, -0.5]}]},
            "changed": {"changes": [{"path": "payload.mass", "at": 0.02, "to": 0.4}]},
        }
    },
    "drives": {
        "drives": {
            "none": {"kind": "none"},
            "bent": {"kind": "quasi_static"},
            "samples": {"kind": "torque", "rate": 100.0, "values": [[0.1, 0.0]] * 5},
            "PD": PD,
        },
        "motions": {"slow": SLOW},
    },
}


def executor(**changes):
    return Executor(PreparedStudy(StudySpec(**content(**changes))))


@pytest.mark.sampled("arm", "failing")
@pytest.mark.parametrize("changes", VARIED.values(), ids=VARIED)
def test_chunks_do_not_change_numbers(changes, monkeypatch):
    study = executor(**changes)
    whole = study.outcomes(0, 12)
    monkeypatch.setattr(execution, "_MEMORY", 5000)  # of three runs or less
    parts = [study.outcomes(k, min(k + 5, 12)) for k in range(0, 12, 5)]
    monkeypatch.setattr(execution, "_SHARED", ())  # no argument fits: each run by `simulate`
    alone = study.outcomes(0, 12)
    for name in whole._fields:
        expected = getattr(alone, name)
        joined = np.concatenate([getattr(part, name) for part in parts])
        for found in (getattr(whole, name), joined):
            np.testing.assert_array_equal(found, expected, err_msg=name)
    succeeded = whole.failure == ""
    assert succeeded.any()
    assert np.isfinite(whole.metrics[..., 0][succeeded]).all()


@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")  # of links that bend far
def test_numbers_equal_those_of_a_scenario():
    """The metrics of a sample are those of the result of `simulate` for its arm."""
    study = executor()
    found = study.outcomes(0, 3)
    for k in range(3):
        mass, rigidity = study.samples.values(k, k + 1)[0]
        prepared = PreparedStudy(StudySpec(**content()))
        first, second = prepared.arm.spec.links
        arm = fa.Arm(
            links=[first.replace(flexural_rigidity=rigidity), second],
            joints=prepared.arm.spec.joints,
            payload=fa.Payload(mass=mass),
        )
        result, reference = prepared.one("torque", "as believed", "move", arm, specialized=False)
        expected = metrics_of(result, prepared.arm, reference)
        for j, metric in enumerate(RECORDED):
            value = found.metrics[k, 0, 0, 0, j]
            np.testing.assert_array_equal(value, expected[metric.name], err_msg=metric.name)


@pytest.mark.compiled
def test_samples_are_simulated_in_lanes(monkeypatch):
    """Two drives on two plants, 12 runs each."""
    calls, runs = [], []
    together, outcome = execution.simulate_batch, lanes.Lanes._outcome

    def counted(*given, **named):
        calls.append(len(named["plant"]))
        return together(*given, **named)

    def executed(self, *arguments):
        found = outcome(self, *arguments)
        runs.extend(found.runs)
        return found

    monkeypatch.setattr(execution, "simulate_batch", counted)
    monkeypatch.setattr(lanes.Lanes, "_outcome", executed)
    drives = {"torque": {"kind": "rigid_inverse_dynamics"}, "PD": PD}
    executor(drives=drives, plants={"one": {}, "two": {"mass_factor": 1.5}}).outcomes(0, 12)
    assert calls == [12] * 4
    assert len(runs) == 48


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("seconds", "samples", "workers", "chunk"),
    # Eight samples at most, in tasks of at most a minute, and a task for each worker.
    [(5.0, 64, 2, 8), (5.0, 8, 2, 4), (20.0, 64, 2, 2), (100.0, 64, 2, 1), (0.25, 64, 1, 8)],
)
def test_tasks_of_long_runs_fill_the_lanes(seconds, samples, workers, chunk, monkeypatch):
    study = fa.Study(content(samples))
    monkeypatch.setattr(fa.Study, "_measured_seconds", lambda *_: seconds)
    assert study._measured_chunk(workers) == chunk


@pytest.mark.parametrize(
    "joint",
    [
        {"limits": {"lower": -2.0, "upper": 2.0, "stiffness": 100.0}},
        {"friction": {"coulomb": 0.1, "bristle_stiffness": 100.0}},
    ],
    ids=["stops", "bristles"],
)
def test_tasks_of_arms_without_lanes_are_short(joint, monkeypatch):
    """Without lanes, eight samples take eight times as long as one."""
    given = content(64)
    arm = given["arm"]
    joints = [arm["joints"][0] | joint, *arm["joints"][1:]]
    study = fa.Study(given | {"arm": arm | {"joints": joints}})
    monkeypatch.setattr(fa.Study, "_measured_seconds", lambda *_: 5.0)
    assert study._measured_chunk(2) == 1


@pytest.mark.parametrize(("seconds", "compiling", "runs"), [(60.0, 0.0, 1), (9.0, 60.0, 2)])
def test_long_samples_are_measured_once(seconds, compiling, runs, monkeypatch):
    """The clocks are those of a sample of that duration, which compiles when it runs first."""
    study, done = fa.Study(content()), []
    monkeypatch.setattr(study._executor, "outcomes", lambda *_: done.append(0))
    clock = {"compile_seconds": lambda: compiling * bool(done)}
    clock["perf_counter"] = lambda: seconds * len(done) + clock["compile_seconds"]()
    monkeypatch.setattr("flexarm.cases.studies.study.time.perf_counter", clock["perf_counter"])
    monkeypatch.setattr("flexarm.cases.studies.study.compile_seconds", clock["compile_seconds"])
    assert study._measured_seconds(1) == seconds
    assert len(done) == runs


def test_single_samples_are_not_executed_in_lanes(monkeypatch):
    monkeypatch.delattr(execution, "simulate_batch")  # a call raises
    found = executor(drives={"PD": PD}).outcomes(3, 4)
    assert found.failure.item() == ""


@pytest.mark.thorough
def test_verified_samples_are_executed_alone(tmp_path):
    """They repeat the numbers of chunks with several samples in lanes."""
    study = fa.Study(content(drives={"torque": {"kind": "rigid_inverse_dynamics"}, "PD": PD}))
    study.run(tmp_path / "a.zarr", workers=1, chunk=12)
    assert study.verify(tmp_path / "a.zarr", 12) == []
    again = fa.Study(content(drives={"torque": {"kind": "rigid_inverse_dynamics"}, "PD": PD}))
    assert file_text(StudySpec(**content())) != again._text
    assert again.verify(tmp_path / "a.zarr", 5, seed=1) == []
