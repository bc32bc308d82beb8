"""Records of closed loops: derivatives of their outputs, and fits by them or by differences."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.identification import fitting, runs

pytestmark = [
    pytest.mark.compiled,
    # Records without noise have residuals that are not white, and links bend far.
    pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning"),
]

PATHS = [
    "links[0].flexural_rigidity",
    "joints[0].hub_inertia",
    "joints[0].damping",
    "payload.mass",
]
NUMBERS = dict(zip(PATHS, (20.0, 0.1, 0.05, 0.2), strict=True))
READ = [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument("joint_rate", noise=1e-3)]


def arm_of(rigidity, inertia, damping, payload):
    rod = {"flexural_rigidity": rigidity, "mass_per_length": 0.4, "elements": 1, "modes": 2}
    joint = fa.Joint(hub_inertia=inertia, damping=damping)
    more = {"payload": fa.Payload(mass=payload), "gravity": [0.0, -9.81]}
    return chain([0.8], [joint], damping=0.02, gauge=(0.05, 0.005), **rod, **more)


PLANT, BELIEVED = arm_of(*NUMBERS.values()), arm_of(22.0, 0.12, 0.03, 0.25)
PD = fa.JointPD(10.0, 1.5, sample_time=0.004)
LOOPS = {
    "joint_pd": (PD, None),
    "noise": (PD, fa.Hardware(READ, seed=3)),
    "another_model": (fa.ComputedTorque(BELIEVED, frequency_hz=0.8, sample_time=0.004), None),
}
ROUNDED = fa.Hardware([READ[0].replace(resolution=1e-6), READ[1]], seed=3)


def record(controller, hardware):
    reference = fa.joint_motion(PLANT, [0.0], [0.8], 0.5)
    run = fa.simulate(
        BELIEVED,
        0.8,
        plant=PLANT,
        controller=controller,
        reference=reference,
        hardware=hardware,
        rate=250.0,
    )
    outputs = ["joint_angle", "strain"]
    return fa.MeasuredRecord(
        run, outputs=outputs, controller=controller, reference=reference, hardware=hardware
    )


def fit(monkeypatch, loop, fewest):
    """Fit the record of a loop; return the result and the derivatives at the start.

    Args:
        fewest: numbers by which ``sensitivities`` is used.
    """
    monkeypatch.setattr(runs, "_FEWEST_IN_LOOP", fewest)
    found, original = [], fitting.output_derivatives

    def kept(*given):
        found.append(original(*given))
        return found[-1]

    monkeypatch.setattr(fitting, "output_derivatives", kept)
    return fa.identify(BELIEVED, record(*loop), PATHS, progress=False), found[0]


@pytest.mark.thorough
@pytest.mark.parametrize("name", LOOPS)
def test_derivatives_equal_differences_of_the_runs(name, monkeypatch):
    exact, slopes = fit(monkeypatch, LOOPS[name], 1)
    other, differences = fit(monkeypatch, LOOPS[name], 99)
    largest = np.abs(differences).max(axis=(0, 1))
    # Differences change the outputs by the third root of the tolerance of 1e-7, and err by about
    # the square of that, 2e-5; a loop at its limits has larger curvatures.
    np.testing.assert_allclose(slopes / largest, differences / largest, rtol=0, atol=1e-4)
    assert np.any(slopes != differences)
    for result in (exact, other):
        estimates = [result[path] for path in PATHS]
        # The record has no noise; readings have the same noise in every run.
        np.testing.assert_allclose(estimates, list(NUMBERS.values()), rtol=1e-4)


@pytest.mark.thorough
def test_loops_that_are_not_differentiable_are_fitted_by_differences(monkeypatch):
    """Rounded readings have no derivative: ``sensitivities`` refuses them."""
    loop = PD, ROUNDED
    given = {"reference": fa.joint_motion(PLANT, [0.0], [0.8], 0.5), "hardware": ROUNDED}
    with pytest.raises(fa.InputError, match="resolution is not supported"):
        fa.sensitivities(PLANT, 0.8, PATHS, controller=PD, **given)
    (tried, slopes), (_, differences) = (fit(monkeypatch, loop, fewest) for fewest in (1, 99))
    np.testing.assert_array_equal(slopes, differences)
    assert tried["joints[0].hub_inertia"] == pytest.approx(0.1, rel=0.05)


@pytest.mark.thorough
def test_few_numbers_are_differentiated_by_differences(monkeypatch):
    monkeypatch.setattr(runs, "sensitivities", None)
    found = fa.identify(BELIEVED, record(PD, None), PATHS[:1], progress=False)
    assert np.isfinite(found[PATHS[0]])
    with pytest.raises(TypeError):
        fa.identify(BELIEVED, record(PD, None), PATHS, progress=False)


@pytest.mark.thorough
def test_distance_of_a_gauge_that_the_controller_reads(monkeypatch):
    """The joint angles depend on it, too, and the strain is not proportional to it."""
    found, original = [], fitting.output_derivatives

    def kept(*given):
        found.append((given, original(*given)))
        return found[-1][1]

    monkeypatch.setattr(fitting, "output_derivatives", kept)
    paths = [*PATHS, "links[0].gauges[0].distance"]
    feedback = fa.StrainFeedback(10.0, 1.5, 400.0, sample_time=0.004)
    fa.identify(BELIEVED, record(feedback, None), paths, progress=False)
    (run, space, number, vector, _), slopes = found[0]
    step = 1e-3 * vector[-1]
    moved = [space.case(number, vector + sign * step * np.eye(5)[-1]) for sign in (1.0, -1.0)]
    after, before = run.simulate(moved)
    difference = (after - before) / (2.0 * step)
    largest = np.abs(difference).max(axis=0)
    # The relative error of the differences is of the order of the squared relative step, 1e-6.
    np.testing.assert_allclose(slopes[..., -1] / largest, difference / largest, rtol=0, atol=1e-4)


def test_settings_of_open_loops_are_rejected():
    run, reference = record(PD, None).data, fa.joint_motion(PLANT, [0.0], [0.8], 0.5)
    settings = {
        "input": "torque",
        "prescribed": [1],
        "initial": "equilibrium",
        "initial_angle": [0.1],
    }
    with pytest.raises(fa.InputError) as caught:
        fa.MeasuredRecord(run, controller=PD, reference=reference, **settings)
    rule = "is not supported with a controller"
    assert [problem.name for problem in caught.value.problems if problem.rule == rule] == [
        *settings
    ]
