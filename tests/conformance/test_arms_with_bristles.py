"""Functions with an arm as their argument either contain bristles or say that they do not.

A new public function is in one of three tables, by its name.
"""

import warnings

import pytest

import flexarm as fa
from fuzz.arm_calls import arm
from fuzz.base_calls import FUNCTIONS, spinning

#: Linear models and modes: they have friction as a function of the rate.
WARN = {
    *(
        "MuSynthesis",
        "campbell",
        "design",
        "flexible_torque",
        "linearize",
        "linearize_along",
        "modes",
    ),
    *("optimal_motion", "quasi_static_reference", "shaped", "step_jacobian"),
    *("tip_inversion", "track_modes"),
}
REFUSE = {"goal_gradient", "simulate_separated"}
#: Runs, which contain bristles, and functions without the slope of friction. Models of loops are
#: those of a sliding joint, at which friction is constant.
NEITHER = {
    *("Plant", "compare", "converged", "iterative_learning", "sensitivities", "simulate"),
    *("simulate_batch", "contact_event", "equilibrium", "joint_event", "pressed_motion"),
    *("rigid_torque", "save_arm", "tip_event", "varied"),
    *("loop_margins", "loop_models", "robustness"),
}


#: Valid arguments of the functions of an arm.
CALLS = {
    name: given
    for name, given in FUNCTIONS.items()
    if any(value is arm or value is spinning for value in given.values())
}


def with_bristles(make):
    """Return an arm with bristles, whose friction is too weak for errors of other kinds."""
    friction = fa.Friction(coulomb=1e-4, bristle_stiffness=1.0)
    spec = make().spec
    return fa.Arm(spec.replace(joints=[one.replace(friction=friction) for one in spec.joints]))


def made(value):
    if value is arm or value is spinning:
        return with_bristles(value)
    return value() if callable(value) and not isinstance(value, type) else value


@pytest.mark.thorough_cases("shaped", "design", "optimal_motion", "save_arm", "tip_inversion")
@pytest.mark.parametrize("name", CALLS)
def test_every_function_of_an_arm(name):
    given = {key: made(value) for key, value in CALLS[name].items()}
    refused = ""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        try:
            getattr(fa, name)(**given)
        except fa.InputError as error:
            refused = str(error)
    warned = any("Bristles" in str(one.message) for one in found)
    assert name in WARN | REFUSE | NEITHER
    assert warned == (name in WARN)
    assert ("cannot be combined with bristles" in refused) == bool(refused) == (name in REFUSE)
