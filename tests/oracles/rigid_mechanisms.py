"""Rigid mechanisms in closed form: slider-crank, four-bar, cart with pendulum, two bodies in space.

All links are uniform rods; SI units; x right, y up; angles from x. A mechanism of one degree of
freedom moves by Eksergian's equation of motion,

    I(theta) theta'' + 1/2 dI/dtheta theta'^2 = torque + sum m g . dc/dtheta,
    I = sum m |dc/dtheta|^2 + J (dphi/dtheta)^2,

with the kinematic coefficients of centres c and angles phi of its bodies (B. Paul, Kinematics and
Dynamics of Planar Machinery, 1979). Forces of closures follow from balances of moments
about joints, so that no other force occurs in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


def unit(angle: float) -> np.ndarray:
    """Return the unit vector (2,) at an angle."""
    return np.array([np.cos(angle), np.sin(angle)])


def cross(a: Any, b: Any) -> float:
    """Return the moment of b at the arm a."""
    return float(a[0] * b[1] - a[1] * b[0])


@dataclass(frozen=True)
class Coefficients:
    """A quantity with its first and second derivative by the angle of the crank."""

    value: Any
    first: Any
    second: Any

    def acceleration(self, rate: float, acceleration: float) -> Any:
        """Return its second derivative by time."""
        return self.first * acceleration + self.second * rate**2

    def along(self, angle: Coefficients, distance: float) -> Coefficients:
        """Return the point at a distance in the direction of a turning angle, from this point."""
        e = unit(angle.value)
        n = np.array([-e[1], e[0]])
        return Coefficients(
            self.value + distance * e,
            self.first + distance * n * angle.first,
            self.second + distance * (n * angle.second - e * angle.first**2),
        )


ORIGIN = Coefficients(np.zeros(2), np.zeros(2), np.zeros(2))


@dataclass(frozen=True)
class Body:
    """Mass (kg) and inertia about the centre (kg m^2), with the centre and the angle."""

    mass: float
    inertia: float
    centre: Coefficients
    angle: Coefficients

    def moment(self, about: Any, motion: tuple[float, float], gravity: Any) -> float:
        """Return the moment (N m) about a point that motion (rate, acceleration) and weight
        require."""
        inertial = self.mass * (self.centre.acceleration(*motion) - gravity)
        turning = self.inertia * self.angle.acceleration(*motion)
        return cross(self.centre.value - about, inertial) + float(turning)


def rod(root: Coefficients, angle: Coefficients, length: float, mass: float) -> Body:
    """Return a uniform rod."""
    return Body(mass, mass * length**2 / 12, root.along(angle, length / 2), angle)


def eksergian(bodies: Sequence[Body], rate: float, torque: float, gravity: Any) -> float:
    """Return the acceleration of the crank, rad/s^2, by the equation of the module."""
    inertia = sum(b.mass * b.centre.first @ b.centre.first for b in bodies)
    inertia += sum(b.inertia * b.angle.first**2 for b in bodies)
    half_slope = sum(b.mass * b.centre.first @ b.centre.second for b in bodies)
    half_slope += sum(b.inertia * b.angle.first * b.angle.second for b in bodies)
    weight = sum(b.mass * b.centre.first @ np.asarray(gravity) for b in bodies)
    return float((torque + weight - half_slope * rate**2) / inertia)


def kinetic_energy(bodies: Sequence[Body], rate: float) -> float:
    """Return the kinetic energy (J) at a rate of the crank."""
    moving = sum(b.mass * b.centre.first @ b.centre.first for b in bodies)
    turning = sum(b.inertia * b.angle.first**2 for b in bodies)
    return float(moving + turning) * rate**2 / 2


@dataclass(frozen=True)
class SliderCrank:
    """Crank about the origin, connecting rod, and a slider on the line y = eccentricity, right of
    the crank pin."""

    lengths: tuple[float, float]
    masses: tuple[float, float]
    slider: float
    eccentricity: float = 0.0
    gravity: tuple[float, float] = (0.0, 0.0)

    def angles(self, crank: float) -> tuple[Coefficients, Coefficients]:
        """Return the angles of crank and rod: a sin theta + b sin phi = eccentricity."""
        a, b = self.lengths
        phi = np.arcsin((self.eccentricity - a * np.sin(crank)) / b)
        first = -a * np.cos(crank) / (b * np.cos(phi))
        second = (a * np.sin(crank) + b * np.sin(phi) * first**2) / (b * np.cos(phi))
        return Coefficients(crank, 1.0, 0.0), Coefficients(phi, first, second)

    def bodies(self, crank: float) -> list[Body]:
        """Return crank, rod and slider."""
        theta, phi = self.angles(crank)
        pin = ORIGIN.along(theta, self.lengths[0])
        parts = zip((ORIGIN, pin), (theta, phi), self.lengths, self.masses, strict=True)
        return [*(rod(*part) for part in parts), Body(self.slider, 0.0, self.end(crank), phi)]

    def end(self, crank: float) -> Coefficients:
        """Return the position of the slider."""
        theta, phi = self.angles(crank)
        return ORIGIN.along(theta, self.lengths[0]).along(phi, self.lengths[1])

    def motion(self, crank: float, rate: float, torque: float) -> tuple[np.ndarray, float]:
        """Return accelerations (2,) of the angles of crank and rod, and the force (N) of the line
        on the slider, along y."""
        bodies = self.bodies(crank)
        acceleration = eksergian(bodies, rate, torque, self.gravity)
        pin = ORIGIN.along(self.angles(crank)[0], self.lengths[0]).value
        # Of rod and slider about the crank pin.
        moment = sum(b.moment(pin, (rate, acceleration), self.gravity) for b in bodies[1:])
        turning = [a.acceleration(rate, acceleration) for a in self.angles(crank)]
        return np.array(turning), float(moment / (self.end(crank).value - pin)[0])


@dataclass(frozen=True)
class FourBar:
    """Crank about the origin, coupler, and a rocker about (ground, 0), in the open branch.

    lengths, masses: of crank, coupler and rocker.
    """

    lengths: tuple[float, float, float]
    masses: tuple[float, float, float]
    ground: float
    gravity: tuple[float, float] = (0.0, 0.0)

    def angles(self, crank: float) -> list[Coefficients]:
        """Return the angles of crank, coupler and rocker.

        Freudenstein's equation by the tangents of half the angles (R. L. Norton, Design of
        Machinery).
        """
        (a, b, c), d = self.lengths, self.ground
        cosine, sine = np.cos(crank), np.sin(crank)
        k1, k2, k3 = d / a, d / c, (a**2 - b**2 + c**2 + d**2) / (2 * a * c)
        k4, k5 = d / b, (c**2 - d**2 - a**2 - b**2) / (2 * a * b)
        rocker = _half_tangent(
            cosine - k1 - k2 * cosine + k3, -2 * sine, k1 - (k2 + 1) * cosine + k3
        )
        coupler = _half_tangent(
            cosine - k1 + k4 * cosine + k5, -2 * sine, k1 + (k4 - 1) * cosine + k5
        )
        between = np.sin(coupler - rocker)
        coupler_first = a * np.sin(rocker - crank) / (b * between)
        rocker_first = -a * np.sin(crank - coupler) / (c * between)
        # The second derivative of a e(crank) + b e(coupler) = (d, 0) + c e(rocker).
        normals = [[-np.sin(x), np.cos(x)] for x in (coupler, rocker)]
        columns = np.array([b * np.array(normals[0]), -c * np.array(normals[1])]).T
        centripetal = a * unit(crank) + b * unit(coupler) * coupler_first**2
        second = np.linalg.solve(columns, centripetal - c * unit(rocker) * rocker_first**2)
        return [
            Coefficients(crank, 1.0, 0.0),
            Coefficients(coupler, coupler_first, second[0]),
            Coefficients(rocker, rocker_first, second[1]),
        ]

    def bodies(self, crank: float) -> list[Body]:
        """Return crank, coupler and rocker."""
        angles = self.angles(crank)
        pivot = Coefficients(np.array([self.ground, 0.0]), np.zeros(2), np.zeros(2))
        roots = [ORIGIN, ORIGIN.along(angles[0], self.lengths[0]), pivot]
        parts = zip(roots, angles, self.lengths, self.masses, strict=True)
        return [rod(*part) for part in parts]

    def motion(self, crank: float, rate: float, torque: float) -> tuple[np.ndarray, np.ndarray]:
        """Return accelerations (3,) of the angles of crank, coupler and rocker, and the force (2,)
        on the coupler from the rocker, N."""
        bodies, angles = self.bodies(crank), self.angles(crank)
        acceleration = eksergian(bodies, rate, torque, self.gravity)
        pin, pivot = self.lengths[0] * unit(crank), np.array([self.ground, 0.0])
        # Of the coupler about the crank pin, and of the rocker about its pivot.
        moments = [
            bodies[1].moment(pin, (rate, acceleration), self.gravity),
            -bodies[2].moment(pivot, (rate, acceleration), self.gravity),
        ]
        arms = [self.lengths[k] * unit(angles[k].value) for k in (1, 2)]
        force = np.linalg.solve([[-arm[1], arm[0]] for arm in arms], moments)
        return np.array([a.acceleration(rate, acceleration) for a in angles]), force


def _half_tangent(a: float, b: float, c: float) -> float:
    """Return the angle x of a t^2 + b t + c = 0 with t = tan(x / 2), the lower root."""
    return float(2 * np.arctan2(-b - np.sqrt(b * b - 4 * a * c), 2 * a))


def parallelogram_energy(loops: int, speed: float = 1.0, gravity: float = 9.81) -> float:
    """Return the energy (J) of N four-bars of rods of 1 m and 1 kg with upright cranks.

    speed: of the couplers, m/s; potential energy is zero at the height of the pivots. Benchmark
    of the library of the IFToMM Technical Committee for Multibody Dynamics (M. Gonzalez, D. Dopico,
    U. Lugris and J. Cuadrado, Multibody System Dynamics 16 (2006) 179).
    """
    cranks = (loops + 1) * (speed**2 / 6 + gravity / 2)
    return cranks + loops * (speed**2 / 2 + gravity)


@dataclass(frozen=True)
class CartPendulum:
    """A cart (kg) on a rail along x with a uniform rod on it; spring (N/m) and damper (N s/m) to
    the ground.

    With the angle theta of the rod from x, by Lagrange's equations (any textbook of mechanics):

        (M + m) x'' - m l/2 (sin theta theta'' + cos theta theta'^2) = force - k x - d x'
        m l^2/3 theta'' - m l/2 sin theta x'' = torque + m l/2 (gy cos theta - gx sin theta)

    and gravity (gx, gy) pulls the cart along x, too.
    """

    cart: float
    length: float
    mass: float
    stiffness: float = 0.0
    damping: float = 0.0
    gravity: tuple[float, float] = (0.0, 0.0)

    def acceleration(self, q: Any, qd: Any, force: float, torque: float) -> np.ndarray:
        """Return x'' and theta'', (2,); q, qd (2,): x and theta, and their rates."""
        (x, theta), (speed, rate) = q, qd
        c, s = np.cos(theta), np.sin(theta)
        moment, whole = self.mass * self.length / 2, self.cart + self.mass
        gx, gy = self.gravity
        matrix = [[whole, -moment * s], [-moment * s, self.mass * self.length**2 / 3]]
        pushed = force - self.stiffness * x - self.damping * speed + whole * gx
        turned = torque + moment * (gy * c - gx * s)
        return np.linalg.solve(matrix, [pushed + moment * c * rate**2, turned])


@dataclass(frozen=True)
class Flying:
    """A rigid body: mass (kg), inertia about its centre (kg m^2), centre (m), its velocity (m/s)
    and the rate (rad/s)."""

    mass: float
    inertia: float
    centre: Any
    velocity: Any
    rate: float

    @property
    def momentum(self) -> np.ndarray:
        """P_x, P_y (N s) and L about the origin (N m s), (3,)."""
        linear = self.mass * np.asarray(self.velocity, dtype=float)
        return np.append(linear, cross(self.centre, linear) + self.inertia * self.rate)


def caught(bodies: Sequence[Flying]) -> Flying:
    """Return the rigid body that bodies are after they stuck to each other.

    The impact conserves linear and angular momentum.
    """
    mass = sum(b.mass for b in bodies)
    centre = sum(b.mass * np.asarray(b.centre, dtype=float) for b in bodies) / mass
    apart = [np.subtract(b.centre, centre) for b in bodies]
    inertia = sum(b.inertia + b.mass * a @ a for b, a in zip(bodies, apart, strict=True))
    total = sum(b.momentum for b in bodies)
    spin = total[2] - cross(centre, total[:2])
    return Flying(mass, inertia, centre, total[:2] / mass, spin / inertia)


@dataclass(frozen=True)
class TwoBodies:
    """A free base, whose centre is its origin, with one rigid rod that turns about a point of the
    base at ``place`` (m, axes of the base).

    About the centre of mass of both, with the reduced mass mu = M m / (M + m) and the position d of
    the centre of the rod from that of the base, the angular momentum is J_b w_b + J w + mu d x d'
    (reduction of two bodies: Landau and Lifshitz, Mechanics, section 13; for robots on free bases
    Y. Umetani and K. Yoshida, IEEE Trans. Robotics and Automation 5 (1989) 303).
    """

    mass: float
    inertia: float
    place: tuple[float, float]
    length: float
    rod: float

    def spin(self, angles: Any, rates: Any) -> float:
        """Return the angular momentum (N m s) about the centre of mass; angles (2,): of the base,
        and of the rod relative to it."""
        base, turned = angles[0], angles[0] + angles[1]
        rate, turning = rates[0], rates[0] + rates[1]
        ahead, aside = unit(base), unit(base + np.pi / 2)
        hinge = self.place[0] * ahead + self.place[1] * aside
        half = self.length / 2 * unit(turned)
        d_rate = rate * np.array([-hinge[1], hinge[0]]) + turning * np.array([-half[1], half[0]])
        reduced = self.mass * self.rod / (self.mass + self.rod)
        own = self.inertia * rate + self.rod * self.length**2 / 12 * turning
        return float(own + reduced * cross(hinge + half, d_rate))

    def base_rate(self, angles: Any, joint_rate: float, spin: float) -> float:
        """Return the rate of the base (rad/s) at a rate of the joint and a conserved spin."""
        carried = self.spin(angles, (0.0, joint_rate))
        return (spin - carried) / (self.spin(angles, (1.0, 0.0)))
