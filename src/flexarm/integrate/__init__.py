"""Time stepping: one method a file, and the registry of their names."""

from __future__ import annotations

from flexarm.integrate.base import Integrator
from flexarm.integrate.dormand_prince import DormandPrince5, DormandPrince8
from flexarm.integrate.rk4 import RungeKutta4

#: Every integrator by the name that ``simulate`` and scenario files use.
INTEGRATORS: dict[str, type[Integrator]] = {
    RungeKutta4.name: RungeKutta4,
    DormandPrince5.name: DormandPrince5,
    DormandPrince8.name: DormandPrince8,
}

__all__ = ["INTEGRATORS", "DormandPrince5", "DormandPrince8", "Integrator", "RungeKutta4"]
