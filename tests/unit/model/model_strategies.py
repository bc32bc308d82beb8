"""Random valid arms and scenarios for property tests."""

from hypothesis import strategies as st

from flexarm.model import (
    AccelerationTable,
    ArmSpec,
    Base,
    Box,
    Circle,
    Closure,
    FactorTable,
    Friction,
    Gauge,
    HeldJoint,
    Joint,
    JointEvent,
    Link,
    Load,
    Material,
    ModalDamping,
    Payload,
    RayleighDamping,
    Rectangle,
    RoundWall,
    Scenario,
    SectionTable,
    TabulatedJoint,
    TorqueDrive,
    Tube,
    Winding,
)
from flexarm.model.drives import (
    CONTROLLED,
    FilterSpec,
    NoDrive,
    RigidInverseDynamicsDrive,
    balances,
)
from flexarm.model.hardware import Instrument
from flexarm.model.scenarios.motions import (
    CircleMotionSpec,
    ForceTable,
    JointMotionSpec,
    LineMotionSpec,
    PressedMotionSpec,
    ShapingSpec,
    SmoothingSpec,
    SplineMotionSpec,
    ViaPointMotionSpec,
)
from flexarm.model.scenarios.scenario import FollowingJoint, InitialState, RunSpec, TipEvent

numbers = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
not_negative = st.just(0.0) | positive
sizes = st.floats(1e-3, 10.0)
ratios = st.floats(0.0, 1.0)
pairs = st.tuples(numbers, numbers)
walls = st.floats(0.01, 0.49)  # thickness relative to the outer size; from 0.5 on no hole remains

materials = st.sampled_from(["steel", "aluminium"]) | st.builds(
    Material, density=positive, youngs_modulus=positive, poissons_ratio=st.floats(-0.9, 0.5)
)
SECTIONS = {
    "rectangle": st.builds(Rectangle, width=sizes, height=sizes),
    "circle": st.builds(Circle, diameter=sizes),
    "tube": st.builds(lambda d, part: Tube(outer_diameter=d, thickness=part * d), sizes, walls),
    "box": st.builds(
        lambda w, h, part: Box(width=w, height=h, thickness=part * min(w, h)), sizes, sizes, walls
    ),
}
sections = st.one_of(*SECTIONS.values())


@st.composite
def tables(draw, length, shears):
    """Draw a section table over [0, length]."""
    inner = draw(st.lists(st.integers(1, 99), max_size=3, unique=True))
    x = [0.0, *(part / 100 * length for part in sorted(inner)), length]
    column = st.lists(positive, min_size=len(x), max_size=len(x))
    return SectionTable(
        x=x,
        flexural_rigidity=draw(column),
        mass_per_length=draw(column),
        rotary_inertia_per_length=draw(st.none() | column),
        shear_rigidity=draw(column) if shears else None,
    )


@st.composite
def links(draw):
    """Draw a link, described in one of the three ways."""
    length = draw(sizes)
    elements = draw(st.integers(1, 256))
    modes = draw(st.none() | st.integers(1, 2 * elements))
    most = modes or 2 * elements
    damping = st.one_of(
        st.none(),
        st.builds(ModalDamping, ratio=ratios | st.lists(ratios, min_size=1, max_size=min(most, 4))),
        st.builds(RayleighDamping, mass_coefficient=not_negative),
        st.builds(RayleighDamping, stiffness_coefficient=not_negative),
    )
    element = draw(st.sampled_from(["euler_bernoulli", "timoshenko"]))
    shears = element == "timoshenko"
    common = {
        "length": length,
        "hub_radius": draw(not_negative),
        "element": element,
        "elements": elements,
        "modes": modes,
        "flexible": draw(st.booleans()),
        "damping": draw(damping),
        "gauges": draw(
            st.lists(st.builds(Gauge, station=st.floats(0.0, length), distance=numbers), max_size=2)
        ),
    }
    way = draw(st.sampled_from(["constants", "section", "table"]))
    if way == "constants":
        rotary = draw(st.none() | not_negative)
        return Link(
            **common,
            flexural_rigidity=draw(positive),
            mass_per_length=draw(positive),
            rotary_inertia_per_length=rotary,
            shear_rigidity=draw(positive) if shears else None,
            rotary_inertia=draw(st.none() | st.just(False)),
        )
    rotary = draw(st.none() | st.just(False))
    if way == "section":
        shape = {"material": draw(materials), "section": draw(sections)}
        return Link(**common, **shape, rotary_inertia=rotary)
    return Link(**common, table=draw(tables(length, shears)), rotary_inertia=rotary)


frictions = st.builds(
    Friction,
    coulomb=not_negative,
    viscous=not_negative,
    coulomb_negative=st.none() | not_negative,
    viscous_negative=st.none() | not_negative,
)
joints = st.builds(
    Joint,
    hub_inertia=not_negative,
    mass=not_negative,
    housing_inertia=not_negative,
    damping=not_negative,
    friction=st.none() | frictions,
    winding=st.none() | st.builds(Winding, torque_constant=positive, resistance=positive),
)
payloads = st.builds(
    Payload, mass=not_negative, inertia=not_negative, offset=st.one_of(numbers, pairs)
)


@st.composite
def arm_specs(draw):
    """Draw an arm of one to three links."""
    drawn = draw(st.lists(links(), min_size=1, max_size=3))
    as_many = st.lists(joints, min_size=len(drawn), max_size=len(drawn))
    return ArmSpec(
        links=drawn,
        joints=draw(st.none() | as_many),
        payload=draw(payloads),
        gravity=draw(pairs),
        theory=draw(st.sampled_from(["linear", "second_order"])),
    )


@st.composite
def mechanism_specs(draw):
    """Draw an arm with branches, sliding joints, a base that moves and closures."""
    arm = draw(arm_specs())
    links, joints = [], []
    for i, (link, joint) in enumerate(zip(arm.links, arm.joints, strict=True)):
        parent = draw(st.none() | st.integers(0, i))
        carrier = arm.links[(i if parent is None else parent) - 1] if i and parent != 0 else None
        parts = [0.0, 1.0] if carrier and carrier.damping and carrier.flexible else [0.0, 0.4, 1.0]
        part = draw(st.none() | st.sampled_from(parts)) if carrier else None
        station = None if part is None else part * carrier.length
        links.append(link.replace(parent=parent, parent_station=station))
        axis = draw(st.none() | st.just((1.0, 0.0)) | st.tuples(positive, numbers))
        kind = {} if draw(st.booleans()) else {"kind": "prismatic", "axis": axis}
        place = {"offset": draw(pairs), "mounting_angle": draw(numbers)}
        joints.append(joint.replace(**kind, **place))
    free = draw(st.lists(st.sampled_from(["x", "y", "angle"]), unique=True))
    springs = [draw(not_negative) if name in free else 0.0 for name in ("x", "y", "angle")]
    base = Base(mass=draw(positive), inertia=draw(positive), free=free, stiffness=springs)
    curve = {"kind": "curve", "shape": RoundWall((0.1, 0.0), 0.5)}
    weld = {"kind": "weld", "angle": 0.1}
    kinds = st.sampled_from([{"kind": "pin"}, weld, {"kind": "line"}, curve])
    numbered = draw(st.lists(st.integers(1, len(links)), unique=True))
    closures = [Closure(link=link, to_offset=draw(pairs), **draw(kinds)) for link in numbered]
    return arm.replace(links=links, joints=joints, base=base, closures=closures)


@st.composite
def time_tables(draw, kind, values):
    """Draw a table over time, with jumps among its times."""
    times = sorted(draw(st.lists(st.integers(-3, 9), min_size=1, max_size=5)))
    kept = [t for k, t in enumerate(times) if times[:k].count(t) < 2]
    return kind(times=kept, values=draw(st.lists(values, min_size=len(kept), max_size=len(kept))))


@st.composite
def loads(draw, arm):
    """Draw a load on the arm, at a point or distributed."""
    link = draw(st.integers(1, len(arm.links)))
    length = arm.links[link - 1].length
    common = {
        "link": link,
        "force": draw(pairs),
        "frame": draw(st.sampled_from(["world", "link"])),
        "factor": draw(st.none() | time_tables(FactorTable, numbers)),
    }
    if draw(st.booleans()):
        return Load(**common, spread=(draw(st.floats(0.0, 0.5)) * length, length))
    station = draw(st.none() | st.floats(0.0, length))
    return Load(**common, moment=draw(numbers), station=station)


@st.composite
def prescribed_joints(draw, count, has_motion):
    """Draw prescribed joints, each at most once."""
    kinds = ["hold", "table", "motion"] if has_motion else ["hold", "table"]
    found = []
    for joint in draw(st.lists(st.integers(1, count), unique=True, max_size=count)):
        kind = draw(st.sampled_from(kinds))
        if kind == "table":
            angles = draw(st.lists(numbers, min_size=3, max_size=3))
            ends = draw(st.sampled_from(["rest", "free"]))
            found.append(
                TabulatedJoint(joint=joint, times=(-1, 0.5, 100), angles=angles, ends=ends)
            )
        else:
            found.append({"hold": HeldJoint, "motion": FollowingJoint}[kind](joint=joint))
    return found


@st.composite
def events(draw, count):
    """Draw events of both kinds, with unique names or none."""
    found = []
    for name in draw(st.lists(st.sampled_from(["yes", "1e5", "floor"]), unique=True)):
        common = {
            "name": draw(st.sampled_from([name, None])),
            "direction": draw(st.sampled_from(["both", "rising", "falling"])),
            "terminal": draw(st.booleans()),
        }
        if draw(st.booleans()):
            joint, angle = draw(st.integers(1, count)), draw(numbers)
            found.append(JointEvent(joint=joint, angle=angle, **common))
        else:
            normal = (draw(positive), draw(numbers))
            found.append(TipEvent(point=draw(pairs), normal=normal, **common))
    return found


@st.composite
def initial_states(draw, each):
    """Draw the start of an arm: in motion, or in equilibrium."""
    angles = draw(st.none() | each)
    if draw(st.booleans()):
        return InitialState(joint_angle=angles, joint_rate=draw(st.none() | each))
    return InitialState(joint_angle=angles, equilibrium=True, balance=draw(st.booleans()))


shapings = st.builds(
    ShapingSpec,
    method=st.sampled_from(["zv", "zvd", "zvdd", "ei", "si"]),
    modes=st.sampled_from([1, 2, [1, 3]]),
    joints=st.sampled_from(["locked", "free", ["free", [1.0, 0.5]]]),
    damping_ratio=st.none() | st.floats(0.0, 0.99),
)
forces = st.integers(1, 4).flatmap(
    lambda count: st.builds(
        ForceTable,
        times=st.lists(numbers, min_size=count, max_size=count, unique=True).map(sorted),
        values=st.lists(not_negative, min_size=count, max_size=count),
    )
)


@st.composite
def scenarios(draw):
    """Draw a scenario with any motion and any drive that matches it."""
    arm = draw(arm_specs())
    each = st.lists(numbers, min_size=len(arm.links), max_size=len(arm.links))
    timing = {
        "duration": positive,
        "profile": st.sampled_from(["quintic", "trapezoidal"]),
        "start_time": not_negative,
        "shaping": st.none() | shapings,
        "smoothing": st.none() | st.builds(SmoothingSpec, duration=positive),
    }
    of_the_tip = {"elbow": st.sampled_from(["up", "down"]), **timing}
    points = st.lists(pairs, min_size=2, max_size=4)
    plain = st.one_of(
        st.builds(JointMotionSpec, start=each, end=each, **timing),
        st.builds(LineMotionSpec, start=pairs, end=pairs, **of_the_tip),
        st.builds(ViaPointMotionSpec, points=points, blend=st.none() | positive, **of_the_tip),
        st.builds(SplineMotionSpec, points=points, **of_the_tip),
        st.builds(
            CircleMotionSpec, center=pairs, start=pairs, angle=numbers.filter(bool), **of_the_tip
        ),
    )
    pressed = st.builds(
        PressedMotionSpec,
        path=plain,
        force=not_negative | forces,
        normal=pairs.filter(any),
        friction=not_negative,
    )
    motion = draw(st.one_of(st.none(), plain, pressed))
    presses = isinstance(motion, PressedMotionSpec)
    gains = not_negative | st.lists(not_negative, min_size=len(arm.links), max_size=len(arm.links))
    wound = all(joint.fixed or joint.winding is not None for joint in arm.joints)
    drives = [
        st.just(NoDrive()),
        st.builds(
            TorqueDrive,
            rate=positive,
            values=st.lists(each, min_size=2, max_size=4),
            interpolation=st.sampled_from(["cubic", "linear", "hold"]),
            quantity=st.sampled_from(["torque", "voltage"] if wound else ["torque"]),
        ),
    ]
    if motion is not None:
        pd = st.builds(
            CONTROLLED["joint_pd"],
            proportional=gains,
            derivative=gains,
            feedforward=st.sampled_from(["none", "rigid_inverse_dynamics"][: 1 if presses else 2]),
            sample_time=positive,
        )
        drives += [
            *([] if presses else [st.just(RigidInverseDynamicsDrive())]),
            pd,
            st.builds(CONTROLLED["hybrid_force"], frequency=positive),
            st.builds(
                CONTROLLED["lqg"],
                posture=st.none() | each,
                measured=st.dictionaries(st.sampled_from(["tip", "strain"]), positive, min_size=1),
                integral=st.sampled_from([None, True, "tip", {"joint_angle": 0.1}]),
            ),
            st.builds(
                CONTROLLED["adaptive"],
                bandwidth=positive,
                damping=gains,
                adaptation=not_negative,
                parameters=st.sampled_from(["links", ["payload.mass", "link_1.inertia"]]),
                bounds=st.none()
                | st.dictionaries(st.just("payload.mass"), pairs.map(sorted), min_size=1),
            ),
            st.builds(CONTROLLED["disturbance_observer"], inner=pd, compensation=ratios),
            st.builds(
                CONTROLLED["estimator"],
                inner=st.builds(CONTROLLED["disturbance_observer"], inner=pd),
                estimator=st.builds(
                    FilterSpec,
                    instruments=st.none()
                    | st.lists(st.builds(Instrument, signal=st.just("joint_angle")), max_size=2),
                ),
            ),
            st.builds(
                CONTROLLED["joint_pid"],
                proportional=gains,
                derivative=gains,
                integral=gains,
                torque_limit=st.none() | positive,
                sample_time=positive,
            ),
            st.builds(CONTROLLED["computed_torque"], frequency_hz=positive, damping_ratio=gains),
            st.builds(
                CONTROLLED["strain_feedback"], proportional=gains, derivative=gains, strain=gains
            ),
        ]
    drive = draw(st.one_of(drives))
    moved = (
        []
        if drive.kind in CONTROLLED
        else draw(prescribed_joints(len(arm.links), motion is not None and not presses))
    )
    initial = draw(initial_states(each))
    if balances(drive):
        initial = initial.replace(balance=False)
    return Scenario(
        arm=arm,
        motion=motion,
        drive=drive,
        prescribed=moved,
        loads=draw(st.lists(loads(arm), max_size=2)),
        base_acceleration=draw(st.none() | pairs | time_tables(AccelerationTable, pairs)),
        events=draw(events(len(arm.links))),
        initial=initial,
        run=draw(
            st.builds(
                RunSpec,
                duration=st.floats(1e-3, 10.0),
                rate=st.floats(1.0, 1e5),
                stations=st.sampled_from([0, 2, 11, 1000]),
                integrator=st.sampled_from(["auto", "yes", "1e5", "null", "rk4"]),
                rtol=st.none() | st.floats(1e-12, 0.5),
                atol=st.none() | positive,
                step=st.none() | st.floats(1e-6, 1e-3),
            )
        ),
    )
