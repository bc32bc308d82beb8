"""Uncertainty of estimates: other arms that fit, effects that the model lacks, intervals."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from data.bench_records import ONE
from identification.benches import (
    FREE,
    arm_of,
    believed,
    record,
    rough_record,
    truth,
)  # fmt: skip

pytestmark = pytest.mark.compiled

RIGIDITY = "links[0].flexural_rigidity"


def quiet(*arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fa.identify(*arguments, progress=False, **options)


def test_friction_that_the_model_lacks_is_named_and_widens_the_intervals():
    """The bench of MuJoCo with Coulomb friction: a joint damping alone would fit as well."""
    free = [RIGIDITY, "joints[0].damping", "joints[0].hub_inertia"]
    with pytest.warns(fa.AccuracyWarning, match="Coulomb friction of joint 1") as caught:
        found = fa.identify(
            arm_of(ONE), rough_record(ONE, 1, end=1.5), free, starts=1, progress=False
        )
    assert any(one.filename == __file__ for one in caught)
    assert "Coulomb friction of joint 1" in found.missing[0]
    assert "The residuals show" in str(found)
    errors = np.array([found[path] - truth(ONE, path) for path in free])
    stated = found.parameters["standard_deviation"].values
    assert np.all(np.abs(errors) < 2.0 * stated)
    # The friction is taken for damping, by a third of its value.
    assert errors[1] > 0.2 * truth(ONE, free[1])


def test_a_complete_model_lacks_nothing():
    free = [RIGIDITY, "joints[0].damping", "joints[0].hub_inertia"]
    found = quiet(arm_of(ONE), record(ONE.name, 1, end=1.5), free, starts=1)
    assert found.missing == ()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda data: data["torque"].__iadd__(0.01), "an offset of torque_1"),
        (lambda data: data["joint_angle"].__iadd__(2e-3), "an offset of joint_angle_1"),
        (lambda data: data["strain"].__imul__(1.05), "error of the gain of strain_1"),
    ],
)
def test_faults_of_instruments_are_named(fault, words):
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    fault(data)
    measured = fa.MeasuredRecord(data, bench.settings.replace(initial_angle=[0.0]))
    found = quiet(arm_of(ONE), measured, [RIGIDITY], starts=1)
    assert words in found.missing[0]


def test_delays_are_named():
    bench = record(ONE.name, 2, end=1.0)
    data = bench.data.copy(deep=True)
    data["strain"][1:] = data["strain"].values[:-1]
    found = quiet(arm_of(ONE), fa.MeasuredRecord(data, bench.settings), [RIGIDITY], starts=1)
    (sentence,) = [text for text in found.missing if "a delay of strain_1" in text]
    assert "0.005 s" in sentence or "0.0049 s" in sentence or "0.0051 s" in sentence


def test_other_arms_that_fit_as_well_are_named():
    """Hub and rotor act as a sum; random starts end at other pairs with the same sum."""
    joint = arm_of(ONE).spec.joints[0].replace(rotor_inertia=0.004)
    arm = fa.Arm(arm_of(ONE).spec.replace(joints=[joint]))
    free = [
        fa.FreeParameter(f"joints[0].{name}", lower=1e-4, upper=0.1)
        for name in ("hub_inertia", "rotor_inertia")
    ]
    with pytest.warns(fa.IdentifiabilityWarning, match="Another arm fits almost equally well"):
        found = fa.identify(arm, record(ONE.name, 1, end=1.0), free, progress=False)
    assert len(found.starts) == 3
    assert "inertia of joint 1" in found.alternatives[0]
    assert "Another arm" in str(found)
    assert "joints[0].hub_inertia  joints[0].rotor_inertia       -1.000" in str(found)
    again = fa.Identification.from_dataset(found.to_dataset())
    assert again.alternatives == found.alternatives
    assert str(again) == str(found)


def test_intervals_stay_within_the_bounds():
    free = [fa.FreeParameter("joints[0].mass", upper=0.35), RIGIDITY]
    joint = arm_of(ONE).spec.joints[0].replace(mass=0.3)
    arm = fa.Arm(arm_of(ONE).spec.replace(joints=[joint]))
    table = quiet(arm, record(ONE.name, 1, end=0.5), free, starts=1).parameters
    mass, rigidity = (table.sel(parameter=name) for name in ("joints[0].mass", RIGIDITY))
    assert mass["interval_start"] == 0.0
    assert mass["interval_end"] == 0.35
    half = 1.96 * float(rigidity["standard_deviation"])
    assert rigidity["interval_start"] == pytest.approx(float(rigidity["estimate"]) - half)


def test_beginnings_of_long_records_count_as_iterations(monkeypatch):
    from flexarm.identification import fitting

    counts = []
    evaluate = fitting.FitProblem.residuals

    def counted(self, scaled):
        counts.append(self.runs[0].times.size)
        return evaluate(self, scaled)

    monkeypatch.setattr(fitting.FitProblem, "residuals", counted)
    monkeypatch.setattr(fitting, "_BEGINNING", 100)
    quiet(believed(ONE), record(ONE.name, 1, end=1.2), FREE[ONE.name], starts=1, iterations=6)
    assert 100 in counts
    assert len(counts) <= 6


@pytest.mark.thorough
def test_intervals_cover_in_spite_of_friction_and_coloured_errors():
    """Without the tests of missing effects the damping and the payload are never covered."""
    free, covered = FREE[ONE.name], []
    for seed in range(10):
        measured = rough_record(ONE, seed, end=2.0)
        table = quiet(believed(ONE, seed), measured, free, starts=1).parameters
        values = np.array([truth(ONE, path) for path in free])
        covered.append((table["interval_start"] < values) & (values < table["interval_end"]))
    # 90 % of 60 intervals, of which those of a record are not independent.
    assert np.mean(covered) > 0.9
