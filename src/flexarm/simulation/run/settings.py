"""Settings of a run, declared and checked once for all functions that simulate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from inspect import Parameter, signature
from typing import Any, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.stations import check_stations
from flexarm.base.arguments import (
    check_choice,
    check_flag,
    check_kind,
    check_positive,
    check_tolerance,
)
from flexarm.base.errors import (
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    unknown_arguments,
)
from flexarm.integrate import INTEGRATORS, Integrator
from flexarm.simulation.histories.piecewise import INTERPOLATIONS
from flexarm.simulation.run.integrator_choice import check_integrator
from flexarm.simulation.run.tolerance import (
    RTOL,
    absolute_tolerance,
    default_request,
    reach_of,
    tolerance_of_request,
)

#: Settings that decide instead of an accuracy.
_TOLERANCES = ("rtol", "atol", "step")

F = TypeVar("F", bound=Callable[..., Any])


class MethodSettings(TypedDict, total=False):
    """Method and tolerances of a run, as keyword arguments."""

    integrator: str | Integrator
    step: float | None
    rtol: float | None
    atol: float | None


class StepSettings(MethodSettings, total=False):
    """Settings of the steps of a run."""

    breaks: ArrayLike


class PlantSettings(StepSettings, total=False):
    """Settings of the steps of a plant."""

    accuracy: float | None


class SampleSettings(StepSettings, total=False):
    """Settings of a run with samples."""

    rate: float
    torque_interpolation: str
    progress: bool | None


class AllSettings(SampleSettings, total=False):
    """All settings of a run."""

    accuracy: float | None
    stations: int
    specialized: bool | None


@dataclass(frozen=True, kw_only=True, eq=False)
class RunSettings:
    """How runs are integrated and recorded, for all functions that simulate.

    ``simulate``, ``simulate_batch``, ``compare``, ``sensitivities``, ``goal_gradient``,
    ``tip_inversion``, ``identify`` and ``Plant`` accept them as ``settings=``. An argument of the
    same name replaces a default value here, and must not contradict another value. A function
    ignores settings that it does not have, such as the rate of samples in a ``Plant``.

    Args:
        integrator: "auto", a name of ``flexarm.integrate.INTEGRATORS``, or an integrator object.
        rate: samples recorded per second, Hz; by default 1000, and a round number of more or fewer
            for a run that would have less than 100 samples or more than a million.
        stations: sections of each link at which section forces are recorded; 0 for none.
        step: fixed step, or first step of a method with step control, s; None for the default.
        accuracy: largest error of the tip (m) that the integration may cause; the method and its
            tolerances follow from it. None for 1e-5 of the reach in functions that have an
            accuracy, unless integrator, step or tolerances are given.
        rtol, atol: error allowed per step, relative, and absolute in metres at the tip, by default
            1e-7 where no accuracy applies, and ``rtol / 100`` of the reach.
        torque_interpolation: of torque samples, "cubic", "linear" or "hold".
        breaks: times (s) at which a function of time jumps or has a kink.
        specialized: True compiles the hot loop for the sizes of the arm, with Numba; None does so
            in the middle of a long run, if Numba is installed.
        progress: True or False shows or hides the progress bar; None shows it on a terminal.

    Raises:
        InputError: if a setting has the wrong type or value.
    """

    integrator: str | Integrator = "auto"
    rate: float | None = None
    stations: int = 0
    step: float | None = None
    accuracy: float | None = None
    rtol: float | None = None
    atol: float | None = None
    torque_interpolation: str = "cubic"
    breaks: ArrayLike = ()
    specialized: bool | None = None
    progress: bool | None = None

    @public_call
    def __post_init__(self) -> None:
        self._check()

    def _check(self) -> None:
        """Validate and convert the settings, except for those that depend on a run."""
        own = vars(self)
        check_integrator(self.integrator, self.step)
        for name in ("specialized", "progress"):
            if own[name] is not None:
                check_flag(name, own[name])
        own["breaks"] = check_array("breaks", self.breaks, (-1,))
        check_choice("torque_interpolation", self.torque_interpolation, INTERPOLATIONS)
        if self.rtol is not None:
            own["rtol"] = check_tolerance("rtol", self.rtol)
        for name in ("rate", "accuracy", "atol"):
            if own[name] is not None:
                own[name] = check_positive(name, own[name])
        if self.accuracy is not None:
            for name in (name for name in _TOLERANCES if own[name] is not None):
                raise InputError(Problem("accuracy", f"cannot be combined with {name}"))
            method = self.integrator
            kind = INTEGRATORS.get(method) if isinstance(method, str) else method
            if kind is not None and not kind.adaptive:
                rule = f"is not supported with the integrator {kind.name!r}, which has no step "
                raise InputError(Problem("accuracy", f"{rule}control"))
        own["stations"] = check_stations(self.stations)


def replaced(settings: RunSettings, **changed: Any) -> RunSettings:
    """Return settings with other values, which are checked as arguments of the present call."""
    own = object.__new__(RunSettings)
    vars(own).update(vars(settings) | changed)
    own._check()
    return own


def request_of(settings: RunSettings, arm: Arm) -> float | None:
    """Return the accepted error over the reach of an arm; None if tolerances decide."""
    if settings.accuracy is not None:
        return settings.accuracy / reach_of(arm)
    stated = any(getattr(settings, name) is not None for name in _TOLERANCES)
    return None if stated or settings.integrator != "auto" else default_request(arm)


def relative_of(settings: RunSettings) -> float:
    """Return the relative tolerance of runs without an accuracy."""
    return RTOL if settings.rtol is None else settings.rtol


def close(settings: RunSettings | None) -> RunSettings:
    """Return settings in which tolerances decide, by default those of derivatives."""
    settings = DEFAULTS if settings is None else check_kind("settings", settings, RunSettings)
    if settings.accuracy is not None:
        return settings
    return replaced(settings, rtol=relative_of(settings))


def relative_tolerance(settings: RunSettings, arm: Arm) -> float:
    """Return the relative tolerance of steps and functions of time."""
    request = request_of(settings, arm)
    return relative_of(settings) if request is None else tolerance_of_request(request)


def tolerances_of(settings: RunSettings, arm: Arm) -> tuple[float, float, float]:
    """Return the relative and the absolute tolerance of a run, and the length of the latter."""
    relative = relative_tolerance(settings, arm)
    return (relative, *absolute_tolerance(arm, settings.atol, relative))


#: Default values of the settings.
DEFAULTS = RunSettings()


def with_keywords(kind: type[MethodSettings], *declared: type[Any]) -> Callable[[F], F]:
    """Show keyword arguments of a ``kind`` in the signature of a function, with their defaults."""

    def decorated(function: F) -> F:
        explicit = signature(function)
        own = [p for p in explicit.parameters.values() if p.kind is not Parameter.VAR_KEYWORD]
        own_defaults = {} if "accuracy" in kind.__annotations__ else {"rtol": RTOL}
        for field in (field for record in (*declared, RunSettings) for field in fields(record)):
            if field.name in kind.__annotations__:
                default = own_defaults.get(field.name, field.default)
                own.append(Parameter(field.name, Parameter.KEYWORD_ONLY, default=default))
        vars(function)["__signature__"] = explicit.replace(parameters=own)
        vars(function)["keywords"] = kind.__annotations__.keys()
        return function

    return decorated


def settings_of(
    settings: RunSettings | None, keywords: Mapping[str, Any], function: Callable[..., Any]
) -> RunSettings:
    """Return the settings of a call from its argument ``settings`` and its keyword arguments.

    Settings that the function does not have are the default ones. Tolerances decide in a function
    without ``accuracy``, such as one that computes derivatives.
    """
    names = vars(function)["keywords"] & vars(DEFAULTS).keys()
    if not keywords.keys() <= names:
        raise unknown_arguments(keywords, signature(function).parameters)
    if settings is None:
        settings = replaced(DEFAULTS, **keywords) if keywords else DEFAULTS
        return settings if "accuracy" in names else close(settings)
    given = check_kind("settings", settings, RunSettings)
    both = replaced(given, **keywords)
    problems = [
        Problem(name, f"be {shown(getattr(given, name))} as in settings", shown(value))
        for name, value in keywords.items()
        if not _same(name, given, both) and not _same(name, given, DEFAULTS)
    ]
    if problems:
        raise InputError(*problems)
    applied = replaced(DEFAULTS, **{name: getattr(both, name) for name in names})
    return applied if "accuracy" in names else close(applied)


def _same(name: str, one: RunSettings, other: RunSettings) -> bool:
    return np.array_equal(getattr(one, name), getattr(other, name))
