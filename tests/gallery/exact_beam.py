"""Independent solutions of beam problems, to recompute the reference values of the gallery.

The floating frames and finite elements of the package are not used. Linear problems: Ritz's method
with Legendre polynomials for the rotation of the sections. Large motions: Galerkin's method for the
angle of the tangent of an inextensible, unshearable beam. Both converge faster than any power of
the number of polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, eigh


@dataclass(frozen=True)
class Line:
    """Gauss points s (q,) with weights w on (0, length), and integrals from the root."""

    s: Any
    w: Any
    integral: Any  # (q, q): values at the points -> integral from 0 to each point


def line(points: int, length: float = 1.0) -> Line:
    x, w = legendre.leggauss(points)
    unit = np.eye(points)
    values = np.stack([legendre.legval(x, row) for row in unit], axis=1)
    integrals = np.stack(
        [legendre.legval(x, legendre.legint(row, lbnd=-1)) for row in unit], axis=1
    )
    running = integrals @ np.linalg.inv(values) * length / 2
    return Line((x + 1) / 2 * length, w * length / 2, running)


def polynomials(n, s, length=1.0, constrained=False):
    """Return Legendre polynomials of 2 s / length - 1 and their derivatives by s, each (q, n).

    Constrained ones are multiplied by s / length and vanish at the root.
    """
    x, unit = 2 * np.asarray(s) / length - 1, np.eye(n)
    values = np.stack([legendre.legval(x, row) for row in unit], axis=1)
    slopes = np.stack([legendre.legval(x, legendre.legder(row)) for row in unit], axis=1)
    slopes = slopes * 2 / length
    if constrained:
        factor = (np.asarray(s) / length)[:, None]
        return factor * values, values / length + factor * slopes
    return values, slopes


class RitzBeam:
    """Mass and stiffness of a uniform beam (L = EI = mu = 1 by default) with bodies at its ends.

    Args:
        root: "clamped", "pinned" or "free".
        rotary, shear: rho I / mu and EI / kGA, m^2.
        tension: axial force T(s), N, at the points, or None.
    """

    def __init__(
        self,
        root="clamped",
        n=16,
        *,
        length=1.0,
        rigidity=1.0,
        mass=1.0,
        hub=0.0,
        root_mass=0.0,
        tip_mass=0.0,
        tip_inertia=0.0,
        rotary=0.0,
        shear=0.0,
        tension=None,
    ):
        grid = line(n + 8, length)
        turn, bend = polynomials(n, grid.s, length, constrained=root == "clamped")
        ends = np.array([0.0, length])
        end_turn = polynomials(n, ends, length, constrained=root == "clamped")[0]
        slope = turn
        if shear:  # shear angles have independent shapes, which do not turn the sections
            angle = polynomials(n, grid.s, length)[0]
            slope = np.hstack([turn, angle])
            turn, bend = (np.hstack([m, 0 * angle]) for m in (turn, bend))
            end_turn = np.hstack([end_turn, np.zeros((2, n))])
        across, tip = grid.integral @ slope, grid.w @ slope
        if root == "free":
            across = np.hstack([across, np.ones((len(grid.s), 1))])
            tip = np.append(tip, 1.0)
            slope, turn, bend = (
                np.hstack([m, np.zeros((len(grid.s), 1))]) for m in (slope, turn, bend)
            )
            end_turn = np.hstack([end_turn, np.zeros((2, 1))])
        weight = grid.w[:, None]
        self.root_turn, self.tip_turn, self.tip = end_turn[0], end_turn[1], tip
        self.axis_mass = mass * across.T @ (weight * across)
        self.M = self.axis_mass + mass * rotary * turn.T @ (weight * turn)
        self.M += hub * np.outer(end_turn[0], end_turn[0])
        self.M += tip_mass * np.outer(tip, tip)
        self.M[-1, -1] += root_mass  # of a free root, whose translation is the last coordinate
        self.M += tip_inertia * np.outer(end_turn[1], end_turn[1])
        self.K = rigidity * bend.T @ (weight * bend)
        if shear:
            pure = slope - turn
            self.K += rigidity / shear * pure.T @ (weight * pure)
        if tension is not None:
            force = tension(grid.s)[:, None]
            self.K += slope.T @ (weight * force * slope)
        self.momentum = mass * grid.w @ across
        self.moment = mass * (grid.w * grid.s) @ across

    def frequencies(self, spin=0.0, rigid=0):
        """Return frequencies, ascending; a spin includes the rotation of the deflection; without
        rigid modes."""
        return lowest(self.M, self.K - spin**2 * self.axis_mass)[rigid:]


def lowest(M, K, shift=10.0):
    """Return square roots of the eigenvalues of K against M, ascending; the low ones are
    accurate."""
    inverse = eigh(M, K + shift * M, eigvals_only=True)[::-1]
    return np.sqrt(np.maximum(1 / inverse[inverse > 1e-12] - shift, 0.0))


def two_link_frequencies(elbow, first, second, lengths, rigidity, mass, n=14):
    """Return frequencies of two straight links on joints "locked" or "free", elbow at an angle
    (rad)."""
    roots = ["clamped" if joint == "locked" else "pinned" for joint in (first, second)]
    beams = [
        RitzBeam(root, n, length=length, rigidity=rigidity, mass=mass)
        for root, length in zip(roots, lengths, strict=True)
    ]
    M = block_diag(*(beam.M for beam in beams))
    K = block_diag(*(beam.K for beam in beams))
    inner, outer = beams
    link_mass, turn = mass * lengths[1], np.zeros(n)
    if second == "locked":  # the outer link turns with the tip of the inner one
        turn = inner.tip_turn
    # Velocity of a point of the outer link: v1(L1) across the inner link, and across itself its own
    # deflection plus s times the rotation of its root.
    cosine = np.cos(elbow)
    M[:n, :n] += link_mass * np.outer(inner.tip, inner.tip)
    M[:n, :n] += mass * lengths[1] ** 3 / 3 * np.outer(turn, turn)
    lever = cosine * mass * lengths[1] ** 2 / 2 * np.outer(inner.tip, turn)
    M[:n, :n] += lever + lever.T
    coupling = cosine * np.outer(inner.tip, outer.momentum) + np.outer(turn, outer.moment)
    M[:n, n:] += coupling
    M[n:, :n] += coupling.T
    return lowest(M, K, shift=100.0)[(first, second).count("free") :]


class TangentAngle:
    """Geometrically exact beam: its tangent angle over time, for a prescribed or free root angle.

    Args:
        prescribed: rate and acceleration of the root angle as functions of time, or None for a pin.
        moving: directions in which the root also moves, "", "x" or "xy".
        carried: mass at the root, which moves with it.
        rotary: rotary inertia of the sections per length.
        load: force Fx, Fy and moment on the root.
    """

    def __init__(
        self, n, length, rigidity, mass, *, gravity=0.0, prescribed=None, moving="", carried=0.0,
        rotary=0.0, load=(0.0, 0.0, 0.0),
    ):  # fmt: skip
        self.n, self.mass, self.gravity, self.prescribed = n, mass, gravity, prescribed
        self.moving, self.load, self.start = moving, load, 0.0
        self.grid = line(2 * n + 6, length)
        constrained = prescribed is not None
        self.P, bend = polynomials(n, self.grid.s, length, constrained=constrained)
        self.root = polynomials(n, [0.0], length, constrained=constrained)[0][0]
        weight = self.grid.w[:, None]
        self.K = rigidity * bend.T @ (weight * bend)
        size = n + len(moving)
        self.constant = np.zeros((size, size))
        self.constant[:n, :n] = rotary * self.P.T @ (weight * self.P)
        self.constant[n:, n:] = carried * np.eye(len(moving))

    def acceleration(self, t, q, qd):
        n = self.n
        rate, change = (f(t) for f in self.prescribed) if self.prescribed else (0.0, 0.0)
        angle, turning = self.P @ q[:n] + self.start, self.P @ qd[:n] + rate
        cosine, sine = np.cos(angle), np.sin(angle)
        integral, w = self.grid.integral, self.grid.w
        x, y = (integral @ (part[:, None] * self.P) for part in (-sine, cosine))
        for direction in self.moving:
            x = np.column_stack([x, np.full(w.size, float(direction == "x"))])
            y = np.column_stack([y, np.full(w.size, float(direction == "y"))])
        ax = integral @ (-cosine * turning**2 - sine * change)
        ay = integral @ (-sine * turning**2 + cosine * change) + self.gravity
        M = self.mass * (x.T @ (w[:, None] * x) + y.T @ (w[:, None] * y)) + self.constant
        force = self.mass * (x.T @ (w * ax) + y.T @ (w * ay))
        force[:n] += self.K @ q[:n] - self.load[2] * self.root
        force[n:] -= self.load[: len(self.moving)]
        return -np.linalg.solve(M, force)

    def run(self, times, rtol, start=0.0):
        """Return coordinates (times, n + moving) from a straight start at rest, at an angle."""
        self.start, size = start, self.n + len(self.moving)

        def rates(t, state):
            acceleration = self.acceleration(t, state[:size], state[size:])
            return np.concatenate([state[size:], acceleration])

        zero = np.zeros(2 * size)
        span = (0.0, times[-1])
        motion = solve_ivp(rates, span, zero, "DOP853", t_eval=times, rtol=rtol, atol=1e-12)
        return motion.y[:size].T

    def tips_of(self, motion):
        """Return the tip (times, 2) of coordinates of ``run``, in axes that turn with a prescribed
        angle, from the start of the root."""
        angle = motion[:, : self.n] @ self.P.T + self.start
        tips = np.stack([np.cos(angle) @ self.grid.w, np.sin(angle) @ self.grid.w], axis=1)
        for k, direction in enumerate(self.moving):
            tips[:, "xy".index(direction)] += motion[:, self.n + k]
        return tips

    def tips(self, times, rtol):
        """Return the tip (times, 2) in axes that turn with the prescribed angle, from a straight
        start at rest."""
        return self.tips_of(self.run(times, rtol))
