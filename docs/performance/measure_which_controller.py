"""Rows of the page "Which controller?", and its study in docs/performance/controllers.md.

python docs/performance/measure_which_controller.py
"""

import warnings

import numpy as np

import flexarm as fa

rod = {"mass_per_length": 0.61732, "damping": fa.ModalDamping(ratio=0.01)}
rod["gauges"] = [fa.Gauge(station=0.05, distance=0.005)]
ARM = fa.Arm(
    links=[
        fa.Link(length=1.4142, elements=2, flexural_rigidity=105.0, **rod),
        fa.Link(length=1.0, elements=1, flexural_rigidity=105.0, **rod),
    ],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)],
    payload=fa.Payload(mass=0.1),
)
LINE = fa.line_motion(ARM, start=(2.0, 1.0), end=(1.0, 2.0), duration=2.0, start_time=0.5)
PLANTS = {
    "model": ARM,
    "both": fa.varied(ARM, payload_factor=2.0, flexural_rigidity_factor=0.7),
}
STUDIED = {
    "as believed": ARM,
    "payload x 2": fa.varied(ARM, payload_factor=2.0),
    "EI - 30 %": fa.varied(ARM, flexural_rigidity_factor=0.7),
    "both": PLANTS["both"],
    "friction": fa.varied(ARM, friction=fa.Friction(coulomb=0.05, viscous=0.1)),
}


def studied():
    """Return the controllers of the study with their references."""
    gains = {"proportional": [40.0, 10.0], "derivative": [20.0, 3.0]}
    rigid = fa.rigid_torque(ARM, LINE)
    static = fa.quasi_static_reference(ARM, LINE)
    inverse = fa.tip_inversion(ARM, LINE, pre_actuation=0.5, post_actuation=0.5)
    names = ["payload.mass", "joint_1.viscous", "joint_2.viscous"]
    tip = {"acceptable": {"tip": 0.01, "joint_rate": 0.1}, "schedule": [None, [-1.2, -0.9, -0.6]]}
    wrong = dict.fromkeys(names, 0.1)
    sliding = {"reaching": [0.3, 0.1], "damping": [6.0, 1.5]}
    return {
        "joint PD": (fa.JointPD(**gains), LINE),
        "PD + rigid torque": (fa.JointPD(**gains, feedforward=rigid), LINE),
        "PD + quasi-static": (fa.JointPD(**gains, feedforward=static.torque), static),
        "PD + inversion": (fa.JointPD(**gains, feedforward=inverse.torque), inverse.reference),
        "LQG": (fa.LQG(ARM, **tip), LINE),
        "adaptive": (
            fa.Adaptive(ARM, 3.0, [6.0, 1.5], [0.05, 0.2, 0.2], names, leakage=0.02),
            LINE,
        ),
        "sliding mode": (fa.SlidingMode(ARM, 3.0, 0.3, wrong, **sliding), LINE),
    }


def tables():
    """Return the table of the study by the name of its part of the page."""
    lines = [f"{'tip RMS / residual, mm':24}" + "".join(f"{plant:>17}" for plant in STUDIED)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)  # the softer links bend far
        for name, (controller, reference) in studied().items():
            found = fa.compare(
                ARM, {name: controller}, 5.0, {"line": reference}, STUDIED, settling=0.5, rate=200.0
            )
            rms = 1e3 * found.tip_error_rms.values.ravel()
            swing = 1e3 * found.residual_vibration.values.ravel()
            cells = (f"{a:.1f} / {b:.1f}" for a, b in zip(rms, swing, strict=True))
            lines.append(f"{name:24}" + "".join(f"{cell:>17}" for cell in cells))
    yield "study", "\n".join(lines)


def controllers():
    """Yield names, controllers and their references."""
    static = fa.quasi_static_reference(ARM, LINE)
    middle = static.joint_angle(1.5)
    shaping = {"bandwidth": 12.0, "rigidity_uncertainty": 0.3, "feedforward": static.torque}
    yield "LoopShaping", fa.LoopShaping(ARM, middle, **shaping), static
    joints = fa.JointPD([400.0, 100.0], [40.0, 6.0], feedforward=static.torque)
    damped = fa.IntegralResonantControl(ARM, joints, 0.3, posture=middle)
    yield "IntegralResonantControl", damped, static
    weights = {
        "acceptable": {"tip": 0.01, "joint_rate": 0.1},
        "schedule": [None, [-1.2, -0.9, -0.6]],
    }
    planned = fa.MPC(ARM, torque_limit=[20.0, 8.0], sample_time=0.002, **weights)
    yield "MPC", planned, LINE


def errors(controller, reference):
    """Return the errors of the tip on the plants, mm RMS, as in the table of the page."""
    table = fa.compare(
        ARM, {"one": controller}, 5.0, {"line": reference}, PLANTS, settling=0.5, rate=200.0
    )
    return 1e3 * table.tip_error_rms.values.ravel()


def learning(plant):
    """Return the errors of the tip in eight trials of learning, mm RMS."""
    static = fa.quasi_static_reference(ARM, LINE)
    pd = fa.JointPD([40.0, 10.0], [20.0, 3.0], feedforward=static.torque)
    options = {"duration": 4.0, "interval": 0.01, "effort": 1e-4, "trials": 8}
    return 1e3 * fa.iterative_learning(ARM, static, pd, plant=plant, **options).error_rms


def main():
    """Print the rows and the study."""
    warnings.simplefilter("ignore", fa.LargeDeflectionWarning)  # the softer links bend far
    for name, controller, reference in controllers():
        model, both = errors(controller, reference)
        print(f"{name:24} {model:5.1f} mm on the model, {both:5.1f} mm with both", flush=True)
    for name, plant in PLANTS.items():
        found = learning(plant)
        print(f"learning, {name:14}", np.array2string(found, precision=3, suppress_small=True))
    for _, text in tables():
        print(text)


if __name__ == "__main__":
    main()
