"""Table of docs/performance/controllers.md: nine controllers on arms that differ from their model.

python docs/performance/measure_uncertain_arms.py
"""

from __future__ import annotations

import warnings

import numpy as np

import flexarm as fa

GAIN = [30.0, 8.0]


def believed_arm():
    """Return the arm of the model."""
    gauges = [fa.Gauge(station=0.02, distance=0.005)]
    rod = {"flexural_rigidity": 600.0, "mass_per_length": 0.6, "elements": 1, "gauges": gauges}
    rod |= {"damping": fa.ModalDamping(ratio=0.005)}
    return fa.Arm(
        links=[fa.Link(length=1.0, **rod), fa.Link(length=0.8, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.2),
            fa.Joint(mass=0.5, hub_inertia=0.05, housing_inertia=0.05),
        ],
        payload=fa.Payload(mass=0.4),
    )


def real_arms(arm):
    """Return the simulated arms."""
    return {
        "as believed": arm,
        "2 m, 0.7 EI": fa.varied(arm, payload_factor=2.0, flexural_rigidity_factor=0.7),
        "0.6 EI": fa.varied(arm, flexural_rigidity_factor=0.6),
        "1.4 EI": fa.varied(arm, flexural_rigidity_factor=1.4),
        "0 m": fa.varied(arm, payload_factor=0.0),
        "3 m": fa.varied(arm, payload_factor=3.0),
        "friction": fa.varied(arm, friction=fa.Friction(coulomb=0.5, viscous=0.3)),
        "push": (arm, [fa.Load(2, (0.0, -4.0))]),  # N, at the tip
    }


class BackAndForth:
    """Along a line in 1 s, a rest of 0.2 s, and back; tabulated at every millisecond."""

    start_time = 6.0  # errors are evaluated from here on

    def __init__(self, line):
        self.way = line.state(np.arange(1001) / 1000)

    def place(self, t):
        """Return the row of the table and the sign of the direction."""
        leg, s = divmod(t, 1.2)
        k = min(round(1000 * s), 1000)
        return (k, 1.0) if leg % 2 == 0 else (1000 - k, -1.0)

    def joint_angle(self, t):
        """Return the angles, rad."""
        return self.way.angle[self.place(t)[0]]

    def joint_rate(self, t):
        """Return the rates, rad/s."""
        k, sign = self.place(t)
        return sign * self.way.rate[k]

    def joint_acceleration(self, t):
        """Return the accelerations, rad/s²."""
        return self.way.acceleration[self.place(t)[0]]


def laws(arm, line):
    """Return the controllers."""
    names = ["payload.mass"]
    names += [f"joint_{k}.{kind}" for k in (1, 2) for kind in ("viscous", "coulomb")]
    rubbing = dict(zip(names[1:], [0.3, 0.5, 0.3, 0.5], strict=True))
    angles = line.joint_angle(np.linspace(0.0, 1.0, 50))
    box = angles.min(axis=0) - 0.1, angles.max(axis=0) + 0.1
    linear = {
        "acceptable": {"tip": 0.01, "joint_rate": 0.1},
        "acceptable_torque": [32.6, 4.08],  # N m: 10 rad/s²
        "preview": 0.5,  # s
        "schedule": [None, [-1.6, -1.4, -1.2]],  # rad: one design for each angle of joint 2
    }
    sliding = {
        "disturbance": [6.5, 3.2],  # N m: largest effect of 4 N at the tip
        "reaching": [1.0, 0.5],
        "damping": [90.0, 20.0],
    }
    middle = fa.varied(arm, payload_mass=0.6)  # middle of the range from 0 to 1.2 kg
    wrong = {"payload.mass": 0.6, **rubbing}
    return {
        "joint PD": fa.JointPD([300.0, 80.0], GAIN),
        "computed torque": fa.ComputedTorque(arm, frequency_hz=10.0 / (2.0 * np.pi)),
        "LQG": fa.LQG(arm, **linear),
        "LQG, integral": fa.LQG(arm, integral={"joint_angle": 2e-3}, **linear),
        "MPC": fa.MPC(arm, torque_limit=[40.0, 15.0], **linear),
        "adaptive": fa.Adaptive(arm, 10.0, GAIN, [0.5, 1.0, 2.0, 1.0, 2.0], names, leakage=0.02),
        "sliding mode": fa.SlidingMode(middle, 12.0, 0.3, wrong, **sliding),
        "RBF network": fa.RBFAdaptive(arm, 10.0, GAIN, 2.0, *box, centres=(1, 5)),
        "PD, observer": fa.DisturbanceObserver(arm, fa.JointPD([300.0, 80.0], GAIN), 2.0),
    }


def tables():
    """Return the table by the name of its part of the page."""
    arm = believed_arm()
    plants = real_arms(arm)
    line = fa.line_motion(arm, [1.4, 0.4], [0.4, 1.4], 1.0)
    controllers = laws(arm, line)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.UnstableLoopWarning)  # MPC without payload
        found = fa.compare(arm, controllers, 7.2, {"line": BackAndForth(line)}, plants, rate=100.0)
    lines = [f"{'RMS of the tip, mm':26}" + "".join(f"{name:>13}" for name in list(plants)[1:])]
    errors = 1e3 * found.tip_error_rms.values[:, :, 0]
    for name, (first, *others) in zip(controllers, errors, strict=True):
        cells = "".join(f"{f'{x:.1f} {x / first:5.1f}x':>13}" for x in others)
        lines.append(f"{name:18}{first:8.1f}{cells}")
    yield "uncertain", "\n".join(lines)


if __name__ == "__main__":
    for _, text in tables():
        print(text)
