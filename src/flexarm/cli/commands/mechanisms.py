"""Commented files of mechanisms to start from: texts for ``flexarm init --mechanism``."""

from __future__ import annotations

from typing import NamedTuple


class Template(NamedTuple):
    """An arm and what happens to it, as texts of YAML."""

    summary: str
    arm: str  # below the key ``arm``
    run: str  # all keys of the scenario but ``flexarm`` and ``arm``


_BAR = """\
    - &bar
      length: 0.9
      material: steel
      section: {kind: rectangle, width: 0.02, height: 0.003}  # height: depth in the plane
      modes: 3                   # a closure at the tip needs one of them
      damping: {kind: modal, ratio: 0.01}"""
_CRANK = """\
    - length: 0.3
      material: steel
      section: {kind: rectangle, width: 0.02, height: 0.02}
      flexible: false"""

TEMPLATES = {
    "four-bar": Template(
        "a crank, a flexible coupler and a flexible rocker",
        f"""\
  theory: second_order           # closure forces stretch and press the links
  links:
{_CRANK}            # crank
{_BAR}                       # coupler, on the tip of the crank
    - {{<<: *bar, length: 0.7, parent: 0}}  # rocker, on the base
  joints:
    - {{}}
    - {{}}
    - {{offset: [1.0, 0.0]}}       # m, from the origin of the base
  closures:
    - {{kind: pin, link: 2, to_link: 3}}  # the tips of coupler and rocker
""",
        """\
initial:
  joint_angle: [1.0, -0.5, 1.6]  # rad; the loop closes near these angles
  joint_rate: [6.0, 0.0, 0.0]    # rad/s of the crank; the others follow
""",
    ),
    "slider-crank": Template(
        "a crank, a flexible connecting rod, and a slider on a line",
        f"""\
  theory: second_order
  links:
{_CRANK}            # crank
{_BAR}                       # rod
  payload: {{mass: 0.3}}           # the slider, at the tip of the rod
  closures:
    - {{kind: line, link: 2, angle: 0.0}}  # the tip moves along x through the origin of the ground
""",
        """\
initial:
  joint_angle: [1.0, -1.2]
  joint_rate: [6.0, 0.0]
""",
    ),
    "five-bar": Template(
        "two motors on the base move one point by four bars",
        f"""\
  theory: second_order
  links:
{_BAR.replace("0.9", "0.5")}
    - {{<<: *bar}}
    - {{<<: *bar, parent: 0}}
    - {{<<: *bar}}
  joints:
    - {{offset: [-0.2, 0.0]}}
    - {{}}
    - {{offset: [0.2, 0.0]}}
    - {{}}
  payload: {{mass: 0.2}}
  closures:
    - {{kind: pin, link: 2, to_link: 4}}
""",
        """\
drive:
  kind: torque
  rate: 1.0                      # values per second, between which torques are interpolated
  values: [[0.05, 0, -0.05, 0], [-0.05, 0, 0.05, 0], [0, 0, 0, 0]]  # N m of each joint
initial:
  joint_angle: [2.2, -1.2, 0.94, 1.2]
""",
    ),
    "gantry": Template(
        "two sliding axes carry a flexible arm",
        f"""\
  links:
    - {{length: 0.1, mass_per_length: 20.0, flexible: false}}  # carriage
    - {{length: 0.1, mass_per_length: 10.0, flexible: false}}  # second carriage
{_BAR}
  joints:
    - {{kind: prismatic, damping: 5.0}}               # along x; positions in m, forces in N
    - {{kind: prismatic, axis: [0.0, 1.0], damping: 5.0}}
    - {{fixed: true, mounting_angle: -1.5707963}}      # the arm hangs
  payload: {{mass: 0.3}}
""",
        """\
motion: {kind: joint, start: [0.0, 0.0], end: [1.5, 0.2], duration: 1.5}
drive: {kind: joint_pd, proportional: 400.0, derivative: 60.0, sample_time: 0.001}
""",
    ),
    "free-flyer": Template(
        "a satellite with two flexible arms",
        f"""\
  base: {{mass: 20.0, inertia: 2.0, free: [x, y, angle]}}
  links:
{_BAR}
    - {{<<: *bar, parent: 0}}
  joints:
    - {{offset: [0.3, 0.0]}}
    - {{offset: [-0.3, 0.0], mounting_angle: 3.1415927}}
""",
        """\
drive:
  kind: torque
  rate: 1.0                      # values per second, between which torques are interpolated
  values: [[0.05, 0.05], [-0.05, -0.05], [0.0, 0.0]]  # N m of each joint
""",
    ),
    "crane": Template(
        "a trolley on a rail, a flexible mast with a boom, and a hanging load",
        f"""\
  gravity: [0.0, -9.81]
  base: {{mass: 50.0, free: [x], stiffness: [2000.0, 0.0, 0.0], damping: [50.0, 0.0, 0.0]}}
  links:
{_BAR.replace("0.003", "0.02")}
    - {{<<: *bar, length: 0.6}}
    - {{length: 0.5, mass_per_length: 0.05, flexible: false}}  # rope
  joints:
    - {{fixed: true, mounting_angle: 1.5707963}}
    - {{damping: 0.5, stiffness: 300.0, rest_angle: -1.5}}
    - {{mounting_angle: -1.6, damping: 0.001}}
  payload: {{mass: 1.0, inertia: 0.002}}
""",
        """\
initial:
  joint_angle: [-1.5, 0.3]
""",
    ),
}


def arm_text(kind: str) -> str:
    """Return the arm file of a mechanism."""
    return f"""\
# {TEMPLATES[kind].summary.capitalize()}. Units are SI: m, kg, s, N, rad.
# All keys: docs/reference/file-format.md. Check this file with: flexarm check arm.yaml
flexarm: 1
arm:
{TEMPLATES[kind].arm}"""


def scenario_text(kind: str) -> str:
    """Return the scenario file of a mechanism whose arm is in ``arm.yaml``."""
    return f"""\
# One run of the mechanism. Simulate it with: flexarm run scenario.yaml --animate arm.html
flexarm: 1
arm: arm.yaml
{TEMPLATES[kind].run}run:
  duration: 2.0       # s
  rate: 200           # recorded samples per second
"""
