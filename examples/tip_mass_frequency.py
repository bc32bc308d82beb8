"""The frequency of a beam with a mass at its tip, compared with the exact solution.

A clamped beam with a mass m at its tip vibrates at w = b^2 sqrt(EI / (mu L^4)); b is the first
root of  1 + cos b cosh b = r b (sin b cosh b - cos b sinh b),  r = m / (mu L)
(Blevins, Formulas for Natural Frequency and Mode Shape, 1979, table 8-8). Here r is 0 to 5.

Prints: largest relative error: 6.6e-06
Usage: python tip_mass_frequency.py [figure.png]
"""

import sys

import numpy as np
from scipy.optimize import brentq

import flexarm as fa

length, rigidity, density = 1.0, 20.0, 0.5  # m, N m^2, kg/m
ratios = np.linspace(0.0, 5.0, 21)


def exact(ratio):
    def equation(b):
        sines = np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b)
        return 1.0 + np.cos(b) * np.cosh(b) - ratio * b * sines

    return brentq(equation, 0.5, 2.0) ** 2 * np.sqrt(rigidity / (density * length**4)) / (2 * np.pi)


def computed(ratio):
    beam = fa.Link(length=length, flexural_rigidity=rigidity, mass_per_length=density, elements=6)
    arm = fa.Arm(links=[beam], payload=fa.Payload(mass=ratio * density * length))
    return fa.modes(arm, joints="locked").frequency_hz[0]


ours, theirs = (np.array([f(ratio) for ratio in ratios]) for f in (computed, exact))
print(f"largest relative error: {np.max(np.abs(ours / theirs - 1.0)):.1e}")

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0, 3.0), dpi=200, layout="constrained")
    axes = figure.subplots()
    axes.plot(ratios, theirs, "k--", label="exact")
    axes.plot(ratios, ours, "o", markersize=3, label="six elements")
    axes.set(xlabel="tip mass / beam mass", ylabel="first frequency [Hz]")
    axes.legend()
    figure.savefig(sys.argv[1])
