"""Every public callable with valid arguments, and the names of all its arguments."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

import flexarm as fa
import flexarm.plot
from flexarm.model.checks import Record
from fuzz.base_calls import CONTROLLERS, FUNCTIONS, MADE_BY_FLEXARM, METHODS, RECORDS, arm
from fuzz.export_calls import EXPORTS
from fuzz.figure_calls import FIGURES
from fuzz.motion_calls import MOTIONS
from fuzz.study_calls import STUDIES, STUDY_METHODS

#: Classes whose methods are called during a run.
_CALLED_BY_A_RUN = ("Controller", "GeneralizedAlpha")
#: A callable and valid arguments by name.
Call = tuple[Callable[..., Any], dict[str, Any]]


def calls() -> dict[str, Callable[[], Call]]:
    """Return every call by name: a function that returns its callable, and one that returns its
    arguments."""
    found: dict[str, Callable[[], Call]] = {}
    functions = {**FUNCTIONS, **MOTIONS, **STUDIES, **EXPORTS}
    made: dict[str, Any] = {**RECORDS, **CONTROLLERS, **functions}
    for name, given in made.items():
        found[name] = lambda name=name, given=given: (getattr(fa, name), _values(given))
    for name, given in FIGURES.items():
        found[f"plot.{name}"] = lambda name=name, given=given: (
            getattr(fa.plot, name),
            _values(given),
        )
    for owner, (make, methods) in (METHODS | STUDY_METHODS).items():
        for method, given in methods.items():
            found[f"{owner}.{method}"] = lambda make=make, method=method, given=given: (
                getattr(make(), method),
                _values(given),
            )
    return found


def _values(given: dict[str, Any]) -> dict[str, Any]:
    """Evaluate the arguments that are written as functions without arguments."""
    return {name: value() if callable(value) else value for name, value in given.items()}


def parameters(name: str, function: Callable[..., Any]) -> list[str]:
    """Return the names of all arguments that a callable takes."""
    if isinstance(function, type) and issubclass(function, Record):
        return list(function.model_fields)
    taken = list(inspect.signature(function).parameters.values())
    names = [p.name for p in taken if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if name == "Arm":
        return [*names, *type(arm().spec).model_fields]
    return names


def public_names() -> Iterator[str]:
    """Yield the public names, those of figures, and public methods of public classes."""
    yield from (f"plot.{name}" for name in fa.plot.__all__)
    for name in fa.__all__:
        value = getattr(fa, name)
        if isinstance(value, type) and issubclass(value, Exception):  # errors and warnings
            continue
        if name not in MADE_BY_FLEXARM:
            yield name
        if isinstance(value, type) and not issubclass(value, Record | BaseException):
            for method, member in inspect.getmembers(value, callable):
                own = str(getattr(member, "__module__", "")).startswith("flexarm")
                if own and not method.startswith("_") and name not in _CALLED_BY_A_RUN:
                    yield f"{name}.{method}"
