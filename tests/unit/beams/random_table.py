"""A random table of a link, and integrals along it by adaptive quadrature."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad_vec

#: Length of the link, m.
L = 1.3
#: The adaptive integrals have a tenth of this tolerance.
INTEGRATION = 1e-9


class RandomTable:
    """Stations, masses and rotary inertias.

    Derived classes set ``link``, ``shapes``, ``slopes`` and ``kinks``.
    """

    def __init__(self, seed, least_rotary):
        self.rng = np.random.default_rng(seed)
        self.x = np.array([0.0, *np.sort(self.rng.uniform(0.1, 1.2, 2)), L])
        self.stiffness = self.rng.uniform(0.5, 3.0, 4)
        self.mass = self.rng.uniform(0.2, 2.0, 4)
        self.rotary = self.rng.uniform(least_rotary, 0.05, 4)

    def integral(self, function, end=L):
        points = self.kinks[(self.kinks > 0.0) & (self.kinks < end)]
        return quad_vec(function, 0.0, end, epsabs=1e-11, epsrel=1e-10, points=points)[0]

    def mu(self, x):
        return np.interp(x, self.x, self.mass)

    def rho_i(self, x):
        return np.interp(x, self.x, self.rotary)

    def assert_momentum(self, rotation):
        """Compare S and a of the link with integrals over shapes with a rotation of sections."""
        close = {"rtol": INTEGRATION, "atol": INTEGRATION}
        linear = self.integral(lambda x: self.mu(x) * self.shapes(x))
        np.testing.assert_allclose(self.link.S, linear, **close)
        angular = self.integral(
            lambda x: self.mu(x) * x * self.shapes(x) + self.rho_i(x) * rotation(x)
        )
        np.testing.assert_allclose(self.link.a, angular, **close)

    def square(self, x):
        return np.outer(self.slopes(x), self.slopes(x))

    def shortening(self, x):
        """Return g(x) by its definition: the integral from the root."""
        return self.integral(self.square, x) if x > 0.0 else 0.0 * self.square(0.0)
