"""Plots of channels over time and against their rates, of several results, and on a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from flexarm.base.arguments import check_choice, check_dataset, library_missing
from flexarm.base.errors import InputError, Problem, public_call_as, shown
from flexarm.base.late import xr
from flexarm.view.plot import style
from flexarm.view.plot.drawn_result import (
    Signals,
    named_results,
    readable_unit,
    several,
    signals_of,
)
from flexarm.view.plot.palette import series_colors

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
    channels_drawn = several("channels", channels, result)
    if _plotly_requested(backend, axes):
        return _history_page(channels_drawn)
    return _panels(channels, channels_drawn, axes, draw_signals)


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
    if any(len(group) != len(first) for group in by_result.values()):
        rule = "are required, because the results have different ones"
        raise InputError(Problem("channels", rule))
    for signals in first:
        if max(len(group[first.index(signals)].keys) for group in by_result.values()) > 4:
            hint = f"Name one, such as '{signals.name}[{signals.keys[0]}]'."
            rule = "have at most four components each"
            raise InputError(Problem("channels", rule, shown(signals.name), hint))

    def draw(panel: Axes, signals: Signals) -> None:
        k = first.index(signals)
        _draw_compared(panel, {name: group[k] for name, group in by_result.items()})

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
        return _phase_page(values, rates)
    with style.panels(axes, 1, (4.2, 3.6), style.rows(1)) as (panel,):
        lines = []
        for k, color in enumerate(series_colors(len(values.keys))):
            x, y = values.values[:, k], rates.values[:, k]
            look: dict[str, Any] = {"color": color, "linewidth": 1.0, "label": values.labels[k]}
            lines += panel.plot(x, y, **look)
            _mark_ends(panel, x, y, named=False)
        panel.set(title=values.title, xlabel=values.axis_label, ylabel=rates.axis_label)
        panel.set(xmargin=0.05)
        panel.grid(True, axis="both")
        _finish(panel, values.labels, lines)
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


def _panels(given: object, chosen: list[Signals], axes: Any, draw: Any) -> Any:
    """Draw each channel into its panel; return one axes object for a name, an array for a list."""
    size = (style.WIDTH, _EDGES + _ROW * len(chosen))
    spacing = 0.3 if len(chosen) > 1 else 0.0
    with style.panels(axes, len(chosen), size, style.rows(len(chosen), hspace=spacing)) as made:
        for panel, signals in zip(made, chosen, strict=True):
            draw(panel, signals)
            if axes is None and panel is not made[-1]:
                panel.set_xlabel("")
    return made[0] if isinstance(given, str) else style.array_of(made)


def _draw_compared(panel: Axes, by_result: dict[str, Signals]) -> None:
    unit = max((signals.unit for signals in by_result.values()), key=len)  # prefer kN m to N m
    parts: tuple[str, ...] = ()
    colors = series_colors(len(by_result))
    for (name, signals), color in zip(by_result.items(), colors, strict=True):
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
        handles += [Line2D([], [], color=style.GREY, linewidth=1.0, linestyle=d) for d in _DASHES]
        handles, labels = handles[: len(labels) + len(parts)], [*labels, *parts]
    style.legend_above(panel, handles, labels)


_PLOTLY_ROW = 230  # pixels


def _history_page(chosen: list[Signals]) -> Any:
    """Return a Plotly figure of channels over time: panels in a column with a common time axis."""
    _, subplots = _plotly()
    titles = [signals.title for signals in chosen]
    gaps = {"shared_xaxes": True, "vertical_spacing": 0.25 / len(chosen)}
    figure = subplots.make_subplots(len(chosen), 1, subplot_titles=titles, **gaps)
    figure.update_annotations(x=0.0, xanchor="left")  # the titles
    for row, signals in enumerate(chosen, start=1):
        for line, label, color in _lines(signals):
            look = {"line": {"color": color, "width": 1.5}, "name": label, "mode": "lines"}
            legend = {"legendgroup": str(row), "legendgrouptitle": {"text": signals.title}}
            figure.add_scatter(x=signals.time, y=line, row=row, col=1, **look, **legend)
        figure.update_yaxes(title_text=signals.axis_label, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(chosen), col=1)
    height = 120 + _PLOTLY_ROW * len(chosen)
    figure.update_layout(height=height, template="simple_white", font_color=style.INK)
    return figure


def _phase_page(values: Signals, rates: Signals) -> Any:
    """Return a Plotly figure of a channel against its rate, with the time in the hover text."""
    objects, _ = _plotly()
    figure = objects.Figure()
    for (x, label, color), (y, _, _) in zip(_lines(values), _lines(rates), strict=True):
        hover = "t = %{customdata:.4g} s<br>%{x:.5g}, %{y:.5g}"
        look = {"line": {"color": color, "width": 1.5}, "name": label, "mode": "lines"}
        figure.add_scatter(x=x, y=y, customdata=values.time, hovertemplate=hover, **look)
    ends = {"mode": "markers", "showlegend": False, "hoverinfo": "skip"}
    for k, fill in ((0, "white"), (-1, style.INK)):
        dots = {"color": fill, "size": 8, "line": {"color": style.INK, "width": 1.5}}
        figure.add_scatter(x=values.values[k], y=rates.values[k], marker=dots, **ends)
    figure.update_xaxes(title_text=values.axis_label)
    figure.update_yaxes(title_text=rates.axis_label)
    figure.update_layout(title=values.title, template="simple_white", font_color=style.INK)
    return figure


def _lines(signals: Signals) -> list[tuple[Any, str, str]]:
    labels = [label or signals.title for label in signals.labels]
    return list(zip(signals.values.T, labels, series_colors(len(labels)), strict=True))


def _plotly() -> tuple[Any, Any]:
    try:
        from plotly import graph_objects, subplots
    except ImportError:
        raise library_missing("backend 'plotly'", "plots") from None
    return graph_objects, subplots


_ENERGIES = {
    "kinetic_energy": style.BLUE,
    "strain_energy": style.VERMILLION,
    "gravity_energy": style.GREEN,
}
_MOST_NAMES = 4  # that fit into a legend above a plot of this width
_WIDTH, _PAGE_ROW, _PAGE_EDGES = 8.27, 2.5, 0.85  # inches


@public_call_as("plot.signals_figure")
def signals_figure(result: xr.Dataset) -> style.Sheet:
    """Draw the main channels of a result of ``simulate`` on one page.

    The page shows tip path, joint angles, tip deflections, joint rates, energies and torques, and
    the strains if the arm has gauges.

    Raises:
        InputError: if the result is not one of `simulate`, or lacks one of these channels.
    """
    needed = ("tip", "joint_angle", "link_tip_deflection", "joint_rate", *_ENERGIES, "torque")
    check_dataset("result", result, ("time", *needed))
    rows = 4 if "strain" in result else 3
    sheet = style.Sheet(_WIDTH, _PAGE_EDGES + _PAGE_ROW * rows)
    with style.styled():
        grid = sheet.add_gridspec(rows, 2)
        style.margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, wspace=0.24, hspace=0.36)
        _draw_tip_path(sheet.add_subplot(grid[0, 0]), result)
        places = {"joint_angle": grid[0, 1], "link_tip_deflection": grid[1, 0]}
        places |= {"joint_rate": grid[1, 1], "energy": grid[2, 0], "torque": grid[2, 1]}
        for name, place in (places | ({"strain": grid[3, :]} if rows == 4 else {})).items():
            axes = sheet.add_subplot(place)
            if name == "energy":
                _draw_energies(axes, result)
            else:
                draw_signals(axes, signals_of("result", result, name))
        for axes in sheet.axes:
            style.place_labels(axes)
    return sheet


def draw_signals(axes: Axes, signals: Signals) -> None:
    """Draw the lines of a channel over time."""
    colors = series_colors(len(signals.labels))
    lines = [
        axes.plot(signals.time, line, color=color, linewidth=1.0, label=label)[0]
        for line, label, color in zip(signals.values.T, signals.labels, colors, strict=True)
    ]
    axes.set(title=signals.title, xlabel="time [s]", ylabel=signals.axis_label)
    _finish(axes, signals.labels, lines)


def _draw_energies(axes: Axes, result: xr.Dataset) -> None:
    """Draw the energies over time, and their sum as a dashed line."""
    time = result["time"].values
    energies = np.stack([result[name].values for name in _ENERGIES])
    scale, unit = readable_unit("J", energies)
    for (name, color), energy in zip(_ENERGIES.items(), energies, strict=True):
        if np.any(energy):
            label = name.removesuffix("_energy")
            axes.plot(time, scale * energy, color=color, linewidth=1.0, label=label)
    axes.plot(time, scale * energies.sum(axis=0), **{**style.RIGID, "label": "total"})
    axes.set(title="Energy", xlabel="time [s]", ylabel=f"energy [{unit}]")
    _finish(axes, [])


def _draw_tip_path(axes: Axes, result: xr.Dataset) -> None:
    """Draw the path of the tip in the plane, from an open to a filled dot."""
    x, y = result["tip"].values.T
    axes.plot(x, y, color=style.BLUE, linewidth=1.0)
    _mark_ends(axes, x, y)
    axes.set(title="Tip", xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(True, axis="both")
    style.legend_above(axes)


def _mark_ends(axes: Axes, x: Any, y: Any, named: bool = True) -> None:
    """Mark the start of a path by an open dot and its end by a filled one."""
    look: dict[str, Any] = {
        "color": style.INK,
        "markersize": 4.0,
        "linestyle": "none",
        "marker": "o",
    }
    start, end = ("start", "end") if named else ("_", "_")
    axes.plot(x[0], y[0], **look, markerfacecolor="white", label=start)
    axes.plot(x[-1], y[-1], **look, label=end)


def _finish(axes: Axes, names: Sequence[str], lines: Sequence[Line2D] | None = None) -> None:
    """Limit the ticks and add a legend; of many lines only the first and the last have labels."""
    axes.locator_params(nbins=6)
    lines = axes.get_lines() if lines is None else lines
    for line in lines[1:-1] if len(names) > _MOST_NAMES else []:
        line.set_label("_")
    if len(axes.get_lines()) > 1:
        style.legend_above(axes)
