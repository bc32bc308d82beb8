"""No constant with a dimension: in other units of length, mass and time every result is the same.

The factors are powers of two, so results agree to the last digits, with the same steps and
warnings. A tolerance, a floor or a difference in metres, newtons or seconds would change them.
"""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.arm_scales import size_of_zero
from flexarm.model.paths import unit_at
from other_units import Units
from random_arms import random_spec

#: The second row is a tenth of a millimetre with a milligram in milliseconds; then a kilometre, and
#: the same arm in other units of time.
OTHERS = [
    Units(2.0**-13, 2.0**-40, 2.0**-8),
    Units(2.0**10, 2.0**-10, 1.0),
    Units(1.0, 1.0, 2.0**10),
]
START = [0.3, -0.6]
#: Powers and roots of scaled numbers, and sums with a constant of the same unit, are rounded.
ROUNDING = 1e-9
#: The equation of the robust filter amplifies rounding: its gain is known to seven digits.
AMPLIFIED = {"composite": 1e-6}


def two_links(units: Units, **options) -> fa.Arm:
    first = {"hub_inertia": 0.05, "damping": 0.02, "mass": 0.3, "housing_inertia": 0.002}
    second = {"hub_inertia": 0.02, "damping": 0.01, "mass": 0.5}
    first.update(options.pop("first", {}))
    second.update(options.pop("second", {}))
    damping = fa.ModalDamping(ratio=0.01)
    given = {"elements": 2, "modes": 2, "damping": damping}
    gauge = fa.Gauge(station=0.1, distance=0.005)
    rods = {"flexural_rigidity": 30.0, "mass_per_length": 0.5}
    links = [
        fa.Link(length=0.8, gauges=[gauge], **rods, **given),
        fa.Link(length=0.6, **rods, **given),
    ]
    return units.arm(
        fa.Arm(
            links=links,
            joints=[fa.Joint(**first), fa.Joint(**second)],
            payload=fa.Payload(mass=0.3, inertia=0.002, offset=(0.03, 0.01)),
            **{"gravity": (0.0, -9.81), "theory": "second_order", **options},
        )
    )


def run(units: Units, arm: fa.Arm, duration: float = 0.2, **options):
    return fa.simulate(
        arm,
        duration * units.time,
        rate=100.0 / units.time,
        **{"initial": arm.rest(START), **options},
    )


FRICTION = fa.Friction(coulomb=0.3, static=0.4, stribeck_rate=0.2, smoothing_rate=0.05)
BRISTLES = fa.Friction(coulomb=0.3, static=0.4, bristle_stiffness=500.0, bristle_damping=0.5)
STOPS = fa.JointLimits(lower=-0.7, upper=-0.5, stiffness=400.0, damping=0.2)
ARMS = {
    "plain": {},
    "linear": {"theory": "linear"},
    "friction": {"first": {"friction": FRICTION}},
    "bristles": {"first": {"friction": BRISTLES}},
    "stops": {"second": {"limits": STOPS}},
    "elastic": {"first": {"rotor_inertia": 1e-4, "gear_ratio": 20.0, "stiffness": 200.0}},
}
WALL = fa.Contact(fa.Wall((0.0, 0.0), (0.0, 1.0)), 2e3, damping=0.5)
SPHERE = WALL.replace(exponent=1.5, friction=0.3)
POST = fa.Contact(fa.RoundWall(center=(1.1, -0.4), radius=0.3), 3e3, damping=0.2)
LOADS = [
    fa.Load(link=1, force=(1.0, 2.0), station=0.3),
    fa.Load(link=2, force=(0.4, 0.5), spread=[0.1, 0.5]),
]


def pd(units: Units, sample_time: float = 0.002) -> fa.JointPD:
    gains = np.array([[30.0, 12.0], [3.0, 1.0]])
    stiffness, damping = units.factor("N m/rad"), units.factor("N m s/rad")
    return fa.JointPD(
        stiffness * gains[0], damping * gains[1], sample_time=sample_time * units.time
    )


def move(units: Units, arm: fa.Arm) -> fa.motion.Motion:
    return fa.joint_motion(arm, START, [0.8, -0.3], 0.3 * units.time)


def closed_loop(units: Units, **options):
    arm = two_links(units)
    given = {"controller": pd(units), "reference": move(units, arm), "initial": None}
    return run(units, arm, **given, **options)


def pressed(units: Units):
    arm = two_links(units, gravity=(0.0, 0.0))
    ends = np.array([[1.0, 0.2], [1.05, 0.25]]) * units.length
    line = fa.line_motion(arm, *ends, 0.5 * units.time)
    force = 2.0 * units.factor("N")
    motion = fa.pressed_motion(arm, line, force, [-1.0, 1.0])
    wall = units.record(fa.Contact(fa.Wall((1.0, 0.2), (-1.0, 1.0)), 1e3, damping=0.5))
    return run(units, arm, controller=pd(units), reference=motion, contacts=[wall], initial=None)


def damped(units: Units, make, measured: bool = False):
    """Return a closed loop whose controller has default arguments, except for its sample time."""
    arm = two_links(units)
    motion = fa.quasi_static_reference(arm, move(units, arm))
    hardware = fa.Hardware(instruments=sensors(units)) if measured else None
    loop = {"controller": make(units, arm), "reference": motion, "initial": None}
    return run(units, arm, hardware=hardware, **loop)


def sensors(units: Units) -> list[fa.Instrument]:
    encoder = fa.Instrument("joint_angle", noise=1e-4)
    tachometer = fa.Instrument("joint_rate", noise=1e-2 / units.time)
    return [encoder, tachometer, fa.Instrument("strain", noise=2e-5)]


def pressing(units: Units, kind, **options):
    """Return a force controller with default arguments in contact, and on its way to it."""
    arm = two_links(units, gravity=(0.0, 0.0))
    ends = np.array([[1.0, 0.2], [1.05, 0.25]]) * units.length
    line = fa.line_motion(arm, *ends, 0.5 * units.time)
    force, turn = units.factor("N"), 20.0 / units.time

    def requested(t):
        return force * (2.0 + np.sin(turn * np.asarray(t)))

    pressed = fa.pressed_motion(arm, line, requested, [-1.0, 1.0], friction=0.1)
    wall = fa.Contact(fa.Wall((1.0002, 0.2), (-1.0, 1.0)), 1e3, damping=0.5)
    walls = [units.record(wall)]
    law = kind(arm, sample_time=0.002 * units.time, **options)
    given = {"controller": law, "reference": pressed, "contacts": walls}
    return run(units, arm, **given, initial=None)


def sampled(kind, **options):
    """Return a function that creates a controller with a sample time in the units of the arm."""
    torque = options.pop("torque_limit", None)

    def make(units: Units, arm: fa.Arm):
        more = {} if torque is None else {"torque_limit": torque * units.factor("N m")}
        return kind(arm, sample_time=0.002 * units.time, **options, **more)

    return make


def estimated(kind, **options):
    return lambda units, arm: fa.EstimatorController(
        kind(arm, sensors(units), sample_time=0.002 * units.time, **options), pd(units)
    )


#: Controllers with default arguments. Those of the joints ignore the mass of the links.
LOOPS = {
    "LQG": sampled(fa.LQG),
    "LQG, integral": sampled(fa.LQG, integral=True, rigidity_uncertainty=0.3),
    "MPC": sampled(fa.MPC, torque_limit=8.0),
    "composite": sampled(fa.Composite),
    "loop shaping": sampled(fa.LoopShaping),
    "disturbance observer": lambda u, arm: fa.DisturbanceObserver(arm, pd(u)),
    "adaptive": lambda u, arm: fa.Adaptive(
        arm, 3.0 / u.time, u.factor("N m s/rad") * np.array([3.0, 1.0]), 0.0, ["friction"],
        strain_gain=[0.1 * u.factor("rad m/s"), 0.0], sample_time=0.002 * u.time,
    ),
    "sliding mode": lambda u, arm: fa.SlidingMode(
        arm, 3.0 / u.time, 0.5 / u.time, strain_gain=[0.1 * u.factor("rad m/s"), 0.0],
        sample_time=0.002 * u.time,
    ),
    "prescribed performance": lambda u, arm: fa.PrescribedPerformance(
        8.0 / u.time, u.factor("N m s/rad") * np.array([2.0, 0.5]), 0.3, 8.0 / u.time, 1.0,
        gain_limit=2.0, sample_time=0.002 * u.time,
    ),
    "repetitive": lambda u, arm: fa.RepetitiveControl(
        pd(u), 0.08 * u.time, 5.0 * u.factor("N m/rad")
    ),
}  # fmt: skip
#: Force controllers with default arguments.
FORCED = {
    "hybrid force": fa.HybridForce,
    "adaptive force": fa.AdaptiveForce,
    "neural force": fa.NeuralForce,
    "impedance": fa.Impedance,
    "admittance": fa.Admittance,
}
FILTERS = {
    "extended": estimated(fa.ExtendedKalmanFilter),
    "unscented": estimated(fa.UnscentedKalmanFilter),
    "moving horizon": estimated(fa.MovingHorizonEstimator, horizon=3),
}


def computed_torque(units: Units):
    arm = two_links(units).rigid()
    law = fa.ComputedTorque(arm, 5.0 / units.time, sample_time=0.002 * units.time)
    return run(units, arm, controller=law, reference=move(units, arm), initial=None)


def in_contact(contact: fa.Contact, **options):
    return lambda u: run(u, two_links(u), contacts=[u.record(contact)], **options)


def rigid(units: Units):
    arm = two_links(units).rigid()
    torque = np.full((21, 2), 0.5) * units.factor("N m")
    return run(units, arm, torque=torque)


def loaded(units: Units):
    force = units.factor("N")
    acceleration = np.array([0.5, 0.2]) * units.factor("m/s^2")
    tip = np.array([0.5, -0.2, 0.1 * units.length]) * force
    loads = [units.record(load) for load in LOADS]
    acting = {"loads": loads, "tip_force": tip, "base_acceleration": acceleration, "stations": 3}

    def torque(t):
        return np.array([2.0 * np.sin(5.0 * t / units.time), 0.5]) * units.factor("N m")

    return run(units, two_links(units), torque=torque, **acting)


def small(units: Units):
    arm = two_links(units, gravity=(0.0, 0.0))
    return run(units, arm, initial=1e-6 * units.coordinates(arm) * (arm.rest([0.0, 0.0]) + 1.0))


def plant(units: Units):
    arm = two_links(units).rigid()
    stepped = fa.Plant(arm, sample_time=0.005 * units.time, integrator="rk4")
    stepped.reset(arm.rest(START))
    torque = np.array([1.0, 0.2]) * units.factor("N m")
    return {"joint_angle": (np.array([stepped.step(torque).joint_angle for _ in range(10)]), "rad")}


def equilibria(units: Units):
    found = {}
    arm, still = two_links(units), two_links(units, gravity=(0.0, 0.0))
    force, torque = np.array([1.0, 2.0]) * units.factor("N"), units.factor("N m")
    states = {
        "held": fa.equilibrium(arm, START, tip_force=force),
        "hanging": fa.equilibrium(arm, [-1.4, 0.1], torque=[0.0, 0.0]),
        "driven": fa.equilibrium(arm, [0.2, 0.1], torque=np.array([2.0, 0.5]) * torque),
        "touching": fa.equilibrium(arm, [0.0, -0.2], contacts=[units.record(WALL)]),
        "weightless": fa.equilibrium(still, START),
    }
    for name, state in states.items():
        found[f"{name} q"] = state.q / units.coordinates(arm), "1"
        found[f"{name} torque"] = state.torque, "N m"
        found[f"{name} eigenvalue"] = state.lowest_eigenvalue, "Hz^2"
    return found


def vibrations(units: Units):
    arm, still = two_links(units), two_links(units, gravity=(0.0, 0.0))
    turning = fa.modes(still, START, spin=5.0 / units.time)
    free = fa.modes(arm, START, joints="free")
    speeds = fa.campbell(still, np.linspace(0.0, 10.0, 3) / units.time)
    linear = fa.linearize(arm, arm.rest(START))
    sizes = np.concatenate([units.coordinates(arm), units.coordinates(arm) / units.time])
    return {
        "turning": (turning.frequency_hz, "Hz"),
        "free": (free.frequency_hz, "Hz"),
        "campbell": (speeds.frequency_hz, "Hz"),
        "A": (linear.A * sizes / sizes[:, None], "1/s"),
    }


def motions(units: Units):
    arm = two_links(units)
    corners = np.array([[1.0, 0.3], [1.05, 0.4], [0.9, 0.5], [0.8, 0.5]]) * units.length
    duration = 0.5 * units.time
    made = {
        "line": fa.line_motion(arm, corners[0], corners[3], duration),
        "circle": fa.circle_motion(arm, corners[2], corners[0], 2.0, duration),
        "spline": fa.spline_motion(arm, corners, duration),
        "corners": fa.via_point_motion(arm, corners, duration),
        "bent": fa.quasi_static_reference(arm, move(units, arm)),
    }
    times = np.linspace(0.0, 0.3, 7) * units.time
    found = {"inverse": (fa.inverse_kinematics(arm, corners[0]), "rad")}
    for name, motion in made.items():
        found[f"{name} angle"] = np.array([motion.joint_angle(t) for t in times]), "rad"
        found[f"{name} rate"] = np.array([motion.joint_rate(t) for t in times]), "rad/s"
    return found


def event(units: Units):
    arm = two_links(units)
    place = np.array([1.0, 0.0]) * units.length
    turning = fa.joint_event(arm, 1, 0.1)
    passing = fa.tip_event(arm, place, (0.0, 1.0))
    return run(units, arm, 0.4, events=[turning, passing])


CASES = {
    **{name: lambda u, given=given: run(u, two_links(u, **given)) for name, given in ARMS.items()},
    **{
        name: lambda u, name=name: run(u, two_links(u), 0.05, integrator=name)
        for name in ("rk4", "generalized_alpha", "cowell_4", "gauss_6", "kennedy_carpenter_5")
    },
    "fixed step": lambda u: run(u, two_links(u), step=1e-3 * u.time),
    "wall": in_contact(WALL),
    "sphere": in_contact(SPHERE),
    "post": in_contact(POST),
    "rigid": rigid,
    "loads": loaded,
    "small motion": small,
    "closed loop": closed_loop,
    "closed loop with a searched step": lambda u: closed_loop(u, integrator="rk4"),
    "pressed": pressed,
    "plant": plant,
    "computed torque": computed_torque,
    "events": event,
    "equilibria": equilibria,
    "vibrations": vibrations,
    "motions": motions,
    **{name: lambda u, make=make: damped(u, make) for name, make in LOOPS.items()},
    **{name: lambda u, make=make: damped(u, make, True) for name, make in FILTERS.items()},
    **{name: lambda u, kind=kind: pressing(u, kind) for name, kind in FORCED.items()},
}


def outcome(case, units: Units) -> SimpleNamespace:
    """Return the numbers of a case in SI units, its texts and its warnings."""
    with warnings.catch_warnings(record=True) as log:
        warnings.simplefilter("always")
        # Plausible numbers are those of the SI alone.
        warnings.simplefilter("ignore", fa.ImplausibleValueWarning)
        result = case(units)
    numbers, texts = {}, [message.category.__name__ for message in log]
    if isinstance(result, dict):
        numbers = {name: np.asarray(value) / units.factor(u) for name, (value, u) in result.items()}
        return SimpleNamespace(numbers=numbers, texts=texts)
    kinds = {2: two_links(units).rigid(), 6: two_links(units)}
    arm = kinds.get(result.q.shape[1]) or two_links(units, **ARMS["elastic"])
    for name, values in result.data_vars.items():
        scaled = "units" in values.attrs and name not in ("event_q", "event_qd")
        if values.dtype.kind == "f" and scaled:
            # Joints without stops have no depth in them: NaN in all units.
            numbers[name] = np.nan_to_num(values.values) / units.channel(arm, values.units)
    texts += [result.integrator, re.sub(r"[\d.e+-]+", "", result.warning)]
    numbers["steps"] = np.array(float(result.steps if "event" not in result.sizes else 0.0))
    return SimpleNamespace(numbers=numbers, texts=texts)


@pytest.mark.sampled("plain", "elastic", "kennedy_carpenter_5", "rigid", "pressed", "motions")
@pytest.mark.parametrize("name", CASES)
def test_results_are_the_same_in_other_units(name):
    usual = outcome(CASES[name], Units())
    for units in OTHERS:
        other = outcome(CASES[name], units)
        assert other.texts == usual.texts
        for key, values in usual.numbers.items():
            size = np.abs(values).max(axis=0 if key in ("q", "qd") else None, initial=0.0)
            error = np.abs(other.numbers[key] - values) / np.where(size > 0.0, size, 1.0)
            assert error.max(initial=0.0) <= AMPLIFIED.get(name, ROUNDING), (key, units)
        assert other.numbers.get("steps", 0.0) == usual.numbers.get("steps", 0.0)


#: Lengths of 1e-4 and 1e2; rigidities of 2**-20 and 2**20, so that samples are at equal times; and
#: millimetres, newtons and tonnes.
SIZES = [
    Units(1e-4, 1.0, 1.0),
    Units(1e2, 1.0, 1.0),
    Units(1.0, 1.0, 2.0**10),
    Units(1.0, 1.0, 2.0**-10),
    Units(1e3, 1e-3, 1.0),
]


@pytest.mark.sampled("LQG", "disturbance observer")
@pytest.mark.parametrize("name", [*LOOPS, *FILTERS, *FORCED])
def test_loops_with_default_arguments_are_the_same_for_arms_of_any_size(name):
    usual = outcome(CASES[name], Units())
    for units in SIZES:
        other = outcome(CASES[name], units)
        assert other.texts == usual.texts
        for key in ("tip", "torque", "joint_rate"):
            values = usual.numbers[key]
            error = np.abs(other.numbers[key] - values).max()
            # Factors are rounded, so that step control differs within its tolerance of 1e-7.
            assert error <= 1e-5 * np.abs(values).max(), (key, units)


@pytest.mark.parametrize("seed", range(8))
def test_random_arms_take_the_same_steps_in_other_units(seed):
    rng = np.random.default_rng(seed)
    arm = fa.Arm(random_spec(rng, reduced=True))
    q, rates = arm.rest(rng.normal(size=arm.n_joints)), np.zeros(arm.dof)
    rates[arm.joint_index] = rng.normal(size=arm.n_joints)
    usual = fa.simulate(arm, 0.1, initial=q, initial_rate=rates, rate=100.0)
    for units in (*OTHERS, Units(1e3, 1e-3, 1.0)):  # the last: millimetres, newtons, tonnes
        other = fa.simulate(
            units.arm(arm), 0.1 * units.time, initial=q, initial_rate=rates / units.time,
            rate=100.0 / units.time,
        )  # fmt: skip
        assert other.integrator == usual.integrator
        assert other.warning == "" or usual.warning != ""
        if units.length == 1e3:  # rounded factors: errors of the tolerance, in chaotic motion more
            assert other.steps == pytest.approx(usual.steps, rel=0.02, abs=2)
            size = np.abs(usual.tip.values).max()
            assert np.abs(other.tip.values / 1e3 - usual.tip.values).max() < 1e-4 * size
            continue
        assert other.steps == usual.steps
        np.testing.assert_array_equal(other.q.values / units.coordinates(arm), usual.q.values)


#: Numbers that may be zero in an arm, of all dimensions that records have.
ZEROS = [
    *("joints[0].damping", "joints[0].stiffness", "joints[0].rotor_inertia", "joints[0].mass"),
    *("payload.offset[0]", "payload.inertia", "gravity[0]", "links[0].rotary_inertia_per_length"),
]


@pytest.mark.parametrize("units", [*OTHERS, *SIZES])
def test_steps_of_numbers_that_are_zero_follow_the_arm(units):
    """Derivatives and identification change such a number by a fraction of this size."""
    usual, other = two_links(Units()), two_links(units)
    for path in ZEROS:
        factor = units.factor(unit_at(usual.spec, path))
        wanted = factor * size_of_zero(usual, usual.spec, path)
        assert size_of_zero(other, other.spec, path) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("path", ["joints[1].damping", "payload.inertia", "payload.offset[0]"])
def test_derivatives_by_numbers_that_are_zero_are_the_same_in_other_units(path):
    def derivative(units: Units) -> float | str:
        bare = {"first": {"damping": 0.0}, "second": {"damping": 0.0}}
        arm = two_links(units, **bare)
        payload = fa.Payload(mass=arm.spec.payload.mass)
        arm = fa.Arm(arm.spec.replace(payload=payload))
        given = {"initial": arm.rest(START), "rate": 100.0 / units.time, "channels": ["tip_angle"]}
        try:
            found = fa.sensitivities(arm, 0.05 * units.time, [path], **given)
        except fa.InputError as error:
            return str(error)
        factor = units.factor(unit_at(arm.spec, path))
        return float(found.tip_angle.values.ravel()[-1] * factor)

    usual = derivative(Units())
    for units in (*OTHERS, *SIZES):
        other = derivative(units)
        assert other == (usual if isinstance(usual, str) else pytest.approx(usual, rel=1e-6))


@pytest.mark.parametrize("path", ["payload.mass", "gravity[1]"])
def test_numbers_that_are_zero_on_an_arm_without_free_joints(path):
    """Such an arm has no typical torque; its scale is that of its mass."""
    link = fa.Link(length=0.5, flexural_rigidity=50.0, mass_per_length=0.5, modes=2)
    arm = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)])
    found = fa.sensitivities(arm, 0.05, [path], tip_force=(0.0, 1.0), progress=False)
    changes = [{}, {"payload": fa.Payload(mass=1e-6)} if "mass" in path else {"gravity": (0, 1e-6)}]
    moved = []
    for change in changes:
        other = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)], **change)
        moved.append(fa.simulate(other, 0.05, tip_force=(0.0, 1.0), rtol=1e-11, progress=False).tip)
    expected = (moved[1] - moved[0]) / 1e-6
    assert np.abs(found.tip[0] - expected).max() < 1e-3 * np.abs(expected).max()
