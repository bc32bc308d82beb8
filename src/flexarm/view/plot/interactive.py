"""Interactive plots of channels as pages, drawn by Plotly."""

from __future__ import annotations

from typing import Any

from flexarm.base.arguments import library_missing
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.selection import Signals
from flexarm.view.plot.style import INK

_ROW = 230  # pixels


def history_page(found: list[Signals]) -> Any:
    """Return a Plotly figure of channels over time: panels in a column with a common time axis."""
    _, subplots = _plotly()
    titles = [signals.title for signals in found]
    gaps = {"shared_xaxes": True, "vertical_spacing": 0.25 / len(found)}
    figure = subplots.make_subplots(len(found), 1, subplot_titles=titles, **gaps)
    figure.update_annotations(x=0.0, xanchor="left")  # the titles
    for row, signals in enumerate(found, start=1):
        for line, label, color in _lines(signals):
            look = {"line": {"color": color, "width": 1.5}, "name": label, "mode": "lines"}
            legend = {"legendgroup": str(row), "legendgrouptitle": {"text": signals.title}}
            figure.add_scatter(x=signals.time, y=line, row=row, col=1, **look, **legend)
        figure.update_yaxes(title_text=signals.axis_label, row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=len(found), col=1)
    figure.update_layout(height=120 + _ROW * len(found), template="simple_white", font_color=INK)
    return figure


def phase_page(values: Signals, rates: Signals) -> Any:
    """Return a Plotly figure of a channel against its rate, with the time in the hover text."""
    objects, _ = _plotly()
    figure = objects.Figure()
    for (x, label, color), (y, _, _) in zip(_lines(values), _lines(rates), strict=True):
        figure.add_scatter(
            x=x,
            y=y,
            name=label,
            mode="lines",
            line={"color": color, "width": 1.5},
            customdata=values.time,
            hovertemplate="t = %{customdata:.4g} s<br>%{x:.5g}, %{y:.5g}",
        )
    ends = {"mode": "markers", "showlegend": False, "hoverinfo": "skip"}
    for k, fill in ((0, "white"), (-1, INK)):
        dots = {"color": fill, "size": 8, "line": {"color": INK, "width": 1.5}}
        figure.add_scatter(x=values.values[k], y=rates.values[k], marker=dots, **ends)
    figure.update_xaxes(title_text=values.axis_label)
    figure.update_yaxes(title_text=rates.axis_label)
    figure.update_layout(title=values.title, template="simple_white", font_color=INK)
    return figure


def _lines(signals: Signals) -> list[tuple[Any, str, str]]:
    labels = [label or signals.title for label in signals.labels]
    return list(zip(signals.values.T, labels, series_colors(len(labels)), strict=True))


def _plotly() -> tuple[Any, Any]:
    """Import Plotly.

    Raises:
        InputError: if it is not installed.
    """
    try:
        from plotly import graph_objects, subplots
    except ImportError:
        raise library_missing("backend 'plotly'", "plots") from None
    return graph_objects, subplots
