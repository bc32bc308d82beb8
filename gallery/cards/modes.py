"""Modes

The first three modes of vibration of a mast of two links.

[Find modes](../how-to/modes.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 3}
arm = fa.Arm(
    links=[fa.Link(length=1.4, **rod), fa.Link(length=1.0, **rod)],
    joints=[fa.Joint(fixed=True, mounting_angle=1.5708), fa.Joint(fixed=True)],
)
modes = fa.modes(arm)
runs = {}
for k in range(3):
    start = 1e-3 * modes.shapes[k] / abs(modes.displacements()[k]).max()  # the mast moves by 1 mm
    hertz = modes.frequency_hz[k]
    runs[f"{hertz:.1f} Hz"] = fa.simulate(arm, 1.2, initial=start, rate=1000.0)
look = {"channels": [], "torque": False, "trace": False, "magnify": 250.0}
fa.animate(runs, "modes.html", speed=0.25, fps=20, **look)
