"""Axial loads that the linear theory neglects: stability of equilibria, and warnings.

References are Euler's and Greenhill's columns, and the arm with the second-order theory, whose
kernels contain the geometric stiffness that the estimate of a warning is about.
"""

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.actions import Environment
from flexarm.linear.statics.axial import Acting, AxialLoads
from flexarm.linear.statics.equilibrium import tangent
from random_arms import random_spec

EULER, GREENHILL = np.pi**2 / 4, 7.83734743894
AXIAL = "carries an axial"


NOTHING = Environment()


def column(gravity=0.0, theory="linear", **spec):
    """Return a link of unit length, stiffness and mass; gravity along it, towards its root."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=4)
    return fa.Arm(links=[link], gravity=(-gravity, 0.0), theory=theory, **spec)


def shares(arm, q, qd=None, environment=NOTHING):
    """Return the estimated shares (pieces,) at q and qd."""
    states = arm.padded(np.stack([q, np.zeros_like(q) if qd is None else qd]))[None]
    acting = Acting.constant(environment.placed(arm))
    return AxialLoads(arm).shares(np.zeros(1), states, acting)[0]


def exact_shares(arm, q, qd=None, environment=NOTHING, qdd=None):
    """Return the extreme eigenvalues of the geometric over the elastic stiffness of each piece."""
    second = fa.Arm(arm.spec.replace(theory="second_order"))
    state = q, *(np.zeros_like(q) if rate is None else rate for rate in (qd, qdd))
    change = tangent(second, *state, environment).stiffness
    change -= tangent(arm, *state, environment).stiffness
    found = []
    for piece in arm.assembly.pieces:
        root = 1.0 / np.sqrt(piece.shapes.w2)
        part = change[piece.modal, piece.modal]
        values = np.linalg.eigvalsh(root[:, None] * (part + part.T) / 2.0 * root)
        found.append(values[0] if -values[0] > values[-1] else values[-1])
    return np.array(found)


def texts(call):
    """Return the texts of the warnings of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(one.message) for one in caught]


@pytest.mark.sampled("0.99-second_order", "1.01-linear", "1.5-second_order")
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("fraction", [0.5, 0.99, 1.01, 1.5])
def test_column_is_stable_below_its_buckling_load_only(theory, fraction):
    pushed = fa.equilibrium(column(theory=theory), tip_force=(-fraction * EULER, 0.0))
    standing = fa.equilibrium(column(fraction * GREENHILL, theory))
    for found in (pushed, standing):
        assert found.stable == (fraction < 1.0)
        assert (found.lowest_eigenvalue > 0.0) == (fraction < 1.0)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_self_buckling_under_a_mass_at_the_tip():
    """Weight and payload together; the buckling load is that of the second-order theory."""
    for gravity in np.linspace(0.5, 2.5, 9):
        found = [
            fa.equilibrium(column(gravity, theory, payload=fa.Payload(mass=1.0)))
            for theory in ("linear", "second_order")
        ]
        assert found[0].stable == found[1].stable
        # Both are the same polynomial of the stiffness; the masses differ by nothing at rest.
        assert found[0].lowest_eigenvalue == pytest.approx(found[1].lowest_eigenvalue, rel=1e-9)


def test_pressed_column_counts_the_force_of_the_contact():
    wall = fa.Contact(fa.Wall((1.0 - 1.5 * EULER / 1e4, 0.0), (-1.0, 0.0)), 1e4)
    with pytest.warns(fa.LargeDeflectionWarning, match="compression of 1.5 times"):
        assert not fa.equilibrium(column(), contacts=[wall]).stable


@pytest.mark.thorough
def test_estimate_equals_the_second_order_theory_on_random_arms():
    rng = np.random.default_rng(7)
    for _ in range(20):
        arm = fa.Arm(random_spec(rng, theory="linear", rigid=False, gravity=True))
        q = arm.rest(rng.normal(size=arm.n_joints))
        loads = [
            fa.Load(1, tuple(rng.normal(size=2) * 10.0), frame="link"),
            fa.Load(arm.n_links, tuple(rng.normal(size=2) * 20.0)),
        ]
        environment = Environment.of(arm, rng.normal(size=2) * 20.0, loads)
        exact = exact_shares(arm, q, environment=environment)
        # Tip forces, weight and rotation have somewhat different shapes of their lowest loads.
        found = shares(arm, q, environment=environment)
        np.testing.assert_allclose(found, exact, rtol=0.03, atol=0.003)
        qd = arm.rest(rng.normal(size=arm.n_joints) * 3.0)
        still = fa.Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        exact = exact_shares(still, q, qd)
        np.testing.assert_allclose(shares(still, q, qd), exact, rtol=0.03, atol=0.003)
        inside = Environment([fa.Load(1, (5.0, 1.0), station=0.6 * arm.lengths[0])])
        exact = exact_shares(still, q, environment=inside)[0]
        assert shares(still, q, environment=inside)[0] == pytest.approx(exact, rel=0.5)


@pytest.mark.sampled("-0.35-0.0", "0.32-0.0", "0.0-1.9")
@pytest.mark.parametrize(
    ("force", "spin"),
    [(-0.32, 0.0), (-0.35, 0.0), (0.32, 0.0), (0.35, 0.0), (0.0, 1.8), (0.0, 1.9)],
)
def test_all_calls_warn_above_a_third_of_the_buckling_load(force, spin):
    """Spin: its share is 0.0983 spin^2 for a uniform link, the largest eigenvalue of D1 over K."""
    arm, load = column(), (force * EULER, 0.0)
    rates = arm.rest([spin])
    expected = max(abs(force), 0.0983 * spin**2) > 1.0 / 3.0
    calls = [
        lambda: fa.linearize(arm, arm.rest([0.0]), rates, tip_force=load),
        lambda: fa.modes(arm, spin=spin, tip_force=None if spin else load),
        lambda: fa.simulate(arm, 2.0, initial_rate=rates, tip_force=load, rate=100.0),
        lambda: fa.simulate_batch(arm, 2.0, initial_rate=rates, tip_force=load, rate=100.0),
        *([] if spin else [lambda: fa.equilibrium(arm, tip_force=load)]),
    ]
    for call in calls:
        assert [AXIAL in text for text in texts(call)] == [True] * expected
    second = column(theory="second_order")
    assert not texts(lambda: fa.linearize(second, second.rest([0.0]), rates, tip_force=load))


def test_reported_change_is_that_of_the_frequency():
    arm, load = column(), (-0.6 * EULER, 0.0)
    (text,) = texts(lambda: fa.modes(arm, tip_force=load))
    with pytest.warns(fa.LargeDeflectionWarning):
        linear = fa.modes(arm, tip_force=load).frequency_hz[0]
    exact = fa.modes(column(theory="second_order"), tip_force=load).frequency_hz[0]
    reported = float(text.split("frequencies by ")[1].split("%")[0]) / 100.0
    # The first mode is not Euler's buckling mode: without load it has 1.08 of its buckling load.
    assert 1.0 - exact / linear == pytest.approx(reported, abs=0.03)


def test_short_forces_give_no_warning():
    """A blow along a link does not last for a period of its vibration, 1.8 s."""
    arm = column()
    for lasting, expected in ((0.05, False), (1.5, True)):
        factor = ([0.0, lasting, lasting, 4.0], [1.0, 1.0, 0.0, 0.0])
        load = fa.Load(1, (-EULER, 0.0), factor=factor)
        found = texts(lambda: fa.simulate(arm, 4.0, loads=[load], rate=200.0))  # noqa: B023
        assert [AXIAL in text for text in found] == [True] * expected


def test_joint_accelerations_are_included():
    """They are so small that the rates have no effect."""
    rng = np.random.default_rng(5)
    for _ in range(5):
        arm = fa.Arm(random_spec(rng, theory="linear", rigid=False, gravity=False, links=3))
        q = arm.rest(rng.normal(size=arm.n_joints))
        qdd = arm.rest(rng.normal(size=arm.n_joints) * 1e-6)
        times = np.arange(5.0) * 10.0
        rates = (times[:, None] - 20.0) * qdd
        states = arm.padded(np.stack([np.tile(q, (5, 1)), rates], axis=1))
        acting = Acting.constant(Environment().placed(arm))
        found = AxialLoads(arm).shares(times, states, acting)[2]
        exact = exact_shares(arm, q, qdd=qdd)
        np.testing.assert_allclose(found, exact, rtol=0.03, atol=0.01 * abs(exact).max())


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")
def test_warnings_of_batches_are_those_of_single_runs():
    rng = np.random.default_rng(3)
    warned = 0
    for _ in range(6):
        arm = fa.Arm(random_spec(rng, theory="linear", rigid=False, gravity=True, links=2))
        starts = np.array([arm.rest(rng.normal(size=2)) for _ in range(4)])
        rates = np.array([arm.rest(rng.normal(size=2) * 8.0) for _ in range(4)])
        options = {"tip_force": tuple(rng.normal(size=2) * 40.0), "rate": 200.0}
        batch = fa.simulate_batch(arm, 0.3, initial=starts, initial_rate=rates, **options)
        for k in range(4):
            single = fa.simulate(arm, 0.3, initial=starts[k], initial_rate=rates[k], **options)
            assert batch.warning[k] == single.attrs["warning"]
            warned += AXIAL in single.attrs["warning"]
    assert 3 <= warned <= 21  # both answers occur
