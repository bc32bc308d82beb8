"""Studies: the numbers of a sample equal those of `compare`, and failures are recorded."""

import contextlib
import socket

import numpy as np
import pytest
from small_study import CONTENT, PD, READING, content

import flexarm as fa
from flexarm.base import processes
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.studies.execution import cluster
from flexarm.linear.statics.equilibrium import EquilibriumError
from flexarm.model import StudySpec
from flexarm.simulation.calls.compare import evaluated

GAUGE = {"station": 0.05, "distance": 0.005}
LARGE = {"kind": "values", "values": [0.1, 5.0]}


def run(**changes):
    return fa.Study(content(**changes)).run(workers=1, chunk=4)


def test_numbers_of_a_sample_equal_those_of_compare():
    plain = {**PD, "reference": "rigid", "feedforward": "none"}
    table = run(drives={"PD": plain}, plants={"one": {}, "heavier": {"mass_factor": 1.5}})
    sample = table.isel(sample=3)
    arm = fa.Arm(StudySpec(**CONTENT).arm)
    mass, rigidity = sample["payload.mass"].item(), sample["links[0].flexural_rigidity"].item()
    first, second = arm.spec.links
    simulated = fa.Arm(
        links=[first.replace(flexural_rigidity=rigidity), second],
        joints=arm.spec.joints,
        payload=fa.Payload(mass=mass),
    )
    by_hand = fa.compare(
        arm,  # the controller keeps the arm of the file as its model
        {"PD": fa.JointPD([20.0, 6.0], [5.0, 1.0])},
        0.05,
        {"move": fa.joint_motion(arm, [0.2, -0.4], [0.3, -0.3], 0.04)},
        {"one": simulated, "heavier": fa.varied(simulated, mass_factor=1.5)},
        rate=200.0,
    )
    for name in ("tip_error_rms", "torque_peak", "residual_vibration"):
        # The same operations on the same numbers.
        assert np.array_equal(sample[name].values, by_hand[name].values, equal_nan=True)
    assert np.ptp(table["tip_error_rms"].values, axis=0).min() > 0.0


@pytest.mark.thorough
def test_keys_of_the_file_vary():
    vary = {"drives.joint PD.proportional[0]": LARGE, "run.duration": {**LARGE, "values": [0.06]}}
    table = run(drives={"joint PD": PD}, vary=vary, samples={"method": "grid"})
    for k, gain in enumerate([0.1, 5.0]):
        changed = {**PD, "proportional": [gain, 6.0]}
        by_hand = content(drives={"joint PD": changed}, run={"duration": 0.06, "rate": 200.0})
        expected = PreparedStudy(StudySpec(**{**by_hand, "vary": {}, "samples": None})).run()
        assert table["tip_error_rms"].isel(sample=k).item() == expected["tip_error_rms"].item()


def test_arm_of_the_file_varies_in_models_and_plants():
    """`arm.payload.mass` is the mass that the drive compensates, `payload.mass` is another one."""
    vary = {"arm.payload.mass": LARGE}
    known = run(vary=vary, samples={"method": "grid"})
    unknown = run(vary={"payload.mass": LARGE}, samples={"method": "grid"})
    error = known["tip_error_rms"].values.ravel()
    assert error[0] == unknown["tip_error_rms"].values.ravel()[0]
    assert error[1] != unknown["tip_error_rms"].values.ravel()[1]


def test_impossible_numbers_are_no_failures_of_a_drive():
    vary = {"payload.mass": {"kind": "values", "values": [0.1, -1.0]}}
    table = run(vary=vary, samples={"method": "grid"})
    good, bad = table["infeasible"].values.ravel()
    assert good == ""
    assert bad == "payload.mass must be at least 0, got -1."
    assert not table["failure"].values.any()
    assert np.isnan(table["tip_error_rms"].values.ravel()).tolist() == [False, True]
    found = fa.study_statistics(table, limits={"tip_error_rms": 1.0})
    assert found["failure_rate"].item() == 0.0
    assert found["samples"].item() == 1
    assert found["infeasible"].item() == 1


def test_numbers_of_a_sample_are_valid_together():
    """The lower limit 0.26 exceeds the upper limit of the file, but not that of the sample."""
    limits = {"lower": -1.0, "upper": 0.25, "stiffness": 1000.0}
    first, second = content()["arm"]["joints"]
    arm = {**content()["arm"], "joints": [{**first, "limits": limits}, second]}
    for place in ("", "arm."):  # in the simulated arm, and in the file
        vary = {
            f"{place}joints[0].limits.lower": {"kind": "values", "values": [-1.0, 0.26]},
            f"{place}joints[0].limits.upper": {"kind": "values", "values": [0.5, 0.25]},
        }
        table = run(arm=arm, vary=vary, samples={"method": "grid"})
        upper, lower = (table[path].values for path in reversed(vary))
        np.testing.assert_array_equal(table["infeasible"].values.ravel() != "", lower > upper)
        assert np.sum(lower > upper) == 1


def test_diverging_runs_are_recorded():
    gains = {"kind": "joint_pd", "proportional": 1.0, "derivative": 1e6, "sample_time": 0.01}
    vary = {"drives.PD.derivative": {"kind": "values", "values": [1.0, 1e6]}}
    table = run(drives={"PD": gains}, vary=vary, samples={"method": "grid"})
    good, bad = table["failure"].values.ravel()
    assert good == ""
    assert bad.startswith("stopped at t =")


@pytest.mark.parametrize("drive", [{**PD, "reference": "tip_inversion"}, {"kind": "tip_inversion"}])
def test_samples_without_a_reference_are_recorded(drive):
    """The tip inversion of a motion that is too fast does not converge."""
    motion = {
        "kind": "line",
        "start": [1.3, 0.7],
        "end": [1.2, 0.8],
        "duration": 0.4,
        "start_time": 0.3,
    }
    table = run(
        drives={"it": drive},
        motions={"line": motion},
        vary={"motions.line.duration": {"kind": "values", "values": [0.4, 0.01]}},
        samples={"method": "grid"},
        run={"duration": 1.0, "rate": 200.0},
    )
    good, bad = table["failure"].values.ravel()
    assert good == ""
    assert bad.startswith("the tip comes within")


def test_run_without_an_equilibrium_is_evaluated():
    def no_equilibrium():
        raise EquilibriumError(0.0, np.zeros(2), "it did not converge")

    found = evaluated(no_equilibrium, fa.Arm(StudySpec(**CONTENT).arm), 0.0)
    assert found.failure.startswith("no equilibrium found")
    assert found.refusal is None


def test_unstable_loop_is_reported_once():
    gains = {"kind": "joint_pd", "proportional": 1.0, "derivative": 1.0, "sample_time": 0.01}
    vary = {"drives.PD.proportional": {"kind": "values", "values": [0.01]}}
    table = run(drives={"PD": gains}, vary=vary, samples={"method": "grid"})
    assert table["failure"].item() == ""
    assert table["warning"].item().count("the sampled loop is unstable") == 1


def test_each_sample_has_its_own_noise_on_request():
    equal = {"payload.mass": {"kind": "values", "values": [0.1]}}
    changes = {"drives": {"PD": PD}, "hardware": READING, "vary": equal}
    same = run(**changes, samples={"count": 3})["tip_error_rms"].values
    changes["vary"] = {}
    own = run(**changes, samples={"count": 3, "noise": "different"})["tip_error_rms"].values
    assert len(np.unique(same)) == 1
    assert len(np.unique(own)) == 3
    seeds = run(**changes, samples={"count": 3, "noise": "different", "seed": 9})
    assert not np.intersect1d(seeds["tip_error_rms"].values, own).size


@pytest.mark.thorough
def test_comparison_in_processes_has_the_same_numbers(monkeypatch):
    monkeypatch.setattr(processes, "WORTH", 0.0)
    drives = {"torque": {"kind": "rigid_inverse_dynamics"}, "PD": PD}
    drives["LQG"] = {"kind": "lqg", "acceptable": {"joint_angle": 0.1, "tip": 0.01}}
    plants = {"one": {}, "heavier": {"mass_factor": 1.5}}
    hardware = {"instruments": [*READING["instruments"], {"signal": "strain", "noise": 1e-6}]}
    arm = {**CONTENT["arm"], "links": [{**CONTENT["arm"]["links"][0], "gauges": [GAUGE]}] * 2}
    changes = {"arm": arm, "drives": drives, "plants": plants, "hardware": hardware}
    study = fa.Study(content(**changes, vary={}, samples=None))
    here, there = study.nominal(), study.nominal(workers=2)
    assert not here["failure"].values.any()
    assert np.ptp(here["tip_error_rms"].values.ravel()) > 0.0
    # The computing time of a controller differs from run to run.
    assert there.drop_vars("controller_time").equals(here.drop_vars("controller_time"))


def test_local_workers_do_not_need_the_port_of_another_cluster(recwarn):
    """Dask warns if its default port is in use."""
    pytest.importorskip("distributed")
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):  # in use already: just as well
            other.bind(("127.0.0.1", 8787))
            other.listen()
        with cluster(None, 1) as client:
            assert client.submit(abs, -3).result() == 3
    assert not [one for one in recwarn if "8787" in str(one.message)]
