"""Descriptions of joints: springs, dry friction and stops."""

import pytest

import flexarm as fa
from flexarm.model import ArmSpec, Friction, Joint, JointLimits


def messages_of(model, **fields):
    with pytest.raises(fa.ModelError) as error:
        model(**fields)
    return str(error.value)


def test_defaults_are_an_ideal_joint():
    joint = Joint()
    assert (joint.stiffness, joint.rest_angle, joint.damping) == (0.0, 0.0, 0.0)
    assert joint.friction is None
    assert joint.limits is None
    assert (joint.torque_per_voltage, joint.braking) == (0.0, 0.0)
    friction = Friction(coulomb=2.0)
    assert friction.static is None
    assert (friction.stribeck_rate, friction.smoothing_rate) == (0.1, None)
    assert friction.holds
    assert friction.model_rate == pytest.approx(0.01)
    assert JointLimits(lower=-1.0, upper=1.0, stiffness=10.0).damping == 0.0


def test_mappings_become_records():
    joint = Joint(
        friction={"coulomb": 1.0, "static": 1.5},
        limits={"lower": -1, "upper": 2, "stiffness": 100, "damping": 0.1},
    )
    assert joint.friction == Friction(coulomb=1.0, static=1.5)
    assert joint.limits == JointLimits(lower=-1.0, upper=2.0, stiffness=100.0, damping=0.1)


@pytest.mark.parametrize(
    ("model", "fields", "message"),
    [
        (Friction, {}, "coulomb is missing"),
        (Friction, {"coulomb": -1.0}, "coulomb must be at least 0, got -1."),
        (
            Friction,
            {"coulomb": 2.0, "static": 1.5},
            "static must be at least coulomb (2), got 1.5.",
        ),
        (Friction, {"coulomb": 1.0, "smoothing_rate": 0.0}, "must be greater than 0, got 0."),
        (Friction, {"coulomb": 1.0, "stribeck_rate": -1}, "must be greater than 0, got -1."),
        (
            JointLimits,
            {"lower": 1.0, "upper": 1.0, "stiffness": 1.0},
            "upper must be greater than lower (1), got 1.",
        ),
        (JointLimits, {"lower": 0.0, "upper": 1.0}, "stiffness is missing"),
        (
            JointLimits,
            {"lower": 0.0, "upper": 1.0, "stiffness": 0.0},
            "stiffness must be greater than 0, got 0.",
        ),
        (
            JointLimits,
            {"lower": 0.0, "upper": 1.0, "stiffness": 1.0, "damping": -0.1},
            "damping must be at least 0, got -0.1.",
        ),
        (Joint, {"stiffness": -1.0}, "stiffness must be at least 0, got -1."),
        (Joint, {"rest_angle": float("nan")}, "rest_angle must be"),
        (Joint, {"friction": 3.0}, "friction must be a mapping of keys to values, got 3."),
    ],
)
def test_wrong_joints_are_rejected(model, fields, message):
    assert message in messages_of(model, **fields)


def test_all_problems_of_a_joint_are_reported():
    text = messages_of(
        Joint,
        stiffness=-1.0,
        friction={"coulomb": -1.0},
        limits={"lower": 1.0, "upper": 0.0, "stiffness": 1.0},
    )
    assert len(text.splitlines()) == 3


def test_joints_are_written_to_a_file_and_read(tmp_path):
    joint = Joint(
        stiffness=3.0,
        rest_angle=-0.4,
        friction=Friction(coulomb=1.0, static=2.0, smoothing_rate=0.05),
        limits=JointLimits(lower=-1.5, upper=0.5, stiffness=100.0, damping=0.3),
    )
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=6, segments=3)
    arm = fa.Arm(ArmSpec(links=[link, link], joints=[joint, Joint(damping=0.1)]))
    fa.save_arm(arm, tmp_path / "arm.yaml")
    assert fa.load_arm(tmp_path / "arm.yaml").spec == arm.spec
