"""From the specification of an arm to the arrays that the kernels work on.

The only place where the two meet: the model layer knows no arrays, the kernels know no links.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexarm.beams import LinkConstants, link_constants, rigid_constants
from flexarm.kernels.layout import ArmConstants
from flexarm.model import ArmSpec, Link, RayleighDamping

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Assembly:
    """Kernel constants of an arm, and where its coordinates stand in them.

    Attributes:
        constants: what the kernels read; n bodies of m modes each, padded.
        links: constants of each link, with its shapes.
        link_body: (links,) body that carries each link.
        coordinates: (dof,) position of each entry of q in the flattened (n, 1 + m) array.
        joint_index: (joints,) position of each joint angle in q.
        link_modes: (links,) number of modal coordinates of each link.
    """

    constants: ArmConstants
    links: tuple[LinkConstants, ...]
    link_body: IntArray
    coordinates: IntArray
    joint_index: IntArray
    link_modes: IntArray

    @property
    def bodies(self) -> int:
        """Number of bodies n, a payload beside the tip included."""
        return int(self.constants.mass.size)

    @property
    def modes(self) -> int:
        """Modes m that each body is padded to."""
        return int(self.constants.S.shape[1])


def assemble(spec: ArmSpec) -> Assembly:
    """Compute the constants of an arm.

    Raises:
        InputError: a link's mass matrix is not positive definite (theory page "beams").
    """
    links = tuple(
        _link_constants(link, f"arm.links[{index}]") for index, link in enumerate(spec.links)
    )
    link_modes = np.array([link.w2.size for link in links], dtype=np.intp)
    stride = 1 + int(link_modes.max())
    coordinates = np.concatenate(
        [body * stride + np.arange(1 + count) for body, count in enumerate(link_modes)]
    )
    joint_index = np.concatenate([[0], np.cumsum(1 + link_modes)[:-1]])
    return Assembly(
        constants=_arm_constants(spec, links),
        links=links,
        link_body=np.arange(len(links)),
        coordinates=coordinates.astype(np.intp),
        joint_index=joint_index.astype(np.intp),
        link_modes=link_modes,
    )


def _link_constants(link: Link, where: str) -> LinkConstants:
    beam = link.beam()
    if not link.flexible:
        return rigid_constants(
            beam.x,
            beam.mass_per_length,
            beam.rotary_inertia_per_length,
            elements=link.elements,
            where=where,
        )
    return link_constants(
        beam.x,
        beam.flexural_rigidity,
        beam.mass_per_length,
        beam.rotary_inertia_per_length,
        elements=link.elements,
        modes=link.modes,
        where=where,
    )


def _arm_constants(spec: ArmSpec, links: tuple[LinkConstants, ...]) -> ArmConstants:
    payload_body = spec.payload.mass > 0 and any(spec.payload.offset)
    n = len(links) + payload_body
    m = max(link.w2.size for link in links)
    second_order = spec.theory == "second_order"
    g = m if second_order else 0
    c = m if second_order or any(np.any(link.rotary) for link in links) else 0
    constants = ArmConstants(
        mass=np.zeros(n),
        first_moment_x=np.zeros(n),
        first_moment_y=np.zeros(n),
        inertia=np.zeros(n),
        length=np.zeros(n),
        S=np.zeros((n, m)),
        a=np.zeros((n, m)),
        P=np.zeros((n, m)),
        dP=np.zeros((n, m)),
        w2=np.zeros((n, m)),
        damping=np.zeros((n, m)),
        centrifugal=np.zeros((n, c, c)),
        D0=np.zeros((n, g, g)),
        G=np.zeros((n, g, g)),
        residual_inertia=np.zeros((n, 3)),
        residual_tip=np.zeros((n, 4)),
        N=np.zeros((n, 3)),
        tip_mass=np.zeros(n),
        tip_inertia=np.zeros(n),
        free=np.ones(n),
        joint_damping=np.zeros(n),
        gravity=np.array(spec.gravity, dtype=np.float64),
    )
    for i, (link, joint) in enumerate(zip(links, spec.joints, strict=True)):
        _place_link(constants, i, link, _modal_damping(spec.links[i], link), second_order)
        constants.inertia[i] += joint.hub_inertia
        constants.residual_inertia[i, 2] += joint.hub_inertia
        constants.joint_damping[i] = joint.damping
        if i > 0:  # the motor of this joint rides on the tip of the link before
            constants.tip_mass[i - 1] += joint.mass
            constants.tip_inertia[i - 1] += joint.housing_inertia
    if payload_body:
        _place_payload_body(constants, spec)
    else:
        constants.tip_mass[-1] += spec.payload.mass
        constants.tip_inertia[-1] += spec.payload.inertia
    for array in constants:
        array.setflags(write=False)
    return constants


def _place_link(
    constants: ArmConstants, i: int, link: LinkConstants, damping: FloatArray, second_order: bool
) -> None:
    k = link.w2.size
    constants.mass[i] = link.mass
    constants.first_moment_x[i] = link.first_moment
    constants.inertia[i] = link.inertia
    constants.length[i] = link.length
    for name in ("S", "a", "P", "dP", "w2"):
        getattr(constants, name)[i, :k] = getattr(link, name)
    constants.damping[i, :k] = damping
    constants.residual_inertia[i] = link.residual_inertia
    constants.residual_tip[i] = link.residual_tip.ravel()
    constants.N[i] = link.P @ link.P, link.P @ link.dP, link.dP @ link.dP
    if constants.centrifugal.shape[1]:
        constants.centrifugal[i, :k, :k] = -link.rotary
    if second_order:
        constants.centrifugal[i, :k, :k] -= link.D1
        constants.D0[i, :k, :k] = link.D0
        constants.G[i, :k, :k] = link.G


def _place_payload_body(constants: ArmConstants, spec: ArmSpec) -> None:
    """A payload beside the tip is one more rigid body, of no length, on a fixed joint."""
    payload = spec.payload
    x, y = payload.offset
    constants.mass[-1] = payload.mass
    constants.first_moment_x[-1] = payload.mass * x
    constants.first_moment_y[-1] = payload.mass * y
    constants.inertia[-1] = payload.inertia + payload.mass * (x * x + y * y)
    constants.residual_inertia[-1] = payload.mass, payload.mass * x, constants.inertia[-1]
    constants.residual_tip[-1] = 1.0, 0.0, 0.0, 1.0
    constants.free[-1] = 0.0


def _modal_damping(link: Link, shapes: LinkConstants) -> FloatArray:
    """Diagonal of the damping matrix over the link's modes (1/s): Rayleigh or by ratio."""
    if link.damping is None:
        return np.zeros_like(shapes.w2)
    if isinstance(link.damping, RayleighDamping):
        return link.damping.mass_coefficient + link.damping.stiffness_coefficient * shapes.w2
    ratio = np.array(link.damping.ratios(shapes.w2.size))
    return 2.0 * ratio * np.sqrt(shapes.w2)
