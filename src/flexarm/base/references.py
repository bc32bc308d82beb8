"""BibTeX references of the methods that a result used."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING, ClassVar, Protocol

from flexarm.base.errors import InputError, Problem, public_call, shown

if TYPE_CHECKING:
    import xarray as xr

_ENTRIES = {
    "flexarm": """@software{flexarm,
  title = {flexarm: planar manipulators with flexible links},
  author = {{The flexarm developers}},
  version = {%s}
}""",
    "CraigBampton1968": """@article{CraigBampton1968,
  author = {Craig, R. R. and Bampton, M. C. C.},
  title = {Coupling of substructures for dynamic analyses},
  journal = {AIAA Journal}, volume = {6}, number = {7}, pages = {1313--1319}, year = {1968}
}""",
    "KaneRyanBanerjee1987": """@article{KaneRyanBanerjee1987,
  author = {Kane, T. R. and Ryan, R. R. and Banerjee, A. K.},
  title = {Dynamics of a cantilever beam attached to a moving base},
  journal = {Journal of Guidance, Control, and Dynamics},
  volume = {10}, number = {2}, pages = {139--151}, year = {1987}
}""",
    "HuntCrossley1975": """@article{HuntCrossley1975,
  author = {Hunt, K. H. and Crossley, F. R. E.},
  title = {Coefficient of restitution interpreted as damping in vibroimpact},
  journal = {Journal of Applied Mechanics}, volume = {42}, number = {2}, pages = {440--445},
  year = {1975}
}""",
    "SquireTrapp1998": """@article{SquireTrapp1998,
  author = {Squire, W. and Trapp, G.},
  title = {Using complex variables to estimate derivatives of real functions},
  journal = {SIAM Review}, volume = {40}, number = {1}, pages = {110--112}, year = {1998}
}""",
    "AllemangBrown1982": """@inproceedings{AllemangBrown1982,
  author = {Allemang, R. J. and Brown, D. L.},
  title = {A correlation coefficient for modal vector analysis},
  booktitle = {Proceedings of the 1st International Modal Analysis Conference},
  pages = {110--116}, year = {1982}
}""",
    "BrysonHo1975": """@book{BrysonHo1975,
  author = {Bryson, A. E. and Ho, Y.-C.},
  title = {Applied Optimal Control},
  publisher = {Hemisphere}, address = {Washington}, year = {1975}
}""",
    "GohCaughey1985": """@article{GohCaughey1985,
  author = {Goh, C. J. and Caughey, T. K.},
  title = {On the stability problem caused by finite actuator dynamics in the collocated control
    of large space structures},
  journal = {International Journal of Control},
  volume = {41}, number = {3}, pages = {787--802}, year = {1985}
}""",
    "FansonCaughey1990": """@article{FansonCaughey1990,
  author = {Fanson, J. L. and Caughey, T. K.},
  title = {Positive position feedback control for large space structures},
  journal = {AIAA Journal}, volume = {28}, number = {4}, pages = {717--724}, year = {1990}
}""",
    "AphaleEtAl2007": """@article{AphaleEtAl2007,
  author = {Aphale, S. S. and Fleming, A. J. and Moheimani, S. O. R.},
  title = {Integral resonant control of collocated smart structures},
  journal = {Smart Materials and Structures},
  volume = {16}, number = {2}, pages = {439--446}, year = {2007}
}""",
    "PereiraEtAl2011": """@article{PereiraEtAl2011,
  author = {Pereira, E. and Aphale, S. S. and Feliu, V. and Moheimani, S. O. R.},
  title = {Integral resonant control for vibration damping and precise tip-positioning of a
    single-link flexible manipulator},
  journal = {IEEE/ASME Transactions on Mechatronics},
  volume = {16}, number = {2}, pages = {232--240}, year = {2011}
}""",
    "NamavarEtAl2014": """@article{NamavarEtAl2014,
  author = {Namavar, M. and Fleming, A. J. and Aleyaasin, M. and Nakkeeran, K. and Aphale, S. S.},
  title = {An analytical approach to integral resonant control of second-order systems},
  journal = {IEEE/ASME Transactions on Mechatronics},
  volume = {19}, number = {2}, pages = {651--659}, year = {2014}
}""",
    "OConnor2007": """@article{OConnor2007,
  author = {O'Connor, W. J.},
  title = {Wave-based analysis and control of lump-modeled flexible robots},
  journal = {IEEE Transactions on Robotics},
  volume = {23}, number = {2}, pages = {342--352}, year = {2007}
}""",
    "WangVidyasagar1992": """@article{WangVidyasagar1992,
  author = {Wang, D. and Vidyasagar, M.},
  title = {Passive control of a stiff flexible link},
  journal = {The International Journal of Robotics Research},
  volume = {11}, number = {6}, pages = {572--578}, year = {1992}
}""",
    "MadhavanSingh1991": """@article{MadhavanSingh1991,
  author = {Madhavan, S. K. and Singh, S. N.},
  title = {Inverse trajectory control and zero dynamics sensitivity of an elastic manipulator},
  journal = {International Journal of Robotics and Automation},
  volume = {6}, number = {4}, pages = {179--192}, year = {1991}
}""",
    "Damaren1995": """@article{Damaren1995,
  author = {Damaren, C. J.},
  title = {Passivity analysis for flexible multilink space manipulators},
  journal = {Journal of Guidance, Control, and Dynamics},
  volume = {18}, number = {2}, pages = {272--279}, year = {1995}
}""",
    "BechlioulisRovithakis2008": """@article{BechlioulisRovithakis2008,
  author = {Bechlioulis, C. P. and Rovithakis, G. A.},
  title = {Robust adaptive control of feedback linearizable {MIMO} nonlinear systems with
    prescribed performance},
  journal = {IEEE Transactions on Automatic Control},
  volume = {53}, number = {9}, pages = {2090--2099}, year = {2008}
}""",
    "BechlioulisRovithakis2014": """@article{BechlioulisRovithakis2014,
  author = {Bechlioulis, C. P. and Rovithakis, G. A.},
  title = {A low-complexity global approximation-free control scheme with prescribed performance
    for unknown pure feedback systems},
  journal = {Automatica},
  volume = {50}, number = {4}, pages = {1217--1226}, year = {2014}
}""",
    "DoyleStein1981": """@article{DoyleStein1981,
  author = {Doyle, J. C. and Stein, G.},
  title = {Multivariable feedback design: concepts for a classical/modern synthesis},
  journal = {IEEE Transactions on Automatic Control},
  volume = {26}, number = {1}, pages = {4--16}, year = {1981}
}""",
    "Maciejowski1985": """@article{Maciejowski1985,
  author = {Maciejowski, J. M.},
  title = {Asymptotic recovery for discrete-time systems},
  journal = {IEEE Transactions on Automatic Control},
  volume = {30}, number = {6}, pages = {602--605}, year = {1985}
}""",
    "TahkSpeyer1987": """@article{TahkSpeyer1987,
  author = {Tahk, M. and Speyer, J. L.},
  title = {Modeling of parameter variations and asymptotic LQG synthesis},
  journal = {IEEE Transactions on Automatic Control},
  volume = {32}, number = {9}, pages = {793--801}, year = {1987}
}""",
    "McFarlaneGlover1992": """@article{McFarlaneGlover1992,
  author = {McFarlane, D. C. and Glover, K.},
  title = {A loop shaping design procedure using {H-infinity} synthesis},
  journal = {IEEE Transactions on Automatic Control},
  volume = {37}, number = {6}, pages = {759--769}, year = {1992}
}""",
    "SkogestadPostlethwaite2005": """@book{SkogestadPostlethwaite2005,
  author = {Skogestad, S. and Postlethwaite, I.},
  title = {Multivariable Feedback Control: Analysis and Design},
  edition = {second}, publisher = {Wiley}, year = {2005}
}""",
    "HydeGlover1993": """@article{HydeGlover1993,
  author = {Hyde, R. A. and Glover, K.},
  title = {The application of scheduled {H-infinity} controllers to a {VSTOL} aircraft},
  journal = {IEEE Transactions on Automatic Control},
  volume = {38}, number = {7}, pages = {1021--1039}, year = {1993}
}""",
    "CollinsKingBernstein1992": """@article{CollinsKingBernstein1992,
  author = {Collins, E. G. and King, J. A. and Bernstein, D. S.},
  title = {Application of maximum entropy/optimal projection design synthesis to a benchmark
           problem},
  journal = {Journal of Guidance, Control, and Dynamics},
  volume = {15}, number = {5}, pages = {1094--1102}, year = {1992}
}""",
    "RoyWhitcomb2002": """@article{RoyWhitcomb2002,
  author = {Roy, J. and Whitcomb, L. L.},
  title = {Adaptive force control of position/velocity controlled robots: theory and experiment},
  journal = {IEEE Transactions on Robotics and Automation}, volume = {18}, number = {2},
  year = {2002}
}""",
    "RahimiRecht2007": """@inproceedings{RahimiRecht2007,
  author = {Rahimi, A. and Recht, B.},
  title = {Random features for large-scale kernel machines},
  booktitle = {Advances in Neural Information Processing Systems}, volume = {20}, year = {2007}
}""",
    "SicilianoBook1988": """@article{SicilianoBook1988,
  author = {Siciliano, B. and Book, W. J.},
  title = {A singular perturbation approach to control of lightweight flexible manipulators},
  journal = {The International Journal of Robotics Research},
  volume = {7}, number = {4}, pages = {79--90}, year = {1988}
}""",
    "LawsonHanson1974": """@book{LawsonHanson1974,
  author = {Lawson, C. L. and Hanson, R. J.},
  title = {Solving Least Squares Problems},
  publisher = {Prentice-Hall}, address = {Englewood Cliffs}, year = {1974}
}""",
    "DiehlBockSchloeder2005": """@article{DiehlBockSchloeder2005,
  author = {Diehl, M. and Bock, H. G. and Schl\\"oder, J. P.},
  title = {A real-time iteration scheme for nonlinear optimization in optimal feedback control},
  journal = {SIAM Journal on Control and Optimization},
  volume = {43}, number = {5}, pages = {1714--1736}, year = {2005}
}""",
    "Kutta1901": """@article{Kutta1901,
  author = {Kutta, W.},
  title = {Beitrag zur n\\"aherungsweisen Integration totaler Differentialgleichungen},
  journal = {Zeitschrift f\\"ur Mathematik und Physik},
  volume = {46}, pages = {435--453}, year = {1901}
}""",
    "DormandPrince1980": """@article{DormandPrince1980,
  author = {Dormand, J. R. and Prince, P. J.},
  title = {A family of embedded {Runge-Kutta} formulae},
  journal = {Journal of Computational and Applied Mathematics},
  volume = {6}, number = {1}, pages = {19--26}, year = {1980}
}""",
    "PrinceDormand1981": """@article{PrinceDormand1981,
  author = {Prince, P. J. and Dormand, J. R.},
  title = {High order embedded {Runge-Kutta} formulae},
  journal = {Journal of Computational and Applied Mathematics},
  volume = {7}, number = {1}, pages = {67--75}, year = {1981}
}""",
    "KennedyCarpenter2003": """@article{KennedyCarpenter2003,
  author = {Kennedy, C. A. and Carpenter, M. H.},
  title = {Additive {Runge-Kutta} schemes for convection-diffusion-reaction equations},
  journal = {Applied Numerical Mathematics},
  volume = {44}, number = {1--2}, pages = {139--181}, year = {2003}
}""",
    "BoscarinoFilbetRusso2016": """@article{BoscarinoFilbetRusso2016,
  author = {Boscarino, S. and Filbet, F. and Russo, G.},
  title = {High order semi-implicit schemes for time dependent partial differential equations},
  journal = {Journal of Scientific Computing},
  volume = {68}, number = {3}, pages = {975--1001}, year = {2016}
}""",
    "ChungHulbert1993": """@article{ChungHulbert1993,
  author = {Chung, J. and Hulbert, G. M.},
  title = {A time integration algorithm for structural dynamics with improved numerical dissipation:
    the generalized-$\\alpha$ method},
  journal = {Journal of Applied Mechanics},
  volume = {60}, number = {2}, pages = {371--375}, year = {1993}
}""",
    "ArnoldBruels2007": """@article{ArnoldBruels2007,
  author = {Arnold, M. and Br{\\"u}ls, O.},
  title = {Convergence of the generalized-$\\alpha$ scheme for constrained mechanical systems},
  journal = {Multibody System Dynamics},
  volume = {18}, number = {2}, pages = {185--202}, year = {2007}
}""",
    "HairerLubichWanner2006": """@book{HairerLubichWanner2006,
  author = {Hairer, E. and Lubich, C. and Wanner, G.},
  title = {Geometric Numerical Integration: Structure-Preserving Algorithms for Ordinary
    Differential Equations},
  edition = {2}, publisher = {Springer}, year = {2006}
}""",
    "HouwenSwart1997": """@article{HouwenSwart1997,
  author = {van der Houwen, P. J. and de Swart, J. J. B.},
  title = {Triangularly implicit iteration methods for {ODE-IVP} solvers},
  journal = {SIAM Journal on Scientific Computing},
  volume = {18}, number = {1}, pages = {41--55}, year = {1997}
}""",
    "Betts2010": """@book{Betts2010,
  author = {Betts, J. T.},
  title = {Practical Methods for Optimal Control and Estimation Using Nonlinear Programming},
  edition = {2}, publisher = {SIAM}, year = {2010}
}""",
    "WaechterBiegler2006": """@article{WaechterBiegler2006,
  author = {W{\\"a}chter, A. and Biegler, L. T.},
  title = {On the implementation of an interior-point filter line-search algorithm for large-scale
    nonlinear programming},
  journal = {Mathematical Programming},
  volume = {106}, number = {1}, pages = {25--57}, year = {2006}
}""",
    "AnderssonEtAl2019": """@article{AnderssonEtAl2019,
  author = {Andersson, J. A. E. and Gillis, J. and Horn, G. and Rawlings, J. B. and Diehl, M.},
  title = {{CasADi}: a software framework for nonlinear optimization and optimal control},
  journal = {Mathematical Programming Computation},
  volume = {11}, number = {1}, pages = {1--36}, year = {2019}
}""",
    "HairerNorsettWanner1993": """@book{HairerNorsettWanner1993,
  author = {Hairer, E. and N{\\o}rsett, S. P. and Wanner, G.},
  title = {Solving Ordinary Differential Equations {I}: Nonstiff Problems},
  edition = {2}, publisher = {Springer}, year = {1993}
}""",
    "HairerWanner1996": """@book{HairerWanner1996,
  author = {Hairer, E. and Wanner, G.},
  title = {Solving Ordinary Differential Equations {II}: Stiff and Differential-Algebraic Problems},
  edition = {2}, publisher = {Springer}, year = {1996}
}""",
}


class Cited(Protocol):
    """Object with the BibTeX keys of its methods, separated by spaces."""

    references: ClassVar[str]


@public_call
def citation(result: xr.Dataset | Cited) -> str:
    """Return BibTeX entries of the package and of the methods of a result.

    Args:
        result: dataset of ``simulate``, a linear model, or tracked modes.

    Raises:
        InputError: if ``result`` is none of these.
    """
    attributes = getattr(result, "attrs", None)
    if isinstance(attributes, dict):
        used, made_by = attributes.get("references", ""), attributes.get("flexarm_version", "")
    elif isinstance(getattr(result, "references", None), str):
        used, made_by = getattr(result, "references", ""), version("flexarm")
    else:
        raise InputError(Problem("result", "be a result of simulate", shown(result)))
    keys = ["flexarm", *str(used).split()]
    entries = dict(_ENTRIES)
    entries["flexarm"] = _ENTRIES["flexarm"] % made_by
    unknown = [key for key in keys if key not in entries]
    if unknown:
        raise InputError(Problem("result", f"cites unknown methods: {shown(unknown)}"))
    return "\n\n".join(entries[key] for key in keys)
