"""Jacobians of one step against differences of high order, by state, torque and every parameter."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.model.paths import number_at

STEP = 2e-3
#: Truncation of a difference of order 8, with steps chosen for it.
CLOSE = 1e-9
#: Rounding of one step, which stiff modes and the weights of the method of order 8 (up to 40)
#: increase ten-thousandfold, over the difference's step.
ROUNDING = 1e-12 / STEP
_WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}


def difference(function, step=STEP):
    """Return a central difference of order 8 at zero."""
    return sum(w * (function(k * step) - function(-k * step)) for k, w in _WEIGHTS.items()) / step


def an_arm(theory="linear", length=1.0, mass=1.0, rigidity=1.0, payload=0.4, inertia=0.02, **more):
    rod = {"flexural_rigidity": 60.0, "mass_per_length": 0.7}
    changed = {"flexural_rigidity": 60.0 * rigidity, "mass_per_length": 0.7 * mass}
    links = [
        fa.Link(
            length=1.2, elements=2, damping=fa.RayleighDamping(stiffness_coefficient=1e-4), **rod
        ),
        fa.Link(
            length=0.9 * length,
            elements=2,
            damping=fa.RayleighDamping(stiffness_coefficient=1e-3),
            **changed,
            **more,
        ),
    ]
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05, mass=0.3, damping=0.2)]
    cargo = fa.Payload(mass=payload, inertia=inertia, offset=(0.05, 0.1))
    return fa.Arm(links=links, joints=joints, payload=cargo, theory=theory, gravity=(0.0, -9.81))


def a_state(arm):
    rng = np.random.default_rng(5)
    # The second-order mass matrix is nearly singular if links bend far (theory page "link").
    size = 0.05 if arm.spec.theory == "linear" else 0.005
    return size * rng.standard_normal((2, arm.dof)), np.array([3.0, -1.0])


H = 5e-4


def stepped(arm, x, torque, method="rk4"):
    q, qd = x
    after = fa.step_jacobian(arm, q, qd, torque, H, method=method)
    return np.concatenate([after.q, after.qd])


def assert_close(exact, wanted, after, size=1.0):
    rounding = ROUNDING / size * np.max(np.abs([after.q, after.qd]))
    allowed = CLOSE * np.max(np.abs(wanted)) + rounding
    np.testing.assert_allclose(exact, wanted, rtol=0, atol=allowed)
    assert allowed < 1e-4 * np.max(np.abs(wanted))  # the check is not trivial


@pytest.mark.sampled("linear-rk4", "linear-dormand_prince_8", "second_order-kennedy_carpenter_5")
@pytest.mark.parametrize("method", ["rk4", "dormand_prince_8", "kennedy_carpenter_5"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_derivatives_by_state_and_torque(method, theory):
    arm = an_arm(theory)
    x, torque = a_state(arm)
    found = fa.step_jacobian(arm, *x, torque, H, method=method)
    for place in range(0, 2 * arm.dof, 3):
        unit = np.eye(2 * arm.dof)[place].reshape(2, -1)
        wanted = difference(lambda s, u=0.05 * unit: stepped(arm, x + s * u, torque, method)) / 0.05
        assert_close(found.state[:, place], wanted, found, size=0.05)
    for joint in range(2):
        unit = np.eye(2)[joint]
        wanted = (
            difference(lambda s, u=unit: stepped(arm, x, torque + 100.0 * s * u, method)) / 100.0
        )
        assert_close(found.torque[:, joint], wanted, found, size=100.0)


@pytest.mark.sampled(
    "link_2.length-length-more2-linear-rk4",
    "link_2.length-length-more1-second_order-kennedy_carpenter_5",
    "link_2.mass-mass-more0-second_order-rk4",
    "link_2.mass-mass-more2-linear-kennedy_carpenter_5",
    "link_2.rigidity-rigidity-more1-linear-kennedy_carpenter_5",
    "link_2.rigidity-rigidity-more2-second_order-rk4",
    "payload.mass-payload-more1-linear-rk4",
    "payload.mass-payload-more2-second_order-kennedy_carpenter_5",
    "payload.inertia-inertia-more0-linear-kennedy_carpenter_5",
    "payload.inertia-inertia-more1-second_order-rk4",
)
@pytest.mark.parametrize("method", ["rk4", "kennedy_carpenter_5"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("more", [{}, {"modes": 3}, {"segments": 2}])
@pytest.mark.parametrize(
    ("parameter", "field"),
    [
        ("links[1].length", "length"),
        ("links[1].mass_per_length", "mass"),
        ("links[1].flexural_rigidity", "rigidity"),
        ("payload.mass", "payload"),
        ("payload.inertia", "inertia"),
    ],
)
def test_derivatives_by_parameters(method, theory, more, parameter, field):
    arm = an_arm(theory, **more)
    x, torque = a_state(arm)
    base = {"payload": 0.4, "inertia": 0.02}.get(field, 1.0)
    value = number_at("", arm.spec, parameter)

    def changed(s):
        return stepped(an_arm(theory, **{field: base * (1.0 + s)}, **more), x, torque, method)

    wanted = difference(changed) / value
    found = fa.step_jacobian(arm, *x, torque, H, method=method, parameters=[parameter])
    assert_close(found.parameters[parameter], wanted, found, value)


@pytest.mark.filterwarnings(
    "ignore::flexarm.LargeDeflectionWarning"
)  # bent far, so that every term matters
@pytest.mark.parametrize("method", ["rk4", "dormand_prince_8", "kennedy_carpenter_5"])
def test_step_equals_that_of_simulate(method):
    arm = an_arm()
    (q, qd), torque = a_state(arm)
    after = fa.step_jacobian(arm, q, qd, torque, H, method=method)
    run = fa.simulate(
        arm,
        H,
        torque=lambda t: torque,
        initial=q,
        initial_rate=qd,
        integrator=method,
        step=H,
        rate=1 / H,
        rtol=0.99,  # for any error: one step
        atol=1.0,
    )
    assert run.attrs["steps"] == 1
    np.testing.assert_allclose(run.q.values[-1], after.q, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.qd.values[-1], after.qd, rtol=1e-12, atol=1e-12)


# The soft links hang down far, which does not affect the comparison.
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_step_longer_than_its_fast_modes():
    """Implicit steps may be so long: 40 radians of the fastest mode at once, with derivatives."""
    arm = an_arm()
    rest = fa.equilibrium(arm, [0.3, -0.5])
    x, torque = np.stack([rest.q, np.zeros(arm.dof)]), rest.torque + np.array([1.0, -0.5])
    fastest = 2.0 * np.pi * fa.modes(arm).frequency_hz[-1]
    h = 40.0 / fastest
    found = fa.step_jacobian(arm, *x, torque, h, method="kennedy_carpenter_5")
    along = 1e-3 * np.random.default_rng(3).standard_normal((2, arm.dof))

    def after(s):
        q, qd = x + s * along
        step = fa.step_jacobian(arm, q, qd, torque, h, method="kennedy_carpenter_5")
        return np.concatenate([step.q, step.qd])

    wanted = difference(after, 2e-3)
    # Truncation of the difference, and its rounding: 1e-15 over steps of 2e-3.
    np.testing.assert_allclose(
        found.state @ along.ravel(), wanted, rtol=0, atol=1e-8 * np.abs(wanted).max()
    )
    # L-stable: the fastest modes almost vanish, while an explicit method diverges.
    assert np.abs(np.linalg.eigvals(found.state)).max() < 1.2
    explicit = fa.step_jacobian(arm, *x, torque, h, method="rk4")
    assert np.abs(np.linalg.eigvals(explicit.state)).max() > 1e3


def test_wrong_arguments_are_rejected():
    arm = an_arm(rotary_inertia_per_length=1e-3)
    (q, qd), torque = a_state(arm)
    fa.step_jacobian(
        arm, q, qd, torque, H, parameters=["links[1].flexural_rigidity", "links[0].length"]
    )
    with pytest.raises(fa.InputError, match="closed form"):
        fa.step_jacobian(arm, q, qd, torque, H, parameters=["links[1].length"])
    with pytest.raises(fa.InputError, match=r"links\[2\]"):
        fa.step_jacobian(arm, q, qd, torque, H, parameters=["links[2].length"])
    with pytest.raises(fa.InputError, match=r"method must be one of 'rk4'.*got 'euler'\.$"):
        fa.step_jacobian(arm, q, qd, torque, H, method="euler")
    with pytest.raises(fa.InputError, match=r"got 'cowell_4'\. Multistep and iterative methods"):
        fa.step_jacobian(arm, q, qd, torque, H, method="cowell_4")
