"""Units of the fields of records, and numbers that are given with a unit: ``667 mm``.

A field declares its unit once, in parentheses in its docstring. The reference, the studio and the
conversion of numbers with units read it there. Pint converts; it is imported when the first number
with a unit occurs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, get_args

from flexarm.model.wording import Fault, Path

_IN_BRACKETS = re.compile(r"\(((?:[^()]|\([^()]*\))*)\)")
_WORDS = {"m", "s", "kg", "N", "Hz", "rad", "Pa", "J", "A", "V", "ohm", "1", "per"}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
#: A number and its unit. Exponents have one digit, so that no power of numbers is computed.
_QUANTITY = re.compile(
    rf"\s*+((?>{_NUMBER}))\s*+"
    r"((?:(?:[^\W\d_]|°)++(?:(?:\^|\*\*)?-?\d(?:\.\d)?|[²³])?|1(?=/)|[ ·*/()])+)"
)
#: An exponent without its sign: mm2.
_BARE_POWER = re.compile(r"(?<=[^\W\d_])(?=-?\d)")
_LISTS, _MAY_HAVE_UNITS = (list, tuple), (str, list, tuple, dict)
_LONGEST = 60  # characters of a quantity
#: The form of a quantity in JSON schemas.
QUANTITY_PATTERN = rf"^\s*{_NUMBER}\s*[A-Za-zµμΩ°(1].*$"

#: Kinds of quantities that have a name of their own, by unit.
_KINDS = {
    "m": "a length",
    "s": "a time",
    "kg": "a mass",
    "rad": "an angle",
    "rad/s": "an angular rate",
    "Hz": "a frequency",
    "Pa": "a modulus",
    "kg/m^3": "a density",
    "N": "a force",
    "N m": "a torque",
    "m/s": "a velocity",
    "m/s^2": "an acceleration",
    "V": "a voltage",
    "ohm": "a resistance",
}


def unit_of(description: str) -> str:
    """Return the first unit in a description, such as N m^2; empty if it has none.

    A list whose entries have different units has one for each: N/m; N m/rad.
    """
    for text in _IN_BRACKETS.findall(description):
        words = re.sub(r"\^-?\d(\.\d)?|[/();]", " ", text).split()
        if words and set(words) <= _WORDS and words != ["1"]:
            return str(text)
    return ""


def maps_names(annotation: Any) -> bool:
    """Return whether values of a type are mappings from names, or may be."""
    name = getattr(annotation, "__origin__", None)
    return name is dict or any(map(maps_names, get_args(annotation)))


def in_si(
    data: Mapping[str, Any], unit_of_field: Callable[[str], tuple[str, bool]]
) -> tuple[Mapping[str, Any], dict[Path, Fault]]:
    """Return the raw input of a record with plain numbers, and the faults of units by their paths.

    ``unit_of_field`` returns the unit of a field, empty if it has none, and whether its value maps
    names to numbers. Text with a fault is unchanged.
    """
    faults: dict[Path, Fault] = {}
    changed = {}
    for name, value in data.items():
        if type(value) not in _MAY_HAVE_UNITS or not _has_quantity(value):
            continue
        unit, maps = unit_of_field(name)
        converted = _converted(value, unit, maps, (name,), faults) if unit else value
        if converted is not value:
            changed[name] = converted
    return ({**data, **changed} if changed else data), faults


def unit_of_entry(unit: str, index: int) -> str:
    """Return the unit of an entry of a list with the unit of `unit_of`."""
    units = unit.split("; ")
    return units[index] if index < len(units) > 1 else unit


def _has_quantity(value: Any) -> bool:
    """Return whether a value is a number with a unit, or a list or mapping that contains one."""
    if isinstance(value, str):
        return len(value) <= _LONGEST and _QUANTITY.fullmatch(value) is not None
    items = value.values() if type(value) is dict else value if type(value) in _LISTS else ()
    return any(_has_quantity(item) for item in items if type(item) in (str, *_LISTS))


def _converted(value: Any, unit: str, maps: bool, path: Path, faults: dict[Path, Fault]) -> Any:
    """Return a value with the numbers in it in SI units; the same object if there are no units."""
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value) if len(value) <= _LONGEST else None
        if match is None:
            return value
        number, named = match.groups()
        factor = factor_to(named.strip(), unit)
        if isinstance(factor, float):
            # Divide by 1000 rather than multiply by 0.001, which is rounded: 667 mm are 0.667 m.
            divisor = round(1.0 / factor) if factor < 1.0 else 0
            whole = divisor and abs(divisor * factor - 1.0) < 1e-15
            return float(number) / divisor if whole else float(number) * factor
        rule = _KINDS.get(unit)
        rule = f"be {rule}" if rule else f"have a unit that converts to {unit}"
        hint = f"The unit {factor} is not known." if factor else ""
        faults[path] = Fault(path, rule, " ".join(value.split()), hint)
        return value
    if isinstance(value, dict):
        items = dict(value) if maps else {}
    elif any(type(item) in (str, list, tuple) for item in value):
        items = dict(enumerate(value))
    else:
        return value
    changed = {}
    for key, item in items.items():
        if type(item) in (str, list, tuple):
            of_item = unit_of_entry(unit, key) if isinstance(key, int) else unit
            converted = _converted(item, of_item, maps, (*path, key), faults)
            if converted is not item:
                changed[key] = converted
    if not changed:
        return value
    if isinstance(value, dict):
        return {**value, **changed}
    return [changed.get(k, item) for k, item in enumerate(value)]


@lru_cache(maxsize=1000)
def factor_to(named: str, unit: str) -> float | str:
    """Return the factor between units; empty text for other kinds, the name of an unknown one."""
    pint, parse = _parser()
    try:
        text = f"1{named}" if named.startswith("/") else named
        source = parse(_BARE_POWER.sub("^", text))
        factor = (1.0 * source).to(parse(unit.replace(" per 1/", " "))).magnitude
    except pint.UndefinedUnitError as error:
        names = error.unit_names
        return names if isinstance(names, str) else ", ".join(names)
    except pint.DimensionalityError:
        return ""
    except Exception:  # pint reports wrong syntax by exceptions of several modules
        return named
    # Powers of ten are rounded in products of prefixes: 999.9999999999999 for g/cm^3.
    short = float(f"{factor:.12g}")
    return short if abs(short - factor) < 1e-15 * factor else float(factor)


@cache
def _parser() -> tuple[Any, Callable[[str], Any]]:
    import pint

    registry: Any = pint.UnitRegistry(None, cache_folder=None)
    definitions = files(__package__) / "units.txt"
    registry.load_definitions(definitions.read_text(encoding="utf-8").splitlines())
    return pint, registry.parse_units
