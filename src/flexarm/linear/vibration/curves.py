"""Displacements of the neutral axis per unit of a mode shape, for figures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions.loads import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.observation.shapes import axis_points


def displacements(arm: Arm, q: FloatArray, shapes: NDArray[Any], stations: int) -> NDArray[Any]:
    """Return displacements (k, links, stations, 2) of the neutral axis, world axes, m.

    They are exactly linear in ``shapes`` (k, dof), real or complex: derivatives of the axis about
    q (dof,) by complex perturbation of its kernel.
    """
    places = [
        marker(number, x)
        for number, link in enumerate(arm.spec.links, start=1)
        for x in np.linspace(0.0, link.length, stations)
    ]
    placed = place_loads(arm, places)
    real = _along(arm, q, np.real(shapes), placed)
    moved = real + 1j * _along(arm, q, np.imag(shapes), placed) if np.iscomplexobj(shapes) else real
    return moved.reshape(len(shapes), arm.links, stations, 2)


def _along(arm: Arm, q: FloatArray, shapes: FloatArray, placed: Any) -> FloatArray:
    kernels = KernelView(arm.assembly.constants, complex)
    body_poses, tip = kernels.pose_arrays()
    points = np.zeros((len(shapes), len(placed.body), 2), dtype=complex)
    still = np.zeros(arm.dof)
    for shape, seen in zip(shapes, points, strict=True):
        state = arm.padded(np.stack([q + STEP * 1j * shape, still]))
        kernels.call(poses, state, body_poses, tip)
        axis_points(
            kernels.sizes,
            state,
            body_poses,
            placed.body,
            placed.lever,
            placed.rows,
            placed.shortening,
            seen,
        )
    found: FloatArray = points.imag / STEP
    return found
