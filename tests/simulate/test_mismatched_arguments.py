"""Arguments that do not match a run are rejected before it, with one sentence each."""

import numpy as np
import pytest

import flexarm as fa

LINK = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
GAUGES = [fa.Gauge(station=0.1, distance=0.005)]


def arm_of(links, gauges=0, **more):
    """Return an arm whose first ``gauges`` links have one gauge each."""
    made = [fa.Link(length=0.7, gauges=GAUGES if k < gauges else [], **LINK) for k in range(links)]
    return fa.Arm(links=made, joints=[fa.Joint(hub_inertia=0.05)] * links, **more)


@pytest.fixture(scope="module")
def arm():
    return arm_of(2)


def problems_of(arm, controller, **options):
    with pytest.raises(fa.InputError) as caught:
        fa.simulate(arm, 0.01, controller=controller, **options)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(
    "controller",
    [
        fa.JointPD([1.0, 1.0, 1.0], 1.0),
        fa.JointPD(1.0, [1.0, 1.0, 1.0]),
        fa.JointPID(1.0, 1.0, torque_limit=[1.0, 1.0, 1.0]),
        fa.StrainFeedback(1.0, 1.0, np.zeros((3, 2))),
        fa.ComputedTorque(arm_of(3), 1.0),
        fa.DisturbanceObserver(arm_of(2), fa.JointPD([1.0, 1.0, 1.0], 1.0)),
    ],
    ids=lambda controller: type(controller).__name__,
)
def test_controllers_for_another_number_of_joints_are_rejected(controller):
    reported = problems_of(arm_of(2, gauges=2), controller)
    assert reported == ["simulate: controller is for 3 joints, but the arm has 2."]


def test_one_gain_for_all_joints_fits_every_arm(arm):
    for model in (arm, arm_of(1)):
        start = model.rest(np.full(model.n_joints, 0.1))
        hold = fa.joint_motion(model, np.zeros(model.n_joints), np.zeros(model.n_joints), 1.0)
        result = fa.simulate(
            model, 0.01, controller=fa.JointPD(2.0, 1.0), reference=hold, initial=start
        )
        np.testing.assert_allclose(result.torque[0], np.full(model.n_joints, -0.2), rtol=1e-12)


@pytest.mark.parametrize(
    ("controller", "gauges", "wanted"),
    [
        (fa.StrainFeedback(1.0, 1.0, 1.0), 1, 2),
        (fa.StrainFeedback(1.0, 1.0, [1.0, 1.0]), 0, 2),
        (fa.StrainFeedback(1.0, 1.0, [[1.0], [1.0]]), 2, 1),
        (fa.LQG(arm_of(2, gauges=2)), 1, 2),
        (fa.Adaptive(arm_of(2, gauges=1), 1.0, 1.0, 1.0, strain_gain=[1.0, 0.0]), 2, 1),
    ],
)
def test_missing_gauges_are_reported(controller, gauges, wanted):
    (reported,) = problems_of(arm_of(2, gauges=gauges), controller)
    called = type(controller).__name__
    plural = "s" * (wanted != 1)
    rule = f"must have the {wanted} gauge{plural} that {called} reads, got {gauges}"
    rule = rule if gauges else f"has no gauges, but {called} reads strain"
    assert reported == f"simulate: arm {rule}."


def test_missing_gauges_of_the_plant_are_reported():
    believed = arm_of(2, gauges=2)
    reported = problems_of(believed, fa.LQG(believed), plant=arm_of(2))
    assert reported == ["simulate: arm has no gauges, but LQG reads strain."]


def test_every_missing_reading_is_reported(arm):
    hardware = fa.Hardware([fa.Instrument("tip")])
    reported = problems_of(arm, fa.JointPD(1.0, 1.0), hardware=hardware)
    assert reported == [
        (
            "simulate: hardware has no instrument for joint_angle, which JointPD reads; it "
            "measures tip."
        ),
        (
            "simulate: hardware has no instrument for joint_rate, which JointPD reads; it "
            "measures tip."
        ),
    ]


def test_misspelled_reading_has_a_suggestion(arm):
    misnamed = fa.Instrument("joint_angle", name="joint_angles", rate_cutoff=50.0)
    misnamed = fa.Hardware([misnamed, fa.Instrument("joint_rate")])
    (reported,) = problems_of(arm, fa.JointPD(1.0, 1.0), hardware=misnamed)
    assert reported.endswith("Did you mean 'joint_angles'?")


def test_readings_besides_the_exact_ones_need_hardware(arm):
    measured = {"joint_angle": 1e-4, "tip": 1e-3}
    (reported,) = problems_of(arm, fa.LQG(arm, measured=measured))
    assert reported == ("simulate: hardware has no instrument for tip, which LQG reads.")
    angles = fa.Instrument("joint_angle", rate_cutoff=100.0)
    hardware = fa.Hardware([angles, fa.Instrument("tip")])
    fa.simulate(arm, 0.01, controller=fa.LQG(arm, measured=measured), hardware=hardware)


def test_class_in_place_of_a_controller_is_rejected(arm):
    (reported,) = problems_of(arm, fa.JointPD)
    assert reported == (
        "simulate: controller must be a controller, got the class JointPD. "
        "Create an object: JointPD(...)."
    )
    with pytest.raises(fa.InputError, match="inner must be a controller, got the class JointPD"):
        fa.DisturbanceObserver(arm, fa.JointPD)
    with pytest.raises(fa.InputError, match="controller must be a controller, got the class"):
        fa.compare(
            arm, {"pd": fa.JointPD}, 0.01, {"still": fa.joint_motion(arm, [0, 0], [0, 0], 1)}
        )


class Own(fa.Controller):
    """A controller of a user, with readings of its choice."""

    sample_time = 0.01

    def __init__(self, read, requirements=None):
        self.read, self.wanted = read, requirements

    def requirements(self, arm, reference):
        return super().requirements(arm, reference) if self.wanted is None else self.wanted

    def update(self, t, measurement, reference):
        self.read(measurement)
        return [0.0, 0.0]


def test_controllers_of_users_may_state_their_requirements(arm):
    (reported,) = problems_of(arm, Own(lambda m: None, fa.ControllerRequirements(joints=3)))
    assert "controller is for 3 joints, but the arm has 2" in reported
    (reported,) = problems_of(
        arm, Own(lambda m: None, fa.ControllerRequirements(measured=("tip",)))
    )
    assert "no instrument for tip, which Own reads" in reported
    fa.simulate(arm, 0.01, controller=Own(lambda m: m.joint_angle))


@pytest.mark.parametrize("read", [lambda m: m.joint_angel, lambda m: m["joint_angel"]])
def test_misspelled_requirement_has_a_suggestion(arm, read):
    with pytest.raises(
        fa.SimulationError, match="available readings: joint_angle, joint_rate, strain"
    ) as e:
        fa.simulate(arm, 0.01, controller=Own(read))
    assert "no instrument measures 'joint_angel'" in str(e.value)
    assert "Did you mean 'joint_angle'?" in str(e.value)
