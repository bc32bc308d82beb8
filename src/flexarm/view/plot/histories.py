"""Plots of channels over time, of channels against their rates, and of several results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from flexarm.base.arguments import check_choice, check_dataset
from flexarm.base.errors import InputError, Problem, public_call_as, shown
from flexarm.view.plot.canvas import WIDTH, array_of, panels, rows
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.selection import Signals, named_results, several, signals_of
from flexarm.view.plot.signals import draw_signals, finish, mark_ends
from flexarm.view.plot.style import GREY, legend_above

if TYPE_CHECKING:
    import xarray as xr

#: Plotting libraries.
BACKENDS = ("matplotlib", "plotly")
#: Channel of the rate of each channel that has one.
RATES = {
    "joint_angle": "joint_rate",
    "link_angle": "link_rate",
    "link_tip_deflection": "link_tip_deflection_rate",
    "link_tip_slope": "link_tip_slope_rate",
    "tip": "tip_velocity",
    "tip_angle": "tip_angle_rate",
    "q": "qd",
}
#: Line styles of the parts of a channel if colours distinguish results.
_DASHES: tuple[Any, ...] = ("-", (0, (4.0, 1.6)), (0, (1.2, 1.2)), (0, (5.0, 1.5, 1.2, 1.5)))
_ROW, _EDGES = 1.75, 0.85  # inches


@public_call_as("plot.history")
def history(
    result: xr.Dataset,
    channels: str | list[str] | None = None,
    *,
    axes: Any = None,
    backend: str = "matplotlib",
) -> Any:
    """Draw channels of a result over time, a panel for each channel.

    Args:
        result: of ``simulate``, ``run_scenario`` or ``read_result``.
        channels: name of a channel or a list of names, such as ``"torque"`` or, for one of its
            lines, ``"torque[1]"``, ``"tip[y]"``; joint angles, tip deflections and torques by
            default. Readings of instruments are also channels: ``"measured_joint_angle"``.
        axes: Matplotlib axes to draw into, one for each channel; None for a new figure.
        backend: "matplotlib", or "plotly" for an interactive page, which requires Plotly.

    Returns:
        The Matplotlib axes for the name of a channel, an array of axes for a list; with "plotly" a
        ``plotly.graph_objects.Figure``.

    Raises:
        InputError: if the result has no such channel, ``axes`` does not have one item for each
            channel, or Plotly is requested and not installed.
    """
    result = check_dataset("result", result)
    found = several("channels", channels, result)
    if _plotly_requested(backend, axes):
        from flexarm.view.plot.interactive import history_page

        return history_page(found)
    return _panels(channels, found, axes, draw_signals)


@public_call_as("plot.compare")
def compare(
    results: Mapping[str, xr.Dataset] | list[xr.Dataset],
    channels: str | list[str] | None = None,
    *,
    axes: Any = None,
) -> Any:
    """Draw the same channels of several results, a colour for each result.

    Args:
        results: datasets by name, or a list of them; the names are in the legend. At most 20.
        channels: as in `history`. Line styles distinguish the parts of a channel, so a channel with
            more than four parts needs a selection, such as ``"joint_angle[1]"``.
        axes: Matplotlib axes to draw into, one for each channel; None for a new figure.

    Returns:
        The Matplotlib axes for the name of a channel, an array of axes for a list.

    Raises:
        InputError: if there is no result, a result lacks a channel, a channel has more than four
            parts, or ``axes`` does not have one item for each channel.
    """
    named = named_results(results)
    by_result = {name: several("channels", channels, result) for name, result in named.items()}
    first = next(iter(by_result.values()))
    if any(len(found) != len(first) for found in by_result.values()):
        rule = "are required, because the results have different ones"
        raise InputError(Problem("channels", rule))
    for signals in first:
        if max(len(found[first.index(signals)].keys) for found in by_result.values()) > 4:
            hint = f"Name one, such as '{signals.name}[{signals.keys[0]}]'."
            rule = "have at most four components each"
            raise InputError(Problem("channels", rule, shown(signals.name), hint))

    def draw(panel: Axes, signals: Signals) -> None:
        k = first.index(signals)
        _draw_compared(panel, {name: found[k] for name, found in by_result.items()})

    return _panels(channels, first, axes, draw)


@public_call_as("plot.phase_portrait")
def phase_portrait(
    result: xr.Dataset,
    channel: str = "joint_angle",
    *,
    axes: Any = None,
    backend: str = "matplotlib",
) -> Any:
    """Draw a channel against its rate, from an open to a filled dot.

    Args:
        result: as in `history`.
        channel: "joint_angle", "link_angle", "link_tip_deflection", "link_tip_slope", "tip",
            "tip_angle" or "q", with the part in brackets to draw one line of it.
        axes: Matplotlib axes to draw into; None for a new figure.
        backend: as in `history`.

    Returns:
        The Matplotlib axes; with "plotly" a ``plotly.graph_objects.Figure``.

    Raises:
        InputError: if the result has no such channel, the channel has no rate, or Plotly is
            requested and not installed.
    """
    result = check_dataset("result", result)
    plain, bracket, part = channel.partition("[") if isinstance(channel, str) else (channel, "", "")
    check_choice("channel", plain, RATES)
    values = signals_of("channel", result, channel)
    rates = signals_of("channel", result, f"{RATES[plain]}{bracket}{part}")
    if _plotly_requested(backend, axes):
        from flexarm.view.plot.interactive import phase_page

        return phase_page(values, rates)
    with panels(axes, 1, (4.2, 3.6), rows(1)) as (panel,):
        lines = []
        for k, color in enumerate(series_colors(len(values.keys))):
            x, y = values.values[:, k], rates.values[:, k]
            look: dict[str, Any] = {"color": color, "linewidth": 1.0, "label": values.labels[k]}
            lines += panel.plot(x, y, **look)
            mark_ends(panel, x, y, named=False)
        panel.set(title=values.title, xlabel=values.axis_label, ylabel=rates.axis_label)
        panel.set(xmargin=0.05)
        panel.grid(True, axis="both")
        finish(panel, values.labels, lines)
        legend = panel.get_legend()
        if len(lines) == 1 and legend is not None:  # the start and end marks need no legend
            legend.remove()
    return panel


def _plotly_requested(backend: object, axes: object) -> bool:
    if check_choice("backend", backend, BACKENDS) == "matplotlib":
        return False
    if axes is not None:
        raise InputError(Problem("axes", "cannot be combined with backend='plotly'"))
    return True


def _panels(given: object, found: list[Signals], axes: Any, draw: Any) -> Any:
    """Draw each channel into its panel; return one axes object for a name, an array for a list."""
    size = (WIDTH, _EDGES + _ROW * len(found))
    spacing = 0.3 if len(found) > 1 else 0.0
    with panels(axes, len(found), size, rows(len(found), hspace=spacing)) as made:
        for panel, signals in zip(made, found, strict=True):
            draw(panel, signals)
            if axes is None and panel is not made[-1]:
                panel.set_xlabel("")
    return made[0] if isinstance(given, str) else array_of(made)


def _draw_compared(panel: Axes, by_result: dict[str, Signals]) -> None:
    unit = max((signals.unit for signals in by_result.values()), key=len)  # prefer kN m to N m
    parts: tuple[str, ...] = ()
    for (name, signals), color in zip(
        by_result.items(), series_colors(len(by_result)), strict=True
    ):
        scale = 1.0 if signals.unit == unit else 1e-3
        for k, line in enumerate(scale * signals.values.T):
            label = name if k == 0 else "_"
            look: dict[str, Any] = {"color": color, "linewidth": 1.0, "linestyle": _DASHES[k]}
            panel.plot(signals.time, line, **look, label=label)
        parts = max(parts, signals.labels, key=len)
    panel.set(title=signals.title, xlabel="time [s]", ylabel=replace(signals, unit=unit).axis_label)
    panel.locator_params(nbins=6)
    handles, labels = panel.get_legend_handles_labels()
    if len(parts) > 1:  # explain the line styles in grey
        handles += [Line2D([], [], color=GREY, linewidth=1.0, linestyle=d) for d in _DASHES]
        handles, labels = handles[: len(labels) + len(parts)], [*labels, *parts]
    legend_above(panel, handles, labels)
