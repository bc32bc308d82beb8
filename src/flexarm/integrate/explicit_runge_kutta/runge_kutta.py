"""Explicit Runge-Kutta integrators, defined by a tableau for the compiled stepper."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.explicit_runge_kutta.explicit import ExplicitRecord, advance_explicit
from flexarm.integrate.tableau import Tableau
from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import ArmConstants


@dataclass(frozen=True)
class ExplicitRungeKutta(Integrator):
    """Base class of the explicit methods."""

    stepper = staticmethod(advance_explicit)
    follows_sticking = True
    follows_closures = True

    @property
    @abstractmethod
    def tableau(self) -> Tableau:
        """Coefficients of the method."""

    def record(self, constants: ArmConstants, state: FloatArray) -> ExplicitRecord:
        """See ``Integrator.record``."""
        tableau = self.tableau
        rows = len(tableau.c)
        return ExplicitRecord(
            A=tableau.A,
            c=tableau.c,
            error=tableau.error,
            dense=tableau.dense,
            order=tableau.order,
            adaptive=self.adaptive,
            stages=zeros_like(state, rows, *state.shape),
            weights=np.zeros((1, rows)),
        )
