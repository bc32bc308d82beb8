"""Integrators, one method per file, and the registry of their names."""

from __future__ import annotations

from flexarm.integrate.base import Integrator
from flexarm.integrate.explicit_runge_kutta.dormand_prince import DormandPrince8
from flexarm.integrate.explicit_runge_kutta.rk4 import RungeKutta4
from flexarm.integrate.implicit.gauss import Gauss6
from flexarm.integrate.implicit.generalized_alpha import GeneralizedAlpha
from flexarm.integrate.implicit.kennedy_carpenter import KennedyCarpenter5
from flexarm.integrate.multistep.stoermer_cowell import Cowell4

#: Every integrator by the name that ``simulate`` and scenario files use.
INTEGRATORS: dict[str, type[Integrator]] = {
    RungeKutta4.name: RungeKutta4,
    DormandPrince8.name: DormandPrince8,
    KennedyCarpenter5.name: KennedyCarpenter5,
    Cowell4.name: Cowell4,
    Gauss6.name: Gauss6,
    GeneralizedAlpha.name: GeneralizedAlpha,
}

#: Methods of earlier versions, and their replacements; decision 0017.
REMOVED = {
    "dormand_prince_5": DormandPrince8.name,
    "kennedy_carpenter_4": KennedyCarpenter5.name,
}

__all__ = [
    "INTEGRATORS",
    "REMOVED",
    "Cowell4",
    "DormandPrince8",
    "Gauss6",
    "GeneralizedAlpha",
    "Integrator",
    "KennedyCarpenter5",
    "RungeKutta4",
]
