"""Functions of a posture accept q (dof,) and joint angles (joints,), and name both in errors."""

import numpy as np
import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, mass_per_length=0.5, flexural_rigidity=200.0, elements=2)
ARM = fa.Arm(links=[LINK, LINK.replace(length=0.8)], gravity=(0.0, -9.81))
ANGLES = [0.3, -0.5]
BENT = fa.equilibrium(ARM, ANGLES).q
#: Values of a state, in functions of q or of joint angles.
FUNCTIONS = {
    "tip": lambda state: ARM.tip(state),
    "shape": lambda state: ARM.shape(state, 3),
    "modes": lambda state: fa.modes(ARM, state).squared_frequency,
    "modes of q": lambda state: fa.modes(ARM, q=state).squared_frequency,
    "linearize": lambda state: fa.linearize(ARM, state).A,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_joint_angles_are_those_of_straight_links(name):
    function = FUNCTIONS[name]
    np.testing.assert_array_equal(function(ANGLES), function(ARM.rest(ANGLES)))
    assert not np.allclose(function(ANGLES), function(BENT))


def test_equilibrium_starts_from_q_and_keeps_its_joint_angles():
    again = fa.equilibrium(ARM, BENT)
    # Newton's method ends below a displacement of 1e-12 of the arm.
    np.testing.assert_allclose(again.q, BENT, rtol=0, atol=1e-10)
    assert again.q[ARM.joint_index].tolist() == ANGLES


def test_spinning_arm_at_joint_angles_bends_and_at_q_has_that_shape():
    arm = fa.Arm(links=[LINK, LINK], theory="second_order")
    spinning = [fa.modes(arm, **{name: ANGLES}, spin=1.0).q for name in ("joint_angles", "q")]
    np.testing.assert_array_equal(*spinning)
    assert not np.array_equal(spinning[0], arm.rest(ANGLES))
    for name in ("joint_angles", "q"):
        state = fa.modes(arm, **{name: spinning[0]}, spin=1.0)
        np.testing.assert_array_equal(state.q, spinning[0])


@pytest.mark.parametrize("name", [*FUNCTIONS, "equilibrium"])
def test_other_shapes_are_refused_with_both_names(name):
    function = FUNCTIONS.get(name, lambda state: fa.equilibrium(ARM, state))
    text = (
        r"must have shape \(10,\) as coordinates q, or \(2,\) as joint angles, got shape \(3,\)\. "
    )
    with pytest.raises(fa.InputError, match=text + r"fa\.equilibrium returns q of .*arm\.rest\("):
        function([0.1, 0.2, 0.3])
    with pytest.raises(fa.InputError, match="must be"):
        function([[0.1], [0.2, 0.3]])
    with pytest.raises(fa.InputError, match=r"\[1\] must be finite, got nan"):
        function([0.1, np.nan])
