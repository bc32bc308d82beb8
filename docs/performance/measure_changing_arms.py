"""Tables of docs/performance/controllers.md: controllers on arms that change, with faulty sensors.

python docs/performance/measure_changing_arms.py
"""

from __future__ import annotations

import warnings

import flexarm as fa

GAINS = [40.0, 10.0], [20.0, 3.0]


def believed_arm():
    """Return the arm of the model."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    rod |= {"damping": fa.ModalDamping(ratio=0.01)}
    rod |= {"gauges": [fa.Gauge(station=0.05, distance=0.005)]}
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
        payload=fa.Payload(mass=0.1),
    )


def laws(arm):
    """Return the controllers with their references."""
    line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=2.0, start_time=0.5)
    static = fa.quasi_static_reference(arm, line)
    inverse = fa.tip_inversion(arm, line, pre_actuation=0.5, post_actuation=0.5)
    tip = {"acceptable": {"tip": 0.01, "joint_rate": 0.1}, "schedule": [None, [-1.2, -0.9, -0.6]]}
    feedforward = {"feedforward": static.torque}
    static_pd = fa.JointPD(*GAINS, **feedforward)
    sliding = {"reaching": [0.3, 0.1], "damping": [6.0, 1.5]}
    return {
        "LQG": (fa.LQG(arm, **tip), line),
        "MPC": (fa.MPC(arm, torque_limit=[20.0, 8.0], **tip), line),
        "joint PD": (static_pd, static),
        "joint PD + inversion": (fa.JointPD(*GAINS, feedforward=inverse.torque), inverse.reference),
        "strain feedback": (fa.StrainFeedback(*GAINS, [500.0, 100.0], **feedforward), static),
        "joint PID": (fa.JointPID(*GAINS, [30.0, 8.0], **feedforward), static),
        "computed torque": (fa.ComputedTorque(arm, 0.5, 0.7, **feedforward), static),
        "disturbance observer": (fa.DisturbanceObserver(arm, static_pd, 0.5), static),
        "sliding mode": (fa.SlidingMode(arm, 3.0, 0.3, {"payload.mass": 0.1}, **sliding), static),
        "adaptive": (
            fa.Adaptive(arm, 3.0, [6.0, 1.5], 0.05, ["payload.mass"], leakage=0.02),
            static,
        ),
        "composite": (fa.Composite(arm), line),
        "joint PD, rigid": (fa.JointPD(*GAINS, feedforward=fa.rigid_torque(arm, line)), line),
    }


def changing_plants(arm):
    """Return arms whose payload doubles at 1.2 s, whose links soften from 0.5 to 2.5 s, or both."""
    pick = [fa.Change("payload.mass", at=1.2, to=0.2)]
    softer = [0.5, 2.5], [1.0, 0.7]
    fade = [
        fa.Change(f"links[{k}].flexural_rigidity", factor=softer, interval=0.05) for k in (0, 1)
    ]
    both = [*pick, *fade]
    return {
        "nominal": arm,
        "payload x 2": (arm, pick),
        "EI - 30 %": (arm, fade),
        "both": (arm, both),
    }


def readings(signal, *faults):
    """Return instruments of which one has faults; the others are exact."""
    faulty = {signal: faults}
    names = "joint_angle", "joint_rate", "strain"
    return [fa.Hardware([fa.Instrument(name, faults=faulty.get(name, ())) for name in names])]


def failing_plants(arm):
    """Return the arm with sensors that fail."""
    fault = fa.InstrumentFault
    bias = fault("bias", 2e-3, start=1.2, channel=1)
    stuck = fault("frozen", start=1.2, end=1.22, channel=1)
    drift = fault("drift", 2e-5, channel=1)
    lost = fault("gain", 0.0, start=1.2, channel=1)
    return {
        "nominal": arm,
        "encoder bias": (arm, readings("joint_angle", bias)),
        "stuck 20 ms": (arm, readings("joint_angle", stuck)),
        "gauge drifts": (arm, readings("strain", drift)),
        "gauge lost": (arm, readings("strain", lost)),
    }


def table(plants, ratio):
    """Return the table of the errors on the plants; with the ratio of the last to the first."""
    arm = plants["nominal"]
    last = list(plants)[-1].split()[-1]
    ratios = f"{last + ' / nominal':>16}" if ratio else ""
    heads = "".join(f"{plant:>14}" for plant in plants) + ratios
    lines = [f"{'tip RMS, mm':22}{heads}{'residual, ' + last:>16}"]
    for name, (controller, reference) in laws(arm).items():
        found = fa.compare(
            arm, {name: controller}, 6.0, {"line": reference}, plants, settling=0.5, rate=200.0
        )
        rms = 1e3 * found.tip_error_rms.values.ravel()
        swing = 1e3 * found.residual_vibration.values.ravel()[-1]
        cells = "".join(f"{value:14.2f}" for value in rms)
        quotient = f"{rms[-1] / rms[0]:16.1f}" if ratio else ""
        lines.append(f"{name:22}{cells}{quotient}{swing:16.1f}")
    return "\n".join(lines)


def tables():
    """Return the tables by the name of their part of the page."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)  # some cases bend links far
        arm = believed_arm()
        yield "changes", table(changing_plants(arm), ratio=True)
        yield "faults", table(failing_plants(arm), ratio=False)


if __name__ == "__main__":
    for _, text in tables():
        print(text, end="\n\n", flush=True)
