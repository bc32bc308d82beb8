"""Symmetric 3 x 3 matrices of planar wrenches, as tuples (xx, xy, yy, xw, yw, ww), (R.8), (R.11).

A full 3 x 3 matrix is a tuple of its rows, (xx, xy, xw, yx, yy, yw, wx, wy, ww).
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.compilation.cache import merged

#: Added to divisors that may be zero.
_TINY = 1e-300
#: Pivot over its diagonal entry that is a rounding error.
_ROUNDING = 1e-14


@merged
def softened(W: Any, N: Any) -> Any:
    """Return Y = (1 + W N)^-1 W for symmetric W and N; W may be singular.

    If W is the inertia of the outboard chain without the springs of the modes, N, Y is the inertia
    with them.
    """
    Wxx, Wxy, Wyy, Wxw, Wyw, Www = W
    Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
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


@merged
def softened_by_factors(W: Any, N: Any) -> Any:
    """Return the same, accurate for a heavy body far from the point of reference.

    With W = L D L' and B = L' N L, Y = L (1 + D B)^-1 D L': both matrices that are eliminated are
    positive (semi)definite, so that no large numbers are subtracted. The cofactors of 1 + W N lose
    the square of its condition, but need one division instead of five in a row.
    """
    Wxx, Wxy, Wyy, Wxw, Wyw, Www = W
    Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
    # W = L D L' in the order w, y, x; the columns of L are (1, a, b), (0, 1, e), (0, 0, 1).
    a, b = Wyw / (Www + _TINY), Wxw / (Www + _TINY)
    d1, d2 = Www, Wyy - a * Wyw
    left = Wxy - b * Wyw
    rounding = _ROUNDING * Wyy
    e = left * d2 / (d2 * d2 + rounding * rounding + _TINY)  # left / d2, or 0 for a singular W
    d3 = Wxx - b * Wxw - e * left
    tw, ty, tx = Nww + a * Nyw + b * Nxw, Nyw + a * Nyy + b * Nxy, Nxw + a * Nxy + b * Nxx
    sx = Nxy + e * Nxx
    Bww, Byw = tw + a * ty + b * tx, ty + e * tx
    Byy = Nyy + e * Nxy + e * sx
    # Z = (1 + D B)^-1 D, whose pivots are at least 1.
    p1 = 1.0 + d1 * Bww
    p2 = 1.0 + d2 * Byy - d2 * Byw / p1 * d1 * Byw
    q = sx - d1 * tx * Byw / p1
    p3 = 1.0 + d3 * Nxx - d3 * tx / p1 * d1 * tx - d3 * q / p2 * d2 * q
    Zxx = d3 / p3
    Zxy = -d2 * q / p2 * Zxx
    Zxw = -(d1 * tx * Zxx + d1 * Byw * Zxy) / p1
    Zyy = d2 / p2 * (1.0 - q * Zxy)
    Zyw = -d1 * (Byw * Zyy + tx * Zxy) / p1
    Zww = d1 / p1 * (1.0 - Byw * Zyw - tx * Zxw)
    Yyw, Yxw = a * Zww + Zyw, b * Zww + e * Zyw + Zxw
    uyy, uxy, uxx = a * Zyw + Zyy, b * Zyw + e * Zyy + Zxy, b * Zxw + e * Zxy + Zxx
    return b * Yxw + e * uxy + uxx, a * Yxw + uxy, a * Yyw + uyy, Yxw, Yyw, Zww


@merged
def product(Y: Any, T: Any) -> Any:
    """Return the full matrix Y T of a symmetric Y and a full T."""
    Yxx, Yxy, Yyy, Yxw, Yyw, Yww = Y
    Txx, Txy, Txw, Tyx, Tyy, Tyw, Twx, Twy, Tww = T
    return (
        Yxx * Txx + Yxy * Tyx + Yxw * Twx,
        Yxx * Txy + Yxy * Tyy + Yxw * Twy,
        Yxx * Txw + Yxy * Tyw + Yxw * Tww,
        Yxy * Txx + Yyy * Tyx + Yyw * Twx,
        Yxy * Txy + Yyy * Tyy + Yyw * Twy,
        Yxy * Txw + Yyy * Tyw + Yyw * Tww,
        Yxw * Txx + Yyw * Tyx + Yww * Twx,
        Yxw * Txy + Yyw * Tyy + Yww * Twy,
        Yxw * Txw + Yyw * Tyw + Yww * Tww,
    )


@merged
def transformed(H: Any, T: Any, g: Any) -> Any:
    """Return the symmetric H + T' g, where g = Y T for a symmetric Y."""
    Hxx, Hxy, Hyy, Hxw, Hyw, Hww = H
    Txx, Txy, Txw, Tyx, Tyy, Tyw, Twx, Twy, Tww = T
    gxx, gxy, gxw, gyx, gyy, gyw, gwx, gwy, gww = g
    Hxx += Txx * gxx + Tyx * gyx + Twx * gwx
    Hxy += Txx * gxy + Tyx * gyy + Twx * gwy
    Hyy += Txy * gxy + Tyy * gyy + Twy * gwy
    Hxw += Txx * gxw + Tyx * gyw + Twx * gww
    Hyw += Txy * gxw + Tyy * gyw + Twy * gww
    Hww += Txw * gxw + Tyw * gyw + Tww * gww
    return Hxx, Hxy, Hyy, Hxw, Hyw, Hww


@merged
def turned(R: Any, cosine: Any, sine: Any) -> Any:
    """Return a symmetric matrix R in axes turned back by the angle of the cosine and sine."""
    Rxx, Rxy, Ryy, Rxw, Ryw, Rww = R
    cross = 2.0 * cosine * sine * Rxy
    Wxx = cosine * cosine * Rxx - cross + sine * sine * Ryy
    Wyy = sine * sine * Rxx + cross + cosine * cosine * Ryy
    Wxy = cosine * sine * (Rxx - Ryy) + (cosine * cosine - sine * sine) * Rxy
    Wxw = cosine * Rxw - sine * Ryw
    Wyw = sine * Rxw + cosine * Ryw
    return Wxx, Wxy, Wyy, Wxw, Wyw, Rww


@merged
def shifted(R: Any, x: Any, y: Any) -> Any:
    """Return the inertia R about a point from which its own point of reference is at (x, y)."""
    Rxx, Rxy, Ryy, Rxw, Ryw, Rww = R
    Wxw = Rxw + x * Rxy - y * Rxx
    Wyw = Ryw + x * Ryy - y * Rxy
    return Rxx, Rxy, Ryy, Wxw, Wyw, Rww + x * (Ryw + Wyw) - y * (Rxw + Wxw)


@merged
def read_symmetric(columns: Any, i: int, first: int) -> Any:
    """Return the symmetric matrix in the six columns from ``first`` on of row i."""
    Nxx, Nxy, Nyy = columns[i, first], columns[i, first + 1], columns[i, first + 2]
    return Nxx, Nxy, Nyy, columns[i, first + 3], columns[i, first + 4], columns[i, first + 5]


@merged
def write_symmetric(columns: Any, i: int, first: int, N: Any) -> None:
    """Write a symmetric matrix into the six columns from ``first`` on of row i."""
    Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
    columns[i, first], columns[i, first + 1], columns[i, first + 2] = Nxx, Nxy, Nyy
    columns[i, first + 3], columns[i, first + 4], columns[i, first + 5] = Nxw, Nyw, Nww


@merged
def add_symmetric(columns: Any, i: int, first: int, N: Any) -> None:
    """Add a symmetric matrix to the six columns from ``first`` on of row i."""
    Mxx, Mxy, Myy, Mxw, Myw, Mww = read_symmetric(columns, i, first)
    Nxx, Nxy, Nyy, Nxw, Nyw, Nww = N
    M = (Mxx + Nxx, Mxy + Nxy, Myy + Nyy, Mxw + Nxw, Myw + Nyw, Mww + Nww)
    write_symmetric(columns, i, first, M)


@merged
def write_full(columns: Any, i: int, first: int, T: Any) -> None:
    """Write a full matrix into the nine columns from ``first`` on of row i."""
    Txx, Txy, Txw, Tyx, Tyy, Tyw, Twx, Twy, Tww = T
    columns[i, first], columns[i, first + 1], columns[i, first + 2] = Txx, Txy, Txw
    columns[i, first + 3], columns[i, first + 4], columns[i, first + 5] = Tyx, Tyy, Tyw
    columns[i, first + 6], columns[i, first + 7], columns[i, first + 8] = Twx, Twy, Tww
