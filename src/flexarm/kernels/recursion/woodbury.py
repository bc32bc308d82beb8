"""Inverse of the identity plus a product of two symmetric 3 x 3 matrices, (R.8).

It gives the inertia of the outboard chain in series with the modal springs: ``W`` is the inertia
without the springs, ``Y`` with them.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import merged


@merged
def softened(
    Wxx: Any, Wxy: Any, Wyy: Any, Wxw: Any, Wyw: Any, Www: Any,
    Nxx: Any, Nxy: Any, Nyy: Any, Nxw: Any, Nyw: Any, Nww: Any,
) -> Any:  # fmt: skip
    """Return the six entries of Y = (1 + W N)^-1 W for symmetric W and N; W may be singular."""
    axx = 1.0 + Wxx * Nxx + Wxy * Nxy + Wxw * Nxw
    axy = Wxx * Nxy + Wxy * Nyy + Wxw * Nyw
    axw = Wxx * Nxw + Wxy * Nyw + Wxw * Nww
    ayx = Wxy * Nxx + Wyy * Nxy + Wyw * Nxw
    ayy = 1.0 + Wxy * Nxy + Wyy * Nyy + Wyw * Nyw
    ayw = Wxy * Nxw + Wyy * Nyw + Wyw * Nww
    awx = Wxw * Nxx + Wyw * Nxy + Www * Nxw
    awy = Wxw * Nxy + Wyw * Nyy + Www * Nyw
    aww = 1.0 + Wxw * Nxw + Wyw * Nyw + Www * Nww
    cxx = ayy * aww - ayw * awy
    cxy = axw * awy - axy * aww
    cxw = axy * ayw - axw * ayy
    cyx = ayw * awx - ayx * aww
    cyy = axx * aww - axw * awx
    cyw = axw * ayx - axx * ayw
    cwx = ayx * awy - ayy * awx
    cwy = axy * awx - axx * awy
    cww = axx * ayy - axy * ayx
    d = 1.0 / (axx * cxx + axy * cyx + axw * cwx)
    Yxx = d * (cxx * Wxx + cxy * Wxy + cxw * Wxw)
    Yxy = d * (cxx * Wxy + cxy * Wyy + cxw * Wyw)
    Yxw = d * (cxx * Wxw + cxy * Wyw + cxw * Www)
    Yyy = d * (cyx * Wxy + cyy * Wyy + cyw * Wyw)
    Yyw = d * (cyx * Wxw + cyy * Wyw + cyw * Www)
    Yww = d * (cwx * Wxw + cwy * Wyw + cww * Www)
    return Yxx, Yxy, Yyy, Yxw, Yyw, Yww
