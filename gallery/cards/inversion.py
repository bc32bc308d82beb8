"""An exact path

Torques that begin before the motion lead the tip exactly along the line.

[Follow a motion exactly](../how-to/follow-exactly.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
arm = fa.Arm(
    links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]
)
line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.0, start_time=0.25)
inverse = fa.tip_inversion(arm, line)
torques = {"rigid torques": fa.rigid_torque(arm, line), "inverse torques": inverse.torque}
runs = {
    name: fa.simulate(arm, 1.8, torque=torque, initial=inverse.initial, rate=500.0)
    for name, torque in torques.items()
}
look = {"channels": "link_tip_deflection[1]", "torque": False, "speed": 0.5}
fa.animate(runs, "inversion.html", reference=line, **look)
