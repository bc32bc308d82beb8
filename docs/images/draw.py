"""Draw the moving picture of the README: ``python docs/images/draw.py``."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

import flexarm as fa

#: The arm of the README, sent along its line in half of the time, so that the links ring.
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
FPS, SLOWER = 20.0, 0.5


def main() -> None:
    """Write the animation as WebP beside this file."""
    links = [fa.Link(length=1.4142, elements=2, **ROD), fa.Link(length=1.0, elements=1, **ROD)]
    arm = fa.Arm(links=links, payload=fa.Payload(mass=0.2), theory="second_order")
    motion = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.0)
    torque = fa.rigid_torque(arm, motion)
    result = fa.simulate(arm, 1.7, torque=torque, rate=500.0)
    look = {"channels": ["link_tip_deflection", "joint_angle"], "magnify": 2.0, "torque": False}
    animation = fa.animate(result, speed=SLOWER, fps=FPS, width=720, reference=motion, **look)
    pictures = [Image.fromarray(picture[..., :3].copy()) for picture in animation.pictures()]
    lasting = [round(1e3 / FPS)] * (len(pictures) - 1) + [1200]  # ms
    path = Path(__file__).with_name("moving.webp")
    options = {"duration": lasting, "loop": 0, "quality": 50, "method": 4}
    pictures[0].save(path, save_all=True, append_images=pictures[1:], **options)


if __name__ == "__main__":
    main()
