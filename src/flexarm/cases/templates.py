"""Commented files to start from: arms with their scenarios, and mechanisms."""

from __future__ import annotations

from importlib.resources import files
from typing import NamedTuple

#: Mechanisms, each with its files in the folder of this name in the library.
MECHANISMS = {
    "four-bar": "a crank, a flexible coupler and a flexible rocker",
    "slider-crank": "a crank, a flexible connecting rod, and a slider on a line",
    "five-bar": "two motors on the base move one point by four bars",
    "gantry": "two sliding axes carry a flexible arm",
    "free-flyer": "a satellite with two flexible arms",
    "crane": "a trolley on a rail, a flexible mast with a boom, and a hanging load",
}


def mechanism_files(kind: str) -> tuple[str, str]:
    """Return the arm file of a mechanism, and the scenario file for it in ``arm.yaml``."""
    folder = files("flexarm") / "library" / "mechanisms" / kind
    arm, scenario = (folder / name for name in ("arm.yaml", "scenario.yaml"))
    return arm.read_text(encoding="utf-8"), scenario.read_text(encoding="utf-8")


REACH = 2.0
MOST_LINKS = 8
"""With more links of this kind the gains below are too high for the sample time."""
_WIDTH, _MATERIAL = 0.05, "aluminium"


class _Kind(NamedTuple):
    """What differs between slender and stiff arms."""

    height: float  # of the section, in the plane, m
    duration: float  # of the motion, s
    frequency: float  # of the closed loops of the joints, rad/s
    drive: str  # lines of the drive


_SLENDER = """\
drive:                # joint PD along the angles of the rigid arm, as if no link could bend:
  kind: joint_pd      # the arm rings after the motion
  reference: rigid    # without this line, along the angles of the bent arm: it rings less
"""
_STIFF = """\
drive:                # joint PD along the angles of the bent arm, with its torques as feedforward
  kind: joint_pd
"""


def _kind(links: int, gravity: bool, stiff: bool) -> _Kind:
    if stiff:
        return _Kind(0.02, 2.0, 6.0, _STIFF) if gravity else _Kind(0.008, 2.0, 2.5, _STIFF)
    slower = 0.5 * (links == 1)  # a single link is longer, and would bend too far
    if gravity:
        return _Kind(0.01, 0.8 + slower, 10.0, _SLENDER)
    return _Kind(0.006, 1.5 + slower, 10.0, _SLENDER)


_MOTOR, _PAYLOAD = 0.4, 0.3


def arm_files(links: int = 2, gravity: bool = False, stiff: bool = False) -> tuple[str, str]:
    """Return the arm file of a serial arm, and the scenario file for it in ``arm.yaml``."""
    kind = _kind(links, gravity, stiff)
    return _arm_text(links, gravity, kind), _scenario_text(links, gravity, kind)


def _arm_text(links: int, gravity: bool, kind: _Kind) -> str:
    """Return the arm file of an arm with 1 to 8 equal links."""
    described = "\n".join(_link(k, links, kind.height) for k in range(links))
    inertia = 0.2 if gravity else 0.1
    base = f"    - {{hub_inertia: {inertia}, damping: 0.1}}  # joint 1, on the ground"
    elbow = f"    - {{mass: {_MOTOR}, hub_inertia: {inertia}, housing_inertia: 0.1, damping: 0.1}}"
    joints = "\n".join([base, *[elbow] * (links - 1)])
    down = -9.81 if gravity else 0.0
    plane = "vertical" if gravity else "horizontal"
    return f"""\
# An arm that moves in a {plane} plane. Units are SI: m, kg, s, N, rad.
# All keys: docs/reference/file-format.md. Check this file with: flexarm check arm.yaml
flexarm: 1
arm:
  {f"gravity: [0.0, {down}]":<31}# [x, y], m/s^2
  theory: linear                 # second_order: rotation and axial forces stiffen the links
  links:
{described}
  joints:                        # in the order of the links
{joints}
    # hub_inertia: rotor, at the outer link; mass, housing_inertia: motor, on the inner link
  payload: {{mass: {_PAYLOAD}, inertia: 0.001}}  # at the tip: kg, kg m^2
"""


def _link(k: int, links: int, height: float) -> str:
    section = f"{{kind: rectangle, width: {_WIDTH}, height: {height}}}"
    if k > 0:
        return (
            "    - {<<: *link}                # as link 1; {<<: *link, length: 0.5}: a shorter one"
        )
    return f"""\
    - &link
      length: {_length(links)}
      material: {_MATERIAL}        # or youngs_modulus: 70.0e+9 and density: 2700.0
      section: {section}  # height: depth in the bending plane
      elements: 2                # finite elements; more for higher modes
      modes: 2                   # modes of vibration; a rigid link has flexible: false
      damping: {{kind: modal, ratio: 0.01}}"""


def _scenario_text(links: int, gravity: bool, kind: _Kind) -> str:
    """Return the scenario file for the arm of `_arm_text` in ``arm.yaml``."""
    # The gains follow from the inertia of the straight arm about each joint.
    from flexarm.model.arm.links import MATERIALS

    length = _length(links)
    mass = MATERIALS[_MATERIAL].density * _WIDTH * kind.height * length
    inertias = []
    for joint in range(links):
        outboard = range(links - joint)
        about = sum(mass * length**2 * ((k + 0.5) ** 2 + 1.0 / 12.0) for k in outboard)
        about += sum(_MOTOR * (k * length) ** 2 for k in outboard)
        about += _PAYLOAD * ((links - joint) * length) ** 2
        inertias.append(about + 0.1)
    proportional = [float(f"{inertia * kind.frequency**2:.2g}") for inertia in inertias]
    derivative = [float(f"{1.4 * inertia * kind.frequency:.2g}") for inertia in inertias]
    sample_time = 0.00025 if gravity and links > 3 else 0.0005
    start = "  equilibrium: true   # the run starts in the equilibrium under gravity\n"
    return f"""\
# One run of the arm. Simulate it with: flexarm run scenario.yaml --animate arm.html
# Try other values without editing: flexarm run scenario.yaml --set arm.payload.mass=1
flexarm: 1
arm: arm.yaml
{_motion(links, kind.duration)}
{kind.drive}\
  proportional: {proportional}  # N m/rad, one for each joint
  derivative: {derivative}  # N m s/rad
  sample_time: {sample_time}  # s
{f"initial:{chr(10)}{start}" if gravity else ""}run:
  duration: 4.0       # s
  rate: 500           # recorded samples per second
  integrator: auto    # flexarm check scenario.yaml prints the choice and its reason
"""


def _motion(links: int, duration: float) -> str:
    if links == 1:
        return f"""\
motion:
  kind: joint         # from one joint angle to another, from rest to rest
  start: [0.0]        # rad
  end: [1.0]
  duration: {duration}       # s"""
    return f"""\
motion:
  kind: line          # the tip on a straight line, from rest to rest; other paths:
  start: [1.6, 0.2]   #   {{kind: circle, center: [1.2, 0.4], start: [1.6, 0.4], angle: 6.28, ...}}
  end: [0.7, 1.2]     #   {{kind: spline, points: [[1.6, 0.2], [1.3, 0.9], [0.7, 1.2]], ...}}
  duration: {duration}       # s"""


def _length(links: int) -> float:
    return round(REACH / links, 4)
