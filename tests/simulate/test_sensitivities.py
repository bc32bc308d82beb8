"""Derivatives of runs, against complex steps and against differences of ``simulate``."""

import numpy as np
import pytest

import flexarm as fa
from complex_steps import by_complex_steps, step_ends
from flexarm.arm.actions import Environment
from flexarm.arm.assembly.assemble import assemble
from flexarm.model.paths import number_at, number_paths, with_number
from random_arms import random_spec

pytestmark = pytest.mark.compiled
#: Derivatives of the same arithmetic by two methods differ by rounding, which runs of hundreds of
#: steps amplify: 1e-12 at most in these tests.
SAME = 1e-10
_WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
_LOW = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60, 4: 0.0}


def a_start(arm, rng):
    q = arm.rest(rng.uniform(-1.0, 1.0, arm.n_joints))
    return q + 0.002 * rng.normal(size=arm.dof), 0.05 * rng.normal(size=arm.dof)


def scaling_paths(arm):
    """Return the paths of numbers that keep the mode shapes."""
    kept = []
    for path in number_paths(arm.spec):
        inside = path.rpartition(".")[2]
        own = not path.startswith("links") or "damping" in path
        scaling = inside in ("flexural_rigidity", "youngs_modulus", "density")
        if (own or scaling) and ".table" not in path and number_at("", arm.spec, path) != 0.0:
            kept.append(path)
    return kept


@pytest.mark.sampled("2-rk4", "1-dormand_prince_8", "2-kennedy_carpenter_5")
@pytest.mark.parametrize("method", ["rk4", "dormand_prince_8", "kennedy_carpenter_5"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_arms_against_complex_steps(method, seed):
    rng = np.random.default_rng(seed)
    arm = fa.Arm(random_spec(rng, links=2, elements=2, reduced=seed == 2))
    (q, qd), torque = a_start(arm, rng), rng.normal(size=arm.n_joints)
    duration = 0.02
    step = 0.5 / fa.modes(arm).frequency_hz[-1] / 2 / np.pi if method == "rk4" else None
    given = {"integrator": method, "step": step}
    times = step_ends(arm, arm.padded(np.stack([q, qd])), torque, duration, **given)
    paths = [*scaling_paths(arm)[-9:], "initial[1]", "initial_rate[0]"]
    found = fa.sensitivities(
        arm, duration, paths, torque=lambda t: torque, initial=q, initial_rate=qd,
        channels=["q", "qd"], **given,
    )  # fmt: skip
    for k, path in enumerate(paths):
        wanted = by_complex_steps(arm, method, times, q, qd, torque, path).reshape(2, -1)
        for level, name in enumerate(("q", "qd")):
            last = found[name].values[k, -1]
            np.testing.assert_allclose(
                last, wanted[level], rtol=0, atol=SAME * np.abs(wanted[level]).max(), err_msg=path
            )


def test_numbers_of_drives_and_hubs_against_complex_steps():
    """Friction of each direction, a winding and a hub radius; joint 2 turns backwards."""
    beam = {"flexural_rigidity": 30.0, "mass_per_length": 0.4, "elements": 2, "modes": 2}
    rubs = fa.Friction(
        coulomb=0.3, smoothing_rate=0.5, viscous=0.05, coulomb_negative=0.4, viscous_negative=0.1
    )
    winding = fa.Winding(torque_constant=0.5, resistance=1.5)
    arm = fa.Arm(
        links=[fa.Link(length=0.7, hub_radius=0.1, **beam), fa.Link(length=0.5, **beam)],
        joints=[fa.Joint(hub_inertia=0.02, winding=winding), fa.Joint(friction=rubs)],
        gravity=(0.0, -9.81),
    )
    torque, q, qd = np.array([1.0, -0.5]), arm.rest([0.3, -0.4]), arm.rest([0.5, -0.6])
    friction = ("coulomb", "coulomb_negative", "viscous_negative")
    paths = [
        "links[0].hub_radius",
        "joints[0].winding.torque_constant",
        "joints[0].winding.resistance",
        *(f"joints[1].friction.{name}" for name in friction),
    ]
    given = {"integrator": "dormand_prince_8"}
    times = step_ends(arm, arm.padded(np.stack([q, qd])), torque, 0.05, **given)
    found = fa.sensitivities(
        arm, 0.05, paths, torque=lambda t: torque, initial=q, initial_rate=qd, channels=["q"],
        **given,
    )  # fmt: skip
    for k, path in enumerate(paths):
        wanted = by_complex_steps(arm, "dormand_prince_8", times, q, qd, torque, path)[: arm.dof]
        assert np.abs(wanted).max() > 1e-9, path
        np.testing.assert_allclose(
            found.q.values[k, -1], wanted, rtol=0, atol=SAME * np.abs(wanted).max(), err_msg=path
        )


def differences(result_of, value, step):
    """Return derivatives of all channels by differences of order 8, and their estimated errors."""
    runs = {k: result_of(value + k * step) for k in range(-4, 5) if k}
    names = [name for name in runs[1] if name in SENSITIVE]
    found = {}
    for name in names:
        both = [
            sum(w * (runs[k][name].values - runs[-k][name].values) for k, w in weights.items())
            / step
            for weights in (_WEIGHTS, _LOW)
        ]
        found[name] = both[0], np.abs(both[0] - both[1]).max(initial=0.0)
    return found


SENSITIVE = {
    *("joint_angle", "joint_rate", "joint_twist", "link_angle", "link_rate"),
    *("link_tip_deflection", "link_tip_slope", "link_tip_deflection_rate", "link_tip_slope_rate"),
    *("tip", "tip_velocity", "tip_angle", "tip_angle_rate"),
    *("kinetic_energy", "strain_energy", "gravity_energy", "strain", "q", "qd"),
}


def bench_arm(**more):
    rod = {"mass_per_length": 0.5, "elements": 2}
    links = [
        fa.Link(
            length=0.8, flexural_rigidity=90.0, gauges=[fa.Gauge(station=0.1, distance=0.005)],
            damping=fa.ModalDamping(ratio=0.01), **rod,
        ),
        fa.Link(length=0.6, flexural_rigidity=40.0, segments=2, **rod),
    ]  # fmt: skip
    joints = [
        fa.Joint(
            hub_inertia=0.1, damping=0.1,
            friction=fa.Friction(coulomb=0.3, viscous=0.05, smoothing_rate=0.05),
        ),
        fa.Joint(hub_inertia=0.05, rotor_inertia=1e-4, gear_ratio=20.0, stiffness=300.0),
    ]  # fmt: skip
    payload = fa.Payload(mass=0.4, inertia=0.01, offset=(0.03, 0.02))
    described = {"payload": payload, "gravity": (0.0, -9.81), "theory": "second_order"} | more
    return fa.Arm(links=links, joints=joints, **described)


def surface(arm, q):
    x, y, _ = arm.tip(q)
    return fa.Contact(
        fa.Wall((float(x), float(y) - 1e-4), (0.0, 1.0)), 2e3, damping=0.1, friction=0.2,
        friction_speed=0.1, exponent=1.5,
    )  # fmt: skip


BENCH_PATHS = [
    "links[0].flexural_rigidity", "links[0].mass_per_length", "links[1].mass_per_length",
    "links[0].length",
    "links[0].damping.ratio", "links[0].gauges[0].station", "links[0].gauges[0].distance",
    "joints[0].friction.coulomb", "joints[0].friction.viscous", "joints[0].damping",
    "joints[0].hub_inertia", "joints[1].rotor_inertia", "joints[1].stiffness",
    "joints[1].gear_ratio", "payload.mass", "payload.offset[1]", "gravity[1]", "tip_force[1]",
    "loads[0].force[0]", "loads[0].station", "contacts[0].stiffness", "contacts[0].friction",
    "torque[7][1]", "initial[0]", "initial_rate[2]",
]  # fmt: skip


def changed(path, arm, given):
    """Return the arguments of ``simulate`` as a function of a parameter, and its value."""
    head, _, inside = path.partition("]")
    name, _, index = head.partition("[")
    if name in ("loads", "contacts"):
        value = number_at("", given[name][0], inside[1:])
        return value, lambda v: (arm, given | {name: [with_number(given[name][0], inside[1:], v)]})
    if name in given:
        at = (int(index), *([int(inside[1:-1])] if inside else []))
        value = float(np.asarray(given[name])[at])

        def moved(v):
            array = np.array(given[name], dtype=float)
            array[at] = v
            return arm, given | {name: array}

        return value, moved
    value = number_at("", arm.spec, path)
    return value, lambda v: (fa.Arm(with_number(arm.spec, path, v)), given)


@pytest.fixture(scope="module")
def bench():
    arm, rng = bench_arm(), np.random.default_rng(4)
    q = arm.rest(
        [
            0.4,
            -0.6,
        ][: arm.n_joints]
    )
    load = fa.Load(link=1, force=(1.0, -2.0), station=0.3, factor=([0.0, 0.05], [0.0, 1.0]))
    given = {
        "torque": rng.normal(size=(20, 2)), "torque_interpolation": "linear", "rate": 500.0,
        "initial": q, "initial_rate": 0.1 * rng.normal(size=arm.dof),
        "tip_force": [0.5, -0.7, 0.1],
        "loads": [load],
        "base_acceleration": (0.3, 0.2), "contacts": [surface(arm, q)],
        "integrator": "rk4", "step": 1e-4,
    }  # fmt: skip
    return arm, given, fa.sensitivities(arm, 0.04, BENCH_PATHS, **given)


@pytest.mark.sampled(
    "links[0].gauges[0].station",
    "joints[0].hub_inertia",
    "payload.mass",
    "loads[0].station",
    "initial_rate[2]",
)
@pytest.mark.parametrize("path", BENCH_PATHS)
def test_every_kind_of_parameter_against_differences(bench, path):
    arm, given, found = bench
    value, at = changed(path, arm, given)
    step = 2e-3 * max(abs(value), 1e-2)

    def result(v):
        own, more = at(v)
        return fa.simulate(own, 0.04, **more)

    for name, (wanted, error) in differences(result, value, step).items():
        # Rounding of the runs, 1e-11 with stiff modes, over the step of the difference.
        largest = np.abs(wanted).max(initial=0.0)
        allowed = 10.0 * error + 1e-7 * largest + 1e-11 / step
        exact = found[name].sel(parameter=path).values
        np.testing.assert_allclose(exact, wanted, rtol=0, atol=allowed, err_msg=name)


def test_the_integrator_of_simulate_is_used():
    arm = bench_arm(theory="linear")
    run = fa.simulate(arm, 0.02)
    found = fa.sensitivities(arm, 0.02, ["payload.mass"])
    assert found.attrs["integrator"] == run.attrs["integrator"]
    assert found.attrs["steps"] == run.attrs["steps"]
    np.testing.assert_array_equal(found["time"], run["time"])


@pytest.mark.thorough
@pytest.mark.parametrize("integrator", ["generalized_alpha", "gauss_6", "cowell_4"])
def test_methods_that_iterate_or_remember(integrator):
    arm = bench_arm(theory="linear")
    given = {"torque": lambda t: [1.0 + t, -0.5], "integrator": integrator, "step": 2e-4}
    path = "links[0].flexural_rigidity"
    found = fa.sensitivities(arm, 0.05, [path], **given)

    def result(v):
        return fa.simulate(fa.Arm(with_number(arm.spec, path, v)), 0.05, **given)

    for name, (wanted, error) in differences(result, 90.0, 0.5).items():
        # Iterations end within 1e-3 of the tolerance of a step, 1e-7.
        allowed = 10.0 * error + 1e-5 * np.abs(wanted).max() + 1e-12
        np.testing.assert_allclose(
            found[name].values[0], wanted, rtol=0, atol=allowed, err_msg=name
        )


def test_prescribed_joints():
    arm = bench_arm(theory="linear")
    sway = fa.PrescribedAngle(
        lambda t: 0.3 * np.sin(5.0 * t),
        lambda t: 1.5 * np.cos(5.0 * t),
        lambda t: -7.5 * np.sin(5.0 * t),
    )
    given = {
        "prescribed": {1: sway}, "integrator": "rk4", "step": 1e-4,
        "channels": ["tip"],
    }  # fmt: skip
    found = fa.sensitivities(arm, 0.03, ["payload.mass"], **given)
    del given["channels"]

    def result(v):
        return fa.simulate(fa.Arm(with_number(arm.spec, "payload.mass", v)), 0.03, **given)

    wanted, error = differences(result, 0.4, 4e-3)["tip"]
    allowed = 10.0 * error + 1e-8 * np.abs(wanted).max()
    np.testing.assert_allclose(found["tip"].values[0], wanted, rtol=0, atol=allowed)


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        (["payload.masss"], "did you mean mass"),
        (["payload.mass"] * 2, "repeats"),
        (["initial[99]"], "number of coordinates"),
        (["torque[0][0]"], "array of samples"),
        (["tip_force[0]"], "requires tip_force"),
        (["loads[0].force[0]"], "number of loads"),
        ([], "must not be empty"),
    ],
)
def test_wrong_parameters(paths, text):
    with pytest.raises(fa.InputError, match=text):
        fa.sensitivities(bench_arm(), 0.01, paths)


def test_wrong_channels():
    with pytest.raises(fa.InputError, match="follows from q and qd"):
        fa.sensitivities(bench_arm(), 0.01, ["payload.mass"], channels=["joint_force"])
    with pytest.raises(
        fa.InputError, match=r"channels\[1\] .*'torque'\. Known: joint_angle, .*, tip, "
    ):
        fa.sensitivities(bench_arm(), 0.01, ["payload.mass"], channels=["tip", "torque"])


@pytest.mark.thorough
def test_more_than_eight_parameters_equal_single_ones():
    arm = bench_arm(theory="linear")
    kinds = "links", "joints", "payload", "initial["
    paths = [path for path in BENCH_PATHS if path.startswith(kinds)]
    given = {"integrator": "rk4", "step": 2e-4, "initial": arm.rest([0.1, 0.2])}
    together = fa.sensitivities(arm, 0.01, paths, **given)
    for path in paths:
        alone = fa.sensitivities(arm, 0.01, [path], **given)
        for name in alone:
            np.testing.assert_array_equal(
                together[name].sel(parameter=[path]).values, alone[name].values
            )


@pytest.mark.thorough
def test_constants_of_a_formula_and_of_a_difference_agree():
    """The file changes only one number, so both ways of ``arm_derivative`` must agree."""
    from flexarm.simulation.derivatives.differences import differences as numerical
    from flexarm.simulation.derivatives.parameters import arm_derivative

    rng = np.random.default_rng(7)
    for _ in range(5):
        arm = fa.Arm(random_spec(rng, links=2))
        for path in scaling_paths(arm):
            if path.endswith("gear_ratio"):  # without a rotor, other values are refused
                continue
            exact = arm_derivative("", arm, Environment.of(arm), path).constants
            value = number_at("", arm.spec, path)
            near = numerical(
                "", path, value, abs(value),
                lambda v, path=path, spec=arm.spec: assemble(with_number(spec, path, v)).constants,
            )  # fmt: skip
            sizes = arm.assembly.constants
            for one, other, size in zip(exact, near, sizes, strict=True):
                columns = np.abs(size).max(axis=tuple(range(size.ndim - 1)), initial=0.0)
                # Rounding of modes over the step of the difference.
                allowed = 1e-10 * (columns / abs(value) + 1.0)
                assert np.all(np.abs(one - other) <= allowed + 1e-9 * np.abs(other)), path


@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_torque_samples_with_controlled_steps(interpolation):
    """Steps longer than the interval of the samples would not resolve one sample."""
    arm = fa.Arm(
        links=[fa.Link(length=0.8, flexural_rigidity=40.0, mass_per_length=0.5, modes=1)],
        joints=[fa.Joint(hub_inertia=0.05)],
    )
    times = np.arange(200) / 1000.0
    torque = 1.0 + np.sin(10.0 * times)[:, None]
    given = {"torque_interpolation": interpolation, "rate": 1000.0}
    found = fa.sensitivities(arm, 0.2, ["torque[60][0]"], torque=torque, **given)

    def result(v):
        moved = torque.copy()
        moved[60, 0] = v
        # A fixed kink keeps the spline of the moved samples that of the others.
        return fa.simulate(arm, 0.2, torque=moved, integrator="rk4", step=1e-4, **given)

    wanted, _ = differences(result, torque[60, 0], 1e-4)["joint_angle"]
    # The largest error of rk4 at this step, and of the steps of ``auto``, is below 1e-4.
    largest = np.abs(wanted).max()
    np.testing.assert_allclose(found["joint_angle"].values[0], wanted, atol=1e-4 * largest)


def test_through_a_joint_stop():
    """The joint meets the stop at an instant that depends on the parameter."""
    limits = fa.JointLimits(lower=-1.0, upper=0.05, stiffness=500.0, damping=0.2)
    arm = fa.Arm(
        links=[fa.Link(length=0.8, flexural_rigidity=40.0, mass_per_length=0.5, modes=2)],
        joints=[fa.Joint(hub_inertia=0.05, limits=limits)],
        payload=fa.Payload(mass=0.2),
    )
    given = {"torque": lambda t: [2.0], "rate": 200.0}
    run = fa.simulate(arm, 0.4, **given)
    assert run.attrs["impact_steps"] >= 2
    path = "payload.mass"
    found = fa.sensitivities(arm, 0.4, [path], **given)

    def result(v):
        return fa.simulate(fa.Arm(with_number(arm.spec, path, v)), 0.4, **given)

    for name, (wanted, error) in differences(result, 0.2, 1e-4).items():
        allowed = 10.0 * error + 1e-5 * np.abs(wanted).max() + 1e-9
        np.testing.assert_allclose(
            found[name].values[0], wanted, rtol=0, atol=allowed, err_msg=name
        )
        assert allowed < 0.05 * np.abs(wanted).max() + 1e-6
