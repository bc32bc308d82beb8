"""Pick and place: the tip error of a flexible arm half a second after the end of its motion.

Two aluminium links of 0.5 m in a horizontal plane carry 0.3 kg from (0.8, 0.2) m to (0.2, 0.8) m in
0.6 s. The motors apply the torque of the rigid arm and feedback of the joint angles.

Prints: tip error 0.5 s after arrival: 3.28 mm
Usage: python pick_and_place.py [figure.png]
"""

import sys

import numpy as np

import flexarm as fa

start, target, duration = (0.8, 0.2), (0.2, 0.8), 0.6

damping = fa.ModalDamping(ratio=0.01)
bar = fa.Rectangle(width=0.04, height=0.008)  # bends across the height
link = fa.Link(length=0.5, material="aluminium", section=bar, modes=3, damping=damping)
arm = fa.Arm(
    links=[link, link],
    joints=[
        fa.Joint(hub_inertia=0.02),
        fa.Joint(hub_inertia=0.01, housing_inertia=0.002, mass=0.5),
    ],
    payload=fa.Payload(mass=0.3),
)

motion = fa.line_motion(arm, start, target, duration)
motors = fa.JointPD([120.0, 20.0], [8.0, 1.5], feedforward=fa.rigid_torque(arm, motion))
result = fa.simulate(arm, duration + 0.5, controller=motors, reference=motion)

error = np.linalg.norm(result["tip"].values[-1] - target)
print(f"tip error 0.5 s after arrival: {1e3 * error:.2f} mm")

if len(sys.argv) > 1:
    fa.plot.signals_figure(result).savefig(sys.argv[1])
