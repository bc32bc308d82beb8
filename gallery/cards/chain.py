"""Chain of ten links

Ten steel strips fall from a horizontal line; energy is constant, and the end whips.

[Build a mechanism](../how-to/build-a-mechanism.md)
"""

import flexarm as fa

strip = fa.Link(
    length=0.2, material="steel", section=fa.Rectangle(width=0.02, height=0.003), elements=1
)
arm = fa.Arm(links=[strip] * 10, gravity=(0.0, -9.81))
run = fa.simulate(arm, 2.4, rate=200.0)
fa.animate(run, "chain.html", channels="kinetic_energy", torque=False, speed=0.6, fps=20)
