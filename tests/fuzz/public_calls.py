"""Every public callable with valid arguments, and the names of all its arguments."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import flexarm as fa
import flexarm.view.plot
from flexarm.model.checks import Record
from fuzz.base_calls import CONTROLLERS, FUNCTIONS, MADE_BY_FLEXARM, METHODS, RECORDS, arm
from fuzz.export_calls import EXPORT_METHODS, EXPORTS
from fuzz.figure_calls import FIGURES
from fuzz.motion_calls import MOTIONS
from fuzz.study_calls import STUDIES, STUDY_METHODS

#: Classes whose methods are called during a run.
_CALLED_BY_A_RUN = ("Controller", "GeneralizedAlpha")
#: Classes of returned objects without methods for users (Matplotlib's, of figures), and methods
#: that have no arguments, or that the package calls with arrays that it has checked.
_INNER, _INNER_METHODS = {"Sheet"}, {"at", "path", "html", "pictures"}
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
    for name in made:
        if issubclass(_kind(name), Record):
            first = next(iter(made[name]), None)
            METHODS.setdefault(name, (partial(_record, name, made[name]), {}))[1].setdefault(
                "replace", {} if first is None else {first: made[name][first]}
            )
    for owner, (make, methods) in (METHODS | STUDY_METHODS | EXPORT_METHODS).items():
        for method, given in methods.items():
            found[f"{owner}.{method}"] = lambda make=make, method=method, given=given: (
                getattr(make(), method),
                _values(given),
            )
    return found


def _kind(name: str) -> type:
    """Return a public class, or the class of functions."""
    value = getattr(fa, name)
    return value if isinstance(value, type) else type(value)


def _record(name: str, given: dict[str, Any]) -> Any:
    return getattr(fa, name)(**_values(given))


def _values(given: dict[str, Any]) -> dict[str, Any]:
    """Evaluate the arguments that are written as functions without arguments."""
    return {name: value() if callable(value) else value for name, value in given.items()}


def parameters(name: str, function: Callable[..., Any]) -> list[str]:
    """Return the names of all arguments that a callable takes."""
    if isinstance(function, type) and issubclass(function, Record):
        return list(function.model_fields)
    taken = list(inspect.signature(function).parameters.values())
    names = [p.name for p in taken if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    if name.endswith(".replace"):
        return list(type(function.__self__).model_fields)
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
        if isinstance(value, type) and name not in _CALLED_BY_A_RUN:
            yield from (f"{name}.{method}" for method in methods_of(value))


#: Parts of ``update``, which checks its arguments. They are called in every sample of a loop.
_PARTS_OF_UPDATE = ("initial_memory", "planned", "step")


def methods_of(kind: type) -> list[str]:
    """Return the names of the public methods of a class that the package defines."""
    return [
        method
        for method, member in inspect.getmembers(kind, callable)
        if str(getattr(member, "__module__", "")).startswith("flexarm") and method[0] != "_"
        if not (issubclass(kind, fa.Controller) and method in _PARTS_OF_UPDATE)
    ]


def methods_without_a_call(name: str, value: Any) -> list[str]:
    """Return the methods of a returned object that no base call covers, of whatever class."""
    kind = type(value)
    if not kind.__module__.startswith("flexarm") or issubclass(kind, Record):
        return []
    if getattr(fa, kind.__name__, None) is kind or kind.__name__ in _INNER:
        return []
    return sorted({*methods_of(kind)} - _covered().get(kind, set()) - _INNER_METHODS)


@cache
def _covered() -> dict[type, set[str]]:
    """Return the methods with a base call of all classes of returned objects."""
    of_returned = [*METHODS.values(), *EXPORT_METHODS.values()]
    return {type(make()): set(methods) for make, methods in of_returned}
