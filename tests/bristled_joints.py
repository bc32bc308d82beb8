"""Joints with bristles, and the equations of the LuGre model in SciPy."""

import numpy as np
from scipy.integrate import solve_ivp

import flexarm as fa

#: A joint of 0.05 kg m^2 with a strong Stribeck effect.
INERTIA = 0.05
NUMBERS = {
    "coulomb": 0.5,
    "static": 0.8,
    "stribeck_rate": 0.05,
    "bristle_stiffness": 5000.0,
    "bristle_damping": 15.0,
}
#: Other levels of the two directions.
RUBBING = {**NUMBERS, "viscous": 0.1, "coulomb_negative": 0.7, "bristle_damping": 2.0}
#: The example of Canudas de Wit, Olsson, Astrom and Lischinsky (1995), table I.
PUBLISHED = {
    "coulomb": 1.0,
    "static": 1.5,
    "stribeck_rate": 1e-3,
    "viscous": 0.4,
    "bristle_stiffness": 1e5,
    "bristle_damping": 1e5**0.5,
}


def turning(inertia=INERTIA, numbers=NUMBERS, **joint):
    """A joint with an inertia and friction, and a rigid link without mass."""
    link = fa.Link(length=1.0, mass_per_length=1e-12, flexible=False)
    own = fa.Joint(hub_inertia=inertia, friction=fa.Friction(**numbers), **joint)
    return fa.Arm(links=[link], joints=[own])


def nothing(angle, rate):
    return 0.0


def lugre(torque, times, inertia=INERTIA, numbers=NUMBERS, push=nothing, start=(0.0, 0.0, 0.0)):
    """Return angle, rate and deflection of the bristles (3, times) from the published equations.

    ``push`` is the torque (N m) of a spring, stop or surface, a function of angle and rate.
    """
    n = {"viscous": 0.0, "static": numbers["coulomb"], **numbers}
    pull, damping = n["bristle_stiffness"], n["bristle_damping"]
    backward = n.get("coulomb_negative", n["coulomb"])

    def slope(t, y):
        angle, rate, z = y
        rise = (n["static"] - n["coulomb"]) * np.exp(-((rate / n["stribeck_rate"]) ** 2))
        level = (n["coulomb"] if rate > 0.0 else backward) + rise
        z_dot = rate - pull * abs(rate) * z / level
        friction = pull * z + damping * z_dot + n["viscous"] * rate
        return [rate, (torque(t) + push(angle, rate) - friction) / inertia, z_dot]

    limits = {"rtol": 1e-10, "atol": 1e-14, "method": "LSODA", "t_eval": times}
    return solve_ivp(slope, (times[0], times[-1]), start, **limits).y
