"""References and feedforward torques of controllers in files, against the same calls in Python."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.cases.scenario import references
from flexarm.cases.scenario.scenario import prepare
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.model import Scenario, StudySpec, file_text, load_scenario

pytestmark = [
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.6}
PD = {"kind": "joint_pd", "proportional": [40.0, 10.0], "derivative": [10.0, 2.0]}
LINE = {
    "kind": "line", "start": [2.0, 1.0], "end": [1.0, 2.0], "duration": 1.0, "start_time": 0.3,
}  # fmt: skip


def spec(**more):
    links = [fa.Link(length=1.4, elements=1, **ROD), fa.Link(length=1.0, elements=1, **ROD)]
    return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2, **more).spec


def scenario(drive, arm=None, motion=LINE, duration=0.4, **more):
    run = {"duration": duration, "rate": 100.0}
    return Scenario(arm=arm or spec(), motion=motion, drive=drive, run=run, **more)


def line(arm):
    return fa.line_motion(arm, (2.0, 1.0), (1.0, 2.0), 1.0, start_time=0.3)


def controller(feedforward=None):
    return fa.JointPD([40.0, 10.0], [10.0, 2.0], feedforward=feedforward)


@pytest.fixture(scope="module")
def inverse():
    arm = fa.Arm(spec())
    return fa.tip_inversion(arm, line(arm))


@pytest.mark.thorough
def test_default_is_the_bent_arm_with_its_torque():
    arm = fa.Arm(spec())
    static = fa.quasi_static_reference(arm, line(arm))
    wanted = fa.simulate(
        arm, 0.4, controller=controller(static.torque), reference=static, rate=100.0
    )
    found = fa.run_scenario(scenario(PD))
    np.testing.assert_array_equal(found.q.values, wanted.q.values)
    assert found.attrs["reference_kind"] == "quasi_static"
    for given in ({"reference": "quasi_static"}, {"feedforward": "reference"}):
        same = fa.run_scenario(scenario({**PD, **given}))
        np.testing.assert_array_equal(same.q.values, wanted.q.values)
    bare = fa.run_scenario(scenario({**PD, "feedforward": "none"}))
    alone = fa.simulate(arm, 0.4, controller=controller(), reference=static, rate=100.0)
    np.testing.assert_array_equal(bare.q.values, alone.q.values)


def test_rigid_reference_on_request_and_with_torques_for_rigid_angles():
    arm = fa.Arm(spec())
    motion = line(arm)
    torques = {
        "rigid_inverse_dynamics": fa.rigid_torque(arm, motion),
        "flexible_torque": fa.flexible_torque(arm, motion),
        "none": None,
    }
    for name, torque in torques.items():
        asked = {**PD, "feedforward": name}
        if name == "none":
            asked["reference"] = "rigid"
        found = fa.run_scenario(scenario(asked))
        own = controller(torque)
        wanted = fa.simulate(arm, 0.4, controller=own, reference=motion, rate=100.0)
        np.testing.assert_array_equal(found.q.values, wanted.q.values)
        assert found.attrs["reference_kind"] == "rigid"
    both = fa.run_scenario(scenario({**PD, "reference": "rigid"}))
    rigid = fa.run_scenario(scenario({**PD, "feedforward": "rigid_inverse_dynamics"}))
    np.testing.assert_array_equal(both.q.values, rigid.q.values)


@pytest.mark.thorough
def test_tip_inversion_as_reference(inverse):
    found = fa.run_scenario(scenario({**PD, "reference": "tip_inversion"}))
    options = {"reference": inverse.reference, "initial": inverse.initial, "rate": 100.0}
    wanted = fa.simulate(inverse.arm, 0.4, controller=controller(inverse.torque), **options)
    np.testing.assert_array_equal(found.q.values, wanted.q.values)
    assert found.attrs["reference_kind"] == "tip_inversion"


@pytest.mark.thorough
def test_integral_manifold_as_reference():
    found = fa.run_scenario(scenario({**PD, "reference": "integral_manifold"}))
    arm = fa.Arm(spec())
    second = fa.quasi_static_reference(arm, line(arm), order=2)
    options = {"reference": second, "initial": second.initial, "rate": 100.0}
    wanted = fa.simulate(arm, 0.4, controller=controller(second.torque), **options)
    np.testing.assert_array_equal(found.q.values, wanted.q.values)
    assert found.attrs["reference_kind"] == "integral_manifold"


@pytest.mark.thorough
def test_torques_alone(inverse):
    arm = inverse.arm
    static = fa.quasi_static_reference(arm, inverse.motion)
    second = fa.quasi_static_reference(arm, inverse.motion, order=2)
    torques = {
        "quasi_static": (static.torque, static.initial),
        "integral_manifold": (second.torque, second.initial),
        "flexible_torque": (fa.flexible_torque(arm, inverse.motion), None),
        "tip_inversion": (inverse.torque, inverse.initial),
    }
    for kind, (torque, initial) in torques.items():
        found = fa.run_scenario(scenario({"kind": kind}))
        wanted = fa.simulate(arm, 0.4, torque=torque, initial=initial, rate=100.0)
        np.testing.assert_array_equal(found.q.values, wanted.q.values)
    short = scenario({"kind": "tip_inversion", "pre_actuation": 0.2, "reduction": 0.01})
    cut = fa.tip_inversion(arm, inverse.motion, pre_actuation=0.2, reduction=0.01)
    given = prepare(short).options["torque"]
    np.testing.assert_array_equal(given(0.5), cut.torque(0.5))


def test_the_run_starts_with_bent_links_under_gravity():
    heavy = spec(gravity=(0.0, -1.62))
    arm = fa.Arm(heavy)
    static = fa.quasi_static_reference(arm, line(arm))
    prepared = prepare(scenario(PD, heavy))
    np.testing.assert_array_equal(prepared.options["initial"], static.initial)
    straight = prepare(scenario(PD, heavy, initial={"joint_angle": [0.2, 0.4]}))
    np.testing.assert_array_equal(straight.options["initial"], arm.rest([0.2, 0.4]))


def test_balance_adds_the_loads_only():
    heavy = spec(gravity=(0.0, -1.62))
    push = fa.Load(2, force=(0.0, -1.0))
    start = {"equilibrium": True, "balance": True}
    run = fa.run_scenario(scenario(PD, heavy, duration=0.2, initial=start, loads=[push]))
    static = fa.quasi_static_reference(fa.Arm(heavy), line(fa.Arm(heavy)))
    rest = fa.equilibrium(fa.Arm(heavy), static.joint_angle(0.0), loads=[push])
    np.testing.assert_allclose(run.torque.values[:15], [rest.torque] * 15, rtol=1e-6)
    np.testing.assert_allclose(run.q.values[:15], [rest.q] * 15, rtol=0, atol=1e-7)


def test_rigid_angles_where_the_bent_arm_has_none():
    stretched = {"kind": "joint", "start": [0.0, 0.0], "end": [0.5, 0.4], "duration": 0.3}
    found = fa.run_scenario(scenario(PD, motion=stretched))
    assert found.attrs["reference_kind"].startswith("rigid: ")
    assert "tip" in found.attrs["reference_kind"]
    rigid = fa.Arm(spec()).rigid().spec
    for kind in ("joint_pd", "computed_torque"):
        gains = PD if kind == "joint_pd" else {"kind": kind, "frequency_hz": 1.0}
        prepared = prepare(scenario(gains, rigid))
        assert prepared.followed.kind == "rigid"
        # Computed torque of a rigid arm is exact feedback linearisation.
        assert (prepared.options["controller"].feedforward is None) == (kind != "joint_pd")


def test_controllers_that_plan_the_bending_follow_rigid_angles():
    lqg = prepare(scenario({"kind": "lqg"}))
    assert lqg.followed.kind == "rigid"
    observed = {"kind": "disturbance_observer", "inner": {"kind": "lqg"}}
    assert prepare(scenario(observed)).followed.kind == "rigid"
    assert prepare(scenario({**observed, "inner": PD})).followed.kind == "quasi_static"


@pytest.mark.parametrize("kind", ["positive_position_feedback", "integral_resonant_control"])
def test_strain_damping_is_around_controllers_of_the_joint_angles(kind):
    gauge = fa.Gauge(station=0.05, distance=0.005)
    links = [fa.Link(length=x, elements=1, gauges=[gauge], **ROD) for x in (1.4, 1.0)]
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1)] * 2).spec
    damped = {"kind": kind, "inner": {"kind": "loop_shaping", "bandwidth": 6.0}}
    found = prepare(scenario(damped, arm))
    assert isinstance(found.options["controller"].inner, fa.LoopShaping)
    assert found.followed.kind == "quasi_static"
    with pytest.raises(fa.InputError, match=r"drive\.inner\.kind"):
        scenario({**damped, "inner": {"kind": "lqg"}}, arm)


def test_gravity_compensation_replaces_the_feedforward():
    pid = {**PD, "kind": "joint_pid", "gravity": "rigid"}
    assert prepare(scenario(pid)).options["controller"].feedforward is None


def test_a_study_computes_each_reference_once(monkeypatch):
    calls = []
    own = references.quasi_static_reference
    monkeypatch.setattr(
        references, "quasi_static_reference", lambda *a, **k: (calls.append(a), own(*a, **k))[1]
    )
    study = StudySpec(
        arm=spec(),
        motions={"line": LINE},
        drives={"soft": PD, "stiff": {**PD, "proportional": 80.0}, "lqg": {"kind": "lqg"}},
        run={"duration": 0.4},
    )
    prepared = PreparedStudy(study)
    assert len(calls) == 1
    kinds = [one.followed.kind for one in prepared._prepared.values()]
    assert kinds == ["quasi_static", "quasi_static", "rigid"]


def test_keys_are_kept_in_a_file(tmp_path):
    path = tmp_path / "scenario.yaml"
    for drive in (
        {**PD, "reference": "tip_inversion", "feedforward": "none"},
        {"kind": "tip_inversion", "reduction": 0.01},
    ):
        saved = scenario(drive)
        path.write_text(file_text(saved), encoding="utf-8")
        assert load_scenario(path) == saved
