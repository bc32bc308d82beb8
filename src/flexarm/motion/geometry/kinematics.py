"""Rigid kinematics of a planar chain: position and Jacobian of the tip.

Every function accepts leading axes, so that one call evaluates a whole motion:

| symbol | meaning | shape | unit | frame |
| --- | --- | --- | --- | --- |
| lengths | L_i, link lengths | (n,) | m | |
| angles | theta_i, relative joint angles | (..., n) | rad | joint 1 from world x |
| psi_i | theta_1 + ... + theta_i | (..., n) | rad | world |
| tip | sum of L_i (cos psi_i, sin psi_i) | (..., 2) | m | world |
| J | d tip / d theta | (..., 2, n) | m | world |
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def tip_position(lengths: Floats, angles: Floats) -> Floats:
    """Return the tip (..., 2) in world axes (m)."""
    psi = np.cumsum(angles, axis=-1)
    return np.stack([np.cos(psi) @ lengths, np.sin(psi) @ lengths], axis=-1)


def tip_jacobian(lengths: Floats, angles: Floats) -> Floats:
    """Return J (..., 2, n); column j is the rotation about joint j of the links outboard of it."""
    psi = np.cumsum(angles, axis=-1)
    links = np.stack([-lengths * np.sin(psi), lengths * np.cos(psi)], axis=-2)
    return _outboard_sum(links)


def tip_jacobian_rate(lengths: Floats, angles: Floats, rates: Floats) -> Floats:
    """Return dJ/dt (..., 2, n) when the joints turn at `rates` (..., n), rad/s."""
    psi = np.cumsum(angles, axis=-1)
    spin = lengths * np.cumsum(rates, axis=-1)
    links = np.stack([-spin * np.cos(psi), -spin * np.sin(psi)], axis=-2)
    return _outboard_sum(links)


def _outboard_sum(links: Floats) -> Floats:
    """Return the sum over links j, j+1, ..., n in column j."""
    return np.flip(np.cumsum(np.flip(links, axis=-1), axis=-1), axis=-1)
