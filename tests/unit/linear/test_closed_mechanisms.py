"""Statics and small motion of closed mechanisms: closed forms, differences, and long runs."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import bar, four_bar, slider_crank

LENGTH, RIGIDITY, MASS = 1.2, 40.0, 0.6
#: Elements of a beam whose lowest frequencies shall agree with closed forms.
FINE = 8
FIXED = fa.Joint(fixed=True)


def beam(length: float = LENGTH, **fields) -> fa.Link:
    return bar(length, flexural_rigidity=RIGIDITY, mass_per_length=MASS, elements=FINE, **fields)


def on_the_axis(joint: fa.Joint, *offsets: float, **fields) -> fa.Arm:
    """Return a link along x, of which points beyond the tip stay on the x axis."""
    closures = [fa.Closure(kind="line", link=1, offset=(offset, 0.0)) for offset in offsets]
    return fa.Arm(links=[beam()], joints=[joint], closures=closures, **fields)


def frequencies(arm: fa.Arm, count: int, **options) -> np.ndarray:
    return 2.0 * np.pi * fa.modes(arm, **options).frequency_hz[:count]


def assert_beam(found: np.ndarray, roots: list[float], length: float) -> None:
    """Compare frequencies (rad/s) with those of a uniform beam with the roots beta L."""
    beta = np.array(roots) / length
    exact = beta**2 * (RIGIDITY / MASS) ** 0.5
    # Frequencies of cubic elements are too high by (beta h)^4 / 1440.
    error = (beta * LENGTH / FINE) ** 4 / 1440.0
    assert np.all(np.abs(found / exact - 1.0) < 1.2 * error)


@pytest.mark.parametrize(
    ("joint", "offsets", "roots"),
    [
        (FIXED, (0.0,), [3.926602, 7.068583]),  # clamped and pinned
        (fa.Joint(), (0.0,), [np.pi, 2.0 * np.pi]),  # pinned at both ends
        (FIXED, (0.0, 0.1), [4.730041, 7.853205]),  # clamped at both ends
    ],
    ids=["clamped-pinned", "pinned-pinned", "clamped-clamped"],
)
def test_closures_make_the_supports_of_beams(joint, offsets, roots):
    found = frequencies(on_the_axis(joint, *offsets), 2, joints="free")
    assert_beam(found, roots, LENGTH)


def test_two_cantilevers_joined_at_their_tips_are_one_beam():
    other = fa.Joint(fixed=True, offset=(2.0 * LENGTH, 0.0), mounting_angle=np.pi)
    closures = [fa.Closure(kind="line", link=1, offset=(x, 0.0), to_link=2) for x in (0.0, 0.3)]
    arm = fa.Arm(links=[beam(), beam(parent=0)], joints=[FIXED, other], closures=closures)
    assert_beam(frequencies(arm, 2), [4.730041, 7.853205], 2.0 * LENGTH)


def test_a_propped_cantilever_carries_its_load_as_in_closed_form():
    arm = on_the_axis(fa.Joint(), 0.0, gravity=(0.0, -9.81))
    rest = fa.equilibrium(arm, [0.0])
    load = 9.81 * MASS * LENGTH
    np.testing.assert_allclose(rest.closure_forces, [0.375 * load], rtol=1e-9)
    np.testing.assert_allclose(rest.torque, [0.125 * load * LENGTH], rtol=1e-9)
    middle = arm.shape(rest.q, 3)[0, 1, 1]
    np.testing.assert_allclose(middle, -load * LENGTH**3 / (192.0 * RIGIDITY), rtol=1e-9)
    assert rest.stable


def crank_on_a_spring(**fields) -> tuple[fa.Arm, fa.Equilibrium]:
    """Return a four-bar under gravity and a torque, and its equilibrium on the crank's spring."""
    closed = four_bar(**fields)
    joints = [fa.Joint(stiffness=15.0, rest_angle=0.6), *closed.fields["joints"][1:]]
    arm = fa.Arm(**{**closed.fields, "joints": joints})
    return arm, fa.equilibrium(arm, closed.joints, torque=[1.5, 0.0, 0.0])


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_an_equilibrium_is_one_of_the_equations_of_motion(theory):
    arm, rest = crank_on_a_spring(theory=theory)
    still = np.zeros(arm.dof)
    # Reached by Newton's method in coordinates with 1e5 times different stiffness.
    assert np.abs(arm.forward_dynamics(rest.q, still, rest.torque)).max() < 1e-6
    np.testing.assert_allclose(arm.closure_gaps(rest.q), 0.0, atol=1e-13)
    forces = arm.closure_forces(rest.q, still, rest.torque)
    np.testing.assert_allclose(rest.closure_forces, forces, rtol=1e-8)
    np.testing.assert_allclose(rest.torque, [1.5, 0.0, 0.0], atol=1e-9)


def test_the_curvature_of_closures_belongs_to_the_stiffness():
    """Compare with differences of the energy along postures that are closed by Newton's method."""
    arm, rest = crank_on_a_spring(flexible=False)
    crank, step = arm.joint_index[0], 1e-4
    modes = fa.modes(arm, rest, "free")
    direction = modes.shapes[0] / modes.shapes[0][crank]

    def potential(change: float) -> float:
        guess = rest.q + change * direction
        q = fa.assembled(arm, guess, held=[1]).q
        return arm.energy(q, 0.0 * q).total - 1.5 * q[crank]

    second = (potential(step) - 2.0 * potential(0.0) + potential(-step)) / step**2
    inertia = direction @ arm.mass_matrix(rest.q) @ direction
    # Rounding 1e-15 J / step^2 and the truncation of differences, step^2: 1e-7.
    np.testing.assert_allclose(modes.squared_frequency, [second / inertia], rtol=2e-6)
    bent = arm.stiffness_matrix(rest.q)
    without = direction @ bent @ direction / inertia
    assert abs(without / modes.squared_frequency[0] - 1.0) > 1e-3


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_poles_of_the_equations_of_motion_are_those_of_the_modes(theory):
    """The linear model comes from the recursion with closures, the modes from the open tree."""
    arm, rest = crank_on_a_spring(theory=theory)
    modes = fa.modes(arm, rest, "free")
    model = fa.linearize(arm, rest, outputs=("joint_angle", "tip"))
    assert len(model.states) == 2 * modes.frequency_hz.size == len(model.A)
    poles = np.sort(np.abs(model.poles))[::2]
    # The lowest poles of a matrix whose entries reach the square of the highest frequency.
    np.testing.assert_allclose(poles[:5], 2.0 * np.pi * modes.frequency_hz[:5], rtol=1e-6)
    lowest = np.sort(np.linalg.eigvals(np.linalg.solve(model.mass, model.stiffness)).real)
    np.testing.assert_allclose(lowest[:3], modes.squared_frequency[:3], rtol=1e-5)
    np.testing.assert_allclose(arm.closure_jacobian(rest.q) @ modes.shapes.T, 0.0, atol=1e-10)


def test_a_linear_model_predicts_small_motion_that_a_torque_causes():
    arm, rest = crank_on_a_spring()
    model = fa.linearize(arm, rest, outputs=("joint_angle",))
    pushed, pulled = (
        fa.equilibrium(arm, start=rest.q, torque=[1.5 + change, 0.0, 0.0])
        for change in (1e-3, -1e-3)
    )
    steady = -model.C @ np.linalg.solve(model.A, model.B[:, 0]) + model.D[:, 0]
    change = arm.joint_angles(pushed.q) - arm.joint_angles(pulled.q)
    # The change is 1e-4 rad; effects of third order are 1e-8 of it.
    np.testing.assert_allclose(change, 2e-3 * steady, atol=1e-7 * np.abs(change).max())


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
def test_a_linear_model_of_a_moving_mechanism_follows_its_closures(flexible):
    """Compare with differences along closed states, of which the rates follow the posture."""
    closed = slider_crank(flexible=flexible)
    arm = fa.Arm(**closed.fields)
    rates = np.zeros(arm.dof)
    rates[arm.joint_index] = [5.0, 0.0]
    state = fa.assembled(arm, arm.rest(closed.joints), rates, held=[1])
    model = fa.linearize(arm, state.q, state.qd, [0.4, 0.0])
    half = len(model.states) // 2
    places = [k for k in range(arm.dof) if k not in dependent(arm, model)]
    step = 1e-6

    def accelerations(changes: np.ndarray) -> np.ndarray:
        q, qd = state.q.copy(), state.qd.copy()
        q[places] += changes[:half]
        for _ in range(4):
            J = arm.closure_jacobian(q)[:, dependent(arm, model)]
            q[dependent(arm, model)] -= np.linalg.solve(J, arm.closure_gaps(q))
        J = arm.closure_jacobian(q)
        qd[places] += changes[half:]
        chosen = dependent(arm, model)
        qd[chosen] = -np.linalg.solve(J[:, chosen], J[:, places] @ qd[places])
        return arm.forward_dynamics(q, qd, [0.4, 0.0])[places]

    for column in {0, half, 2 * half - 1}:
        change = step * np.eye(2 * half)[column]
        slope = (accelerations(change) - accelerations(-change)) / (2.0 * step)
        scale = np.abs(model.A[half:, column]).max()
        np.testing.assert_allclose(model.A[half:, column], slope, atol=1e-6 * scale)


def dependent(arm: fa.Arm, model: fa.LinearModel) -> list[int]:
    """Return the indices of the joint angles that are no states."""
    named = zip(arm.joint_numbers, arm.joint_index, strict=True)
    return [int(k) for n, k in named if f"joint_angle[{n}]" not in model.states]


def test_a_hanging_parallelogram_swings_as_in_closed_form():
    crank, coupler = 0.4, 0.9
    links = [bar(crank, flexible=False), bar(coupler, flexible=False)]
    links += [bar(crank, flexible=False, parent=0)]
    arm = fa.Arm(
        links=links,
        joints=[fa.Joint(), fa.Joint(), fa.Joint(offset=(coupler, 0.0))],
        closures=[fa.Closure(link=2, to_link=3)],
        gravity=(0.0, -9.81),
    )
    rest = fa.equilibrium(arm, [-1.4, 1.4, -1.4], torque=np.zeros(3))
    np.testing.assert_allclose(arm.joint_angles(rest.q), np.pi / 2 * np.array([-1, 1, -1]))
    masses = 0.5 * crank, 0.5 * coupler
    inertia = 2.0 * masses[0] / 3.0 + masses[1]
    expected = (9.81 * (masses[0] + masses[1]) / (inertia * crank)) ** 0.5
    np.testing.assert_allclose(frequencies(arm, 1, q=rest, joints="free"), expected, rtol=1e-12)


@pytest.mark.parametrize(("share", "stable"), [(0.995, True), (1.005, False)])
def test_a_column_buckles_under_the_force_of_a_closure(share, stable):
    """A lever with a load in its middle presses on the column, which is pinned at both ends."""
    lever = bar(0.5, flexible=False, parent=0)
    joints = [fa.Joint(mounting_angle=np.pi / 2), fa.Joint(offset=(-0.5, LENGTH))]
    pin = fa.Closure(link=1, to_link=2)
    arm = fa.Arm(links=[beam(), lever], joints=joints, closures=[pin])
    load = 2.0 * share * np.pi**2 * RIGIDITY / LENGTH**2
    middle = fa.Load(2, (0.0, -load), station=0.25)
    with pytest.warns(fa.LargeDeflectionWarning, match="closure 1 loads link 1"):
        rest = fa.equilibrium(arm, [0.0, 0.0], torque=[0.0, 0.0], loads=[middle])
    np.testing.assert_allclose(rest.closure_forces, [0.0, -0.5 * load], atol=1e-9 * load)
    assert rest.stable == stable
    with pytest.warns(fa.LargeDeflectionWarning, match="closure 1 loads link 1"):
        fa.linearize(arm, torque=[0.0, 0.0], loads=[middle])


def three_cranks(middle: float, **fields) -> tuple[fa.Arm, np.ndarray]:
    """Return a coupler on three parallel cranks, of which that in the middle has another length."""
    crank, coupler, slope = 0.4, 0.9, 1.1
    links = [bar(crank, **fields), bar(coupler, **fields)]
    links += [bar(length, parent=0, **fields) for length in (crank, middle)]
    places = (coupler, 0.0), (0.5 * coupler, 0.0)
    joints = [fa.Joint(), fa.Joint(), *(fa.Joint(offset=place) for place in places)]
    closures = [
        fa.Closure(link=2, to_link=3),
        fa.Closure(link=4, to_link=2, to_station=0.5 * coupler),
    ]
    arm = fa.Arm(links=links, joints=joints, closures=closures)
    return arm, np.array([slope, -slope, slope, slope])


def test_a_crank_that_is_redundant_for_rigid_links_bends_flexible_ones():
    """With cranks that do not match, the third one preloads the mechanism."""
    arm, posture = three_cranks(0.4)
    state = fa.assembled(arm, arm.rest(posture))
    assert (state.mobility, state.freedom) == (0, 1)
    free = fa.modes(arm, q=state.q, joints="free")
    assert free.frequency_hz[0] == 0.0 < free.frequency_hz[1]
    longer, _ = three_cranks(0.401)
    bent = fa.assembled(longer, longer.rest(posture))
    np.testing.assert_allclose(longer.closure_gaps(bent.q), 0.0, atol=1e-12)
    rest = fa.equilibrium(longer, start=bent.q, held=[1])
    assert np.abs(rest.closure_forces).max() > 1.0
    rigid, _ = three_cranks(0.401, flexible=False)
    with pytest.raises(fa.InputError, match=r"arm.closures\[\d\] is left"):
        fa.assembled(rigid, rigid.rest(posture))


@pytest.mark.thorough
def test_a_damped_run_ends_in_the_equilibrium():
    closed = four_bar()
    joints = [fa.Joint(stiffness=15.0, rest_angle=0.6, damping=0.8), *closed.fields["joints"][1:]]
    links = [
        link.replace(damping=fa.RayleighDamping(mass_coefficient=4.0, stiffness_coefficient=2e-3))
        for link in closed.fields["links"]
    ]
    arm = fa.Arm(**{**closed.fields, "joints": joints, "links": links})
    rest = fa.equilibrium(arm, closed.joints, torque=[1.5, 0.0, 0.0])
    run = fa.simulate(
        arm,
        6.0,
        torque=lambda t: [1.5, 0.0, 0.0],
        initial=arm.rest(closed.joints),
        integrator="kennedy_carpenter_5",
        accuracy=1e-6,
    )
    np.testing.assert_allclose(run.joint_angle[-1], arm.joint_angles(rest.q), atol=1e-6)
