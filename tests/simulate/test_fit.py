"""What does not fit a run is refused before it, in one sentence."""

import numpy as np
import pytest

import flexarm as fa

LINK = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
GAUGES = [fa.Gauge(station=0.1, distance=0.005)]


def arm_of(links, gauges=0, **more):
    """An arm whose first ``gauges`` links carry one gauge each."""
    made = [fa.Link(length=0.7, gauges=GAUGES if k < gauges else [], **LINK) for k in range(links)]
    return fa.Arm(links=made, joints=[fa.Joint(hub_inertia=0.05)] * links, **more)


@pytest.fixture(scope="module")
def arm():
    return arm_of(2)


def refused(arm, controller, **options):
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
def test_controllers_for_another_number_of_joints(controller):
    told = refused(arm_of(2, gauges=2), controller)
    assert told == ["simulate: controller is for 3 joints, but the arm has 2."]


def test_one_number_for_all_joints_fits_every_arm(arm):
    fa.simulate(arm, 0.01, controller=fa.JointPD(1.0, 1.0))
    fa.simulate(arm_of(1), 0.01, controller=fa.JointPD(1.0, 1.0))


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
def test_gauges_that_the_arm_lacks(controller, gauges, wanted):
    (told,) = refused(arm_of(2, gauges=gauges), controller)
    called = type(controller).__name__
    plural = "s" * (wanted != 1)
    rule = f"must have the {wanted} gauge{plural} that {called} reads, got {gauges}"
    rule = rule if gauges else f"has no gauges, but {called} reads strain"
    assert told == f"simulate: arm {rule}."


def test_a_plant_without_the_gauges_of_the_arm_believed_in():
    believed = arm_of(2, gauges=2)
    told = refused(believed, fa.LQG(believed), plant=arm_of(2))
    assert told == ["simulate: arm has no gauges, but LQG reads strain."]


def test_every_reading_that_is_missing(arm):
    hardware = fa.Hardware([fa.Instrument("tip")])
    told = refused(arm, fa.JointPD(1.0, 1.0), hardware=hardware)
    assert told == [
        (
            "simulate: hardware has no instrument for joint_angle, which JointPD reads; it "
            "measures tip."
        ),
        (
            "simulate: hardware has no instrument for joint_rate, which JointPD reads; it "
            "measures tip."
        ),
    ]


def test_a_reading_under_nearly_its_name(arm):
    misnamed = fa.Instrument("joint_angle", name="joint_angles", rate_cutoff=50.0)
    misnamed = fa.Hardware([misnamed, fa.Instrument("joint_rate")])
    (told,) = refused(arm, fa.JointPD(1.0, 1.0), hardware=misnamed)
    assert told.endswith("Did you mean 'joint_angles'?")


def test_readings_beyond_the_exact_ones_need_hardware(arm):
    measured = {"joint_angle": 1e-4, "tip": 1e-3}
    (told,) = refused(arm, fa.LQG(arm, measured=measured))
    assert told == ("simulate: hardware has no instrument for tip, which LQG reads.")
    angles = fa.Instrument("joint_angle", rate_cutoff=100.0)
    hardware = fa.Hardware([angles, fa.Instrument("tip")])
    fa.simulate(arm, 0.01, controller=fa.LQG(arm, measured=measured), hardware=hardware)


def test_a_class_is_no_controller(arm):
    (told,) = refused(arm, fa.JointPD)
    assert told == (
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
    """A controller of a user, that reads what it likes."""

    sample_time = 0.01

    def __init__(self, read, requirements=None):
        self.read, self.wanted = read, requirements

    def requirements(self, arm, reference):
        return super().requirements(arm, reference) if self.wanted is None else self.wanted

    def update(self, t, measurement, reference):
        self.read(measurement)
        return [0.0, 0.0]


def test_own_controllers_may_say_what_they_need(arm):
    (told,) = refused(arm, Own(lambda m: None, fa.ControllerRequirements(joints=3)))
    assert "controller is for 3 joints, but the arm has 2" in told
    (told,) = refused(arm, Own(lambda m: None, fa.ControllerRequirements(measured=("tip",))))
    assert "no instrument for tip, which Own reads" in told
    fa.simulate(arm, 0.01, controller=Own(lambda m: m.joint_angle))


@pytest.mark.parametrize("read", [lambda m: m.joint_angel, lambda m: m["joint_angel"]])
def test_a_mistyped_reading_names_the_right_one(arm, read):
    with pytest.raises(
        fa.SimulationError, match="measured are: joint_angle, joint_rate, strain"
    ) as e:
        fa.simulate(arm, 0.01, controller=Own(read))
    assert "no instrument measures 'joint_angel'" in str(e.value)
    assert "Did you mean 'joint_angle'?" in str(e.value)


def test_mistyped_names_elsewhere():
    arm = arm_of(2)
    with pytest.raises(fa.InputError, match=r"Did you mean 'joint_angle'\?"):
        fa.Instrument("joint_angel")
    with pytest.raises(fa.InputError, match=r"Did you mean 'joint_angle'\?"):
        fa.LQG(arm, measured={"joint_angel": 1e-4})
    with pytest.raises(fa.InputError, match=r"Did you mean 'payload.mass'\?"):
        fa.Adaptive(arm, 1.0, 1.0, 1.0, parameters=["payload.mas"])
    with pytest.raises(fa.InputError, match=r"Did you mean 'payload.mass'\?"):
        fa.Adaptive(arm, 1.0, 1.0, 1.0, bounds={"payload.mas": (0.0, 1.0)})
