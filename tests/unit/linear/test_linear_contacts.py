"""Equilibria and linear models of arms in contact with surfaces."""

import numpy as np
import pytest

import flexarm as fa

ROD = {"length": 0.8, "mass_per_length": 0.6, "flexural_rigidity": 60.0, "elements": 2, "modes": 2}


def arm(**more):
    return fa.Arm(links=[fa.Link(**ROD), fa.Link(**ROD)], **more)


def test_motor_presses_a_bar_on_a_wall():
    """Torque = force x lever, depth = force / stiffness: a rigid bar in closed form."""
    bar = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    contact = fa.Contact(fa.Wall((1.0, 0.0), (0.0, -1.0)), 1e5, friction=0.3)
    rest = fa.equilibrium(bar, torque=[8.0], contacts=[contact])
    assert rest.stable
    # The lever is cos q, q = 8e-5: shorter than one by 3e-9.
    assert rest.q[0] == pytest.approx(8.0 / 1e5, rel=1e-8)
    # M = 1/3: the frequency of the bar on the spring.
    assert rest.lowest_eigenvalue == pytest.approx(1e5 / (1.0 / 3.0), rel=1e-6)
    modes = fa.modes(bar, rest, joints="free")
    assert modes.frequency_hz[0] == pytest.approx(np.sqrt(3e5) / (2 * np.pi), rel=1e-6)


def test_arm_that_leans_on_a_post_is_in_equilibrium():
    heavy = arm(gravity=(0.0, -9.81), joints=[fa.Joint(damping=0.5)] * 2)
    post = fa.Contact(fa.RoundWall((1.38, -0.42), 0.3), 1e4, link=2, station=0.6)
    rest = fa.equilibrium(heavy, [0.0, -0.2], contacts=[post])
    zero = np.zeros(heavy.dof)
    left = heavy.forward_dynamics(rest.q, zero, rest.torque, contacts=[post])
    free = heavy.forward_dynamics(rest.q, zero, rest.torque)
    # Rounding of the stiffest mode's force relative to the contact force.
    assert abs(left).max() < 1e-8 * abs(free).max()
    assert rest.contacts == (post,)


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # bent by more than 10 %
def test_linear_model_of_a_pressed_arm():
    """Against central differences of the accelerations and of the force."""
    wall = fa.Contact(
        fa.Wall((1.2, 0.0), (-1.0, 0.1)), 1e4, damping=0.3, friction=0.2, friction_speed=0.05
    )
    flat = arm()
    rest = fa.equilibrium(flat, [-0.4, 0.95], contacts=[wall])
    wanted = ["contact_force", "contact_gap", "tip"]
    model = fa.linearize(flat, rest, outputs=wanted)
    assert model.outputs[:3] == ("contact_force[1,x]", "contact_force[1,y]", "contact_gap[1]")
    assert model.units["contact_force[1,x]"] == "N"
    assert model.output[0] < -1.0
    again = fa.linearize(flat, rest.q, torque=rest.torque, outputs=wanted, contacts=[wall])
    np.testing.assert_array_equal(again.A, model.A)
    n, step = flat.dof, 1e-7
    for k in range(2 * n):
        ends = []
        for sign in (1.0, -1.0):
            state = np.concatenate([rest.q, np.zeros(n)])
            state[k] += sign * step
            moved = fa.linearize(
                flat, state[:n], state[n:], rest.torque, outputs=wanted, contacts=[wall]
            )
            ends.append(np.concatenate([moved.drift[n:], moved.output]))
        slope = (ends[0] - ends[1]) / (2.0 * step)
        exact = np.concatenate([model.A[n:, k], model.C[:, k]])
        # Rounding over the step, beside the stiffest entries of a row.
        size = np.concatenate([abs(model.A[n:]).max(axis=1), abs(model.C).max(axis=1)])
        assert np.all(abs(slope - exact) <= 1e-5 * size + 1e-6)


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # bent by more than 10 %
def test_unsupported_linear_models_with_contacts_are_rejected():
    flat = arm()
    with pytest.raises(fa.InputError, match="outputs contain contact_force"):
        fa.linearize(flat, flat.rest([0.0, 0.0]), outputs=["contact_force"])
    wall = fa.Contact(fa.Wall((1.2, 0.0), (-1.0, 0.0)), 1e4)
    rest = fa.equilibrium(flat, [-0.4, 0.95], contacts=[wall])
    with pytest.raises(fa.InputError, match="torque, loads and contacts cannot be combined"):
        fa.linearize(flat, rest, contacts=[wall])
