"""Arms: joints for links, payload, gravity, limits."""

import numpy as np
import pytest

from flexarm.base.errors import ModelError
from flexarm.model import ArmSpec, Joint, Link, Payload

LINK = Link(length=1, flexural_rigidity=1, mass_per_length=1)
MASSLESS = Link(length=1, mass_per_length=0, flexible=False)


def test_defaults_are_ideal_joints_and_no_payload():
    spec = ArmSpec(links=[LINK, LINK])
    assert spec.joints == (Joint(), Joint())
    assert spec.payload == Payload(mass=0, inertia=0, offset=(0, 0))
    assert (spec.gravity, spec.theory) == ((0.0, 0.0), "linear")
    for nothing in (None, [], (), np.zeros(0)):
        assert ArmSpec(links=[LINK], joints=nothing).joints == (Joint(),)


def test_replaced_links_have_ideal_joints():
    spec = ArmSpec(links=[LINK, LINK], gravity=np.array([0, -9.81]))
    assert spec.replace(links=[LINK] * 3).joints == (Joint(),) * 3
    assert spec.replace(links=[LINK]).gravity == (0.0, -9.81)


def test_offset_of_one_number_is_along_the_tangent():
    assert Payload(offset=0.3).offset == (0.3, 0.0)
    assert Payload(offset=np.float64(0.3)).offset == (0.3, 0.0)
    assert Payload(offset=[0.3, -0.1]).offset == (0.3, -0.1)
    for wrong in (True, [1, 2, 3], "1", [1, None]):
        with pytest.raises(ModelError, match="offset"):
            Payload(offset=wrong)


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        ({}, ["links is missing."]),
        ({"links": []}, ["links must have 1 to 256 entries, got 0."]),
        (
            {"links": [LINK] * 257},
            ["links must have 1 to 256 entries, got 257."],
        ),
        ({"links": "LINK"}, ["links must be a list, got 'LINK'."]),
        (
            {"links": [LINK, LINK], "joints": [Joint()]},
            ["joints must have length 2, one joint for each link, got 1."],
        ),
        (  # the number is wrong for any links and joints
            {"links": [LINK, {}], "joints": [{"mass": -1}]},
            [
                "links[1].length is missing.",
                "joints[0].mass must be at least 0, got -1.",
                "joints must have length 2, one joint for each link, got 1.",
            ],
        ),
        (
            {"links": [LINK], "gravity": -9.81},
            [
                (
                    "gravity must be a list of two numbers, got -9.81. "
                    "Gravity that pulls down is [0, -9.81]."
                )
            ],
        ),
        (
            {"links": [LINK], "theory": "second-order", "payload": {"masss": 1}},
            [
                "payload.masss is not a known key. Did you mean 'mass'?",
                (
                    "theory must be one of 'linear', 'second_order', got 'second-order'. "
                    "Did you mean 'second_order'?"
                ),
            ],
        ),
        (
            {"links": [LINK, MASSLESS]},
            [
                (
                    "payload.mass must be greater than 0 at the tip of a massless link, got 0. "
                    "Give mass to the last link, hub_inertia to its joint, or a payload to the "
                    "arm."
                )
            ],
        ),
        (  # the hub of joint 2 turns freely, so it has no inertia about joint 1
            {"links": [MASSLESS, MASSLESS], "joints": [Joint(), Joint(hub_inertia=1)]},
            [
                (
                    "links[0] has no inertia and carries no mass. Give mass to the link or to "
                    "bodies that it carries, or hub_inertia to its joint."
                )
            ],
        ),
        (  # links with a fixed connection turn as one
            {"links": [MASSLESS, MASSLESS], "joints": [Joint(), Joint(fixed=True)]},
            [
                (
                    "payload.mass must be greater than 0 at the tip of a massless link, got 0. "
                    "Give mass to the last link, hub_inertia to its joint, or a payload to the "
                    "arm."
                )
            ],
        ),
        (  # the rotor of an elastic joint is on the near side of its spring
            {"links": [MASSLESS], "joints": [Joint(rotor_inertia=1, stiffness=1)]},
            [
                (
                    "payload.mass must be greater than 0 at the tip of a massless link, got 0. "
                    "Give mass to the last link, hub_inertia to its joint, or a payload to the "
                    "arm."
                )
            ],
        ),
    ],
)
def test_wrong_arms_are_rejected_with_every_reason(values, problems):
    with pytest.raises(ModelError) as caught:
        ArmSpec(**values)
    reported = [line for line in str(caught.value).splitlines() if "mass_per_length" not in line]
    assert reported == [f"Arm: {text}" for text in problems]


def test_massless_links_are_accepted_where_inertia_remains():
    hub, fixed = Joint(hub_inertia=1), Joint(fixed=True)
    turning = MASSLESS.replace(rotary_inertia_per_length=1)
    one, two = [MASSLESS], [MASSLESS, MASSLESS]
    for fields in (
        {"links": [MASSLESS, LINK]},
        {"links": one, "payload": Payload(mass=1)},
        {"links": one, "payload": Payload(inertia=1)},
        {"links": one, "joints": [hub]},
        {"links": two, "joints": [hub, hub]},
        {"links": two, "joints": [Joint(), Joint(mass=1, hub_inertia=1)]},
        {"links": two, "joints": [Joint(), Joint(housing_inertia=1, hub_inertia=1)]},
        {"links": two, "payload": Payload(mass=1)},
        {"links": two, "joints": [fixed, fixed]},
        {"links": two, "joints": [Joint(), fixed.replace(hub_inertia=1)]},
        {"links": two, "joints": [Joint(), fixed], "payload": Payload(inertia=1)},
        {"links": one, "joints": [Joint(rotor_inertia=1, gear_ratio=5)]},
        {"links": [turning]},
    ):
        assert ArmSpec(**fields).links == tuple(fields["links"])


def test_longest_arm_is_accepted():
    assert len(ArmSpec(links=[LINK] * 256).joints) == 256
