"""Results as plots and pages draw them: lines of channels, the arm and its shapes.

This module does not import Matplotlib, because pages use it, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm, shapes_along
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_dataset, check_kind
from flexarm.base.errors import InputError, ModelError, Problem, nearest, shown
from flexarm.base.late import xr
from flexarm.model import Scenario, scenario_of_text
from flexarm.simulation.calls.result import arm_of
from flexarm.simulation.run.channels import CHANNELS
from flexarm.view.plot.magnified import Magnify, automatic, bending_of

#: Default channels of `history` and `animate`.
USUAL = ("joint_angle", "link_tip_deflection", "torque")
_READING = "measured_"
_MOST_RESULTS = 20


@dataclass(frozen=True, eq=False)
class Signals:
    """Lines of one channel."""

    name: str  # of the channel
    time: FloatArray  # (T,) s
    values: FloatArray  # (T, k) in ``unit``, the unit of the axis
    unit: str
    labels: tuple[str, ...]  # (k,) of the lines
    keys: tuple[str, ...]  # (k,) selectors of the lines, such as ``y`` in ``tip[y]``

    @property
    def title(self) -> str:
        """The name as a title."""
        return self.name.replace("_", " ").capitalize()

    @property
    def axis_label(self) -> str:
        """The quantity and its unit."""
        quantity = "position" if self.name == "tip" else self.name.split("_")[-1]
        return f"{quantity} [{self.unit}]" if self.unit else quantity


def signals_of(name: str, result: xr.Dataset, channel: object) -> Signals:
    """Return the lines of a channel: all for ``"tip"``, one for ``"tip[y]"``.

    In brackets is the number of a joint, link or contact, the axis, or the name of a coordinate.
    Readings of instruments are also channels. ``name`` is that of the argument.
    """
    if not isinstance(channel, str):
        raise InputError(Problem(name, "be the name of a channel", shown(channel)))
    plain, bracket, part = channel.partition("[")
    known = [str(key) for key in result.data_vars if _plottable(result.variables[key])]
    if plain not in known:
        hint = nearest(plain, known) or f"It has {', '.join(known[:8])}, ..."
        if plain in CHANNELS:
            hint = _missing_hint(plain)
        raise InputError(Problem(name, "be a channel of the result", shown(channel), hint))
    signals = _all(result, plain)
    if not bracket:
        return signals
    component = "".join(part.rstrip("]").split())
    if component not in signals.keys:
        keys = ", ".join(f"{plain}[{key}]" for key in signals.keys[:4])
        hint = f"Its components are {keys}{', ...' if len(signals.keys) > 4 else ''}."
        raise InputError(Problem(name, "be a component of its channel", shown(channel), hint))
    return chosen_lines(signals, [signals.keys.index(component)])


def chosen_lines(signals: Signals, places: Sequence[int]) -> Signals:
    """Return some lines of a channel."""
    labels, keys = (tuple(each[k] for k in places) for each in (signals.labels, signals.keys))
    return replace(signals, values=signals.values[:, places], labels=labels, keys=keys)


def _missing_hint(name: str) -> str:
    if name in ("bending_moment", "shear_force", "axial_force"):
        return "Simulate with stations=11, for instance, to record it."
    if name.startswith("contact"):
        return "Only results with contacts have it."
    return "This result was made without it."


def _plottable(data: xr.Variable) -> bool:
    return bool(data.dims) and data.dims[0] in ("time", "tick") and data.dtype.kind == "f"


def _all(result: xr.Dataset, name: str) -> Signals:
    data = result[name]
    time = result["time"] if data.dims[0] == "time" else result["tick_time"]
    parts = [_labels(result, str(dim), size) for dim, size in data.sizes.items()][1:]
    labels = tuple(" ".join(label for label, _ in each) for each in product(*parts))
    keys = tuple(",".join(key for _, key in each) for each in product(*parts))
    values = data.values.reshape(len(data), len(keys))
    known = CHANNELS.get(name.removeprefix(_READING))
    unit = str(data.attrs.get("units", "")) or (known.unit if known else "")
    scale, unit = (1.0, unit) if name.startswith("tip") else readable_unit(unit, values)
    return Signals(name, time.values, scale * values, unit, labels, keys)


def _labels(result: xr.Dataset, dim: str, size: int) -> list[tuple[str, str]]:
    """Return label and key of each entry of a dimension."""
    if dim in ("joint", "link", "contact"):
        numbers = result[dim].values if dim in result.coords else range(1, size + 1)
        return [(f"{dim} {number}", str(number)) for number in numbers]
    if dim == "station" and dim in result.coords:
        return [(f"at {place:.3g} of its length", f"{place:.3g}") for place in result[dim].values]
    if dim in ("axis", "coordinate", "direction") and dim in result.coords:
        return [(str(name), str(name)) for name in result[dim].values]
    stem = "part" if dim.startswith(_READING) else dim  # the names of gauges are too long
    return [(f"{stem} {number}", str(number)) for number in range(1, size + 1)]


def several(name: str, given: object, result: xr.Dataset) -> list[Signals]:
    """Return the lines of one channel or of a list of channels."""
    if given is None:
        given = [usual for usual in USUAL if usual in result and result[usual].size]
    if isinstance(given, str):
        given = [given]
    if not isinstance(given, Sequence) or not given:
        raise InputError(Problem(name, "be the name of a channel or a list of names", shown(given)))
    return [signals_of(name, result, channel) for channel in given]


def named_results(results: object, most: int = _MOST_RESULTS) -> dict[str, xr.Dataset]:
    """Return results by name, from a mapping or a list; the names of a list are 1, 2, ...."""
    # A dataset is also a mapping, of its channels.
    if isinstance(results, Mapping) and not isinstance(results, xr.Dataset):
        named = dict(results)
    elif isinstance(results, list | tuple):
        named = {str(number): item for number, item in enumerate(results, start=1)}
    else:
        named = {}
    if not 1 <= len(named) <= most or not all(isinstance(name, str) for name in named):
        rule = f"be 1 to {most} results, as a list or by name"
        raise InputError(Problem("results", rule, shown(results)))
    return {name: check_dataset(f"results[{name!r}]", d) for name, d in named.items()}


def readable_unit(unit: str, values: FloatArray) -> tuple[float, str]:
    """Return the factor to a unit with short numbers on an axis, and that unit."""
    if unit == "m":
        return 1e3, "mm"
    if unit == "1":
        return 1e6, "µm/m"  # strain
    if unit in ("J", "N m") and values.size and np.max(np.abs(values)) >= 1e4:
        return 1e-3, f"k{unit}"
    return 1.0, unit


#: Points drawn along a link.
STATIONS = 25
#: Limit on the samples of an envelope; more would take seconds.
_MOST_SAMPLES = 4000
#: Samples of a run from which the factor on its bending is chosen.
_MOST_WEIGHED = 200


def check_drawable(name: str, value: object) -> xr.Dataset:
    """Validate that the arm of a result can be drawn, and return the result."""
    result = check_dataset(name, value)
    if not {"q", "joint_angle"} <= set(result.data_vars) or not result["time"].size:
        rule = "be a result of simulate"
        raise InputError(Problem(name, rule, "a dataset without the coordinates of an arm"))
    arm = arm_of(name, result)
    if result["q"].shape[1:] != (arm.dof,):
        rule = f"have the {arm.dof} coordinates of its arm"
        raise InputError(Problem(name, rule, f"q of shape {result['q'].shape}"))
    if not np.isfinite(result["q"].values).all():
        raise InputError(Problem(name, "contains NaN or infinite coordinates"))
    return result


def scenario_of(result: xr.Dataset) -> Scenario | None:
    """Return the scenario of a result, or None."""
    text = result.attrs.get("scenario")
    try:
        return scenario_of_text(text, "result") if isinstance(text, str) else None
    except ModelError:  # written by another version: draw the motion without its reference
        return None


def rigid_result(rigid: object, arm: Arm, result: xr.Dataset) -> RigidMotion | None:
    """Return the motion of the rigid counterpart for a plot, or None.

    ``rigid`` is True for the rigid arm at the joint angles of the result, or a result of the rigid
    arm, such as that of ``arm.rigid()`` with the same torques.
    """
    if isinstance(rigid, bool | np.bool_):
        if not rigid:
            return None
        rigid_counterpart = arm.rigid()
        angles = result["joint_angle"].values
        q = np.zeros((len(angles), rigid_counterpart.dof))
        q[:, rigid_counterpart.joint_index] = angles
        for coordinate in arm.assembly.base:
            q[:, coordinate.place] = result["q"].values[:, coordinate.place]
        return RigidMotion(rigid_counterpart, result["time"].values, q)
    check_kind("rigid", rigid, xr.Dataset, "True, False or a result of simulate")
    run = check_drawable("rigid", rigid)
    return RigidMotion(arm_of("rigid", run), run["time"].values, run["q"].values)


class RigidMotion(NamedTuple):
    """Motion to draw: an arm, times (T,) s and coordinates q (T, dof)."""

    arm: Arm
    time: FloatArray
    q: FloatArray

    def shapes(self, times: FloatArray, stations: int = STATIONS) -> FloatArray:
        """Return the shapes at times (k,) s, (k, links, stations, 2) m."""
        return shapes_of(self.arm, at_times(self.time, self.q, times), stations=stations)


def at_times(time: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate values (T, ...) linearly at other times (k,)."""
    flat = values.reshape(len(values), -1)
    columns = [np.interp(times, time, column) for column in flat.T]
    return np.array(columns).T.reshape(len(times), *values.shape[1:])


def shapes_of(
    arm: Arm, q: FloatArray, magnify: float = 1.0, stations: int = STATIONS
) -> FloatArray:
    """Return shapes (k, links, stations, 2) m of q (k, dof), with bending drawn by a factor."""
    points = shapes_along(arm, q, stations)
    return points if magnify == 1.0 else bending_of(arm, q, points).links(points, magnify)


def factor_of(magnify: Magnify, motions: Sequence[tuple[Arm, xr.Dataset, bool]]) -> float:
    """Return the factor on the bending of results, which pictures of all of them share.

    With each arm and result is whether surfaces are drawn that the arm touches.
    """
    if magnify != "auto":
        return magnify
    bendings = []
    for arm, result, touches in motions:
        count = len(result["q"])
        chosen = np.linspace(0, count - 1, min(count, _MOST_WEIGHED)).round().astype(int)
        q = result["q"].values[chosen]
        points = shapes_of(arm, q, stations=9)
        bendings.append((bending_of(arm, q, points, touches), points))
    return automatic(bendings)


def joined(serial: bool, links: FloatArray) -> FloatArray:
    """Return the line (points, 2) through links (links, stations, 2), NaN between branches."""
    if not serial:
        links = np.concatenate([links, np.full((len(links), 1, 2), np.nan)], axis=1)
    return links.reshape(-1, 2)


def joints_of(arm: Arm, shapes: FloatArray) -> FloatArray:
    """Return the points (k, links, 2) m at which joints are drawn, of shapes (k, links, ...)."""
    # A joint of a serial arm is at the tip before it; the root of its link may be at a hub radius
    # from there.
    if not arm.spec.is_serial:
        return shapes[:, :, 0]
    return np.concatenate([np.zeros((len(shapes), 1, 2)), shapes[:, :-1, -1]], axis=1)


def deflections(arm: Arm, result: xr.Dataset, stations: int = STATIONS) -> FloatArray:
    """Return deflections from the root tangent of each link, (T, links, stations) m."""
    q, angle = result["q"].values, result["link_angle"].values
    if len(q) > _MOST_SAMPLES:
        chosen = np.linspace(0, len(q) - 1, _MOST_SAMPLES).round().astype(int)
        q, angle = q[chosen], angle[chosen]
    points = shapes_of(arm, q, stations=stations)
    away = points - points[:, :, :1]
    sine, cosine = np.sin(angle)[..., None], np.cos(angle)[..., None]
    across: FloatArray = cosine * away[..., 1] - sine * away[..., 0]
    return across
