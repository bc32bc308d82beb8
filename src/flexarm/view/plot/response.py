"""Frequency responses of a linear model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_kind
from flexarm.base.errors import check_array, public_call_as
from flexarm.linear import LinearModel
from flexarm.view.plot.style import (
    SERIES,
    AxesArray,
    Sheet,
    array_of,
    legend_above,
    margins,
    panels,
    place_labels,
    styled,
)

_WIDTH, _GAIN, _PHASE, _EDGES = 8.27, 1.7, 1.0, 0.85  # inches
_MOST = 6
_POINTS = 1200
#: Largest displayed phase, degrees. Phases of undamped models are multiples of 90, so the wrap
#: between two of them keeps rounding from moving a line to the other end of the axis.
_HIGHEST_PHASE = 135.0
#: Distance from an undamped resonance, as a fraction of its frequency, at which the line ends.
_BESIDE = 1e-4
#: Damping ratio below which a vibration has no finite response at its frequency.
_UNDAMPED = 1e-9
#: Frequency of rigid motion from rounding errors, relative to the highest one.
_RIGID = 1e-7


@public_call_as("plot.bode")
def bode(model: LinearModel, omega: ArrayLike | None = None, *, axes: Any = None) -> AxesArray:
    """Draw gain and phase from every input to every output over frequency, at most six of each.

    The lines are interrupted at undamped resonances, where the gain is unbounded.

    Args:
        model: the linear model.
        omega: (frequencies,) rad/s; by default from a tenth of the slowest vibration's frequency to
            three times that of the fifth.
        axes: Matplotlib axes to draw into, gain and phase of each output; None for a new figure.

    Returns:
        An array (outputs, 2) of Matplotlib axes: gain and phase.

    Raises:
        InputError: if the model is not a `LinearModel`, ``omega`` is not finite numbers, or
            ``axes`` does not have two items for each output.
    """
    drawing = _Responses(model, omega)
    count = 2 * drawing.rows
    with panels(axes, count, drawing.size, drawing.arrange) as made:
        drawing.draw(made)
    return array_of(made, drawing.rows, 2)


@public_call_as("plot.response_figure")
def response_figure(model: LinearModel, omega: ArrayLike | None = None) -> Sheet:
    """Draw gain and phase as `bode` does, in a figure that is not registered with pyplot.

    Args:
        model, omega: as in `bode`.

    Raises:
        InputError: if the model is not a `LinearModel`, or ``omega`` is not finite numbers.
    """
    drawing = _Responses(model, omega)
    sheet = Sheet(*drawing.size)
    with styled():
        made = drawing.arrange(sheet)
        drawing.draw(made)
        for each in made:
            place_labels(each)
    return sheet


class _Responses:
    """Responses of a model and their layout: gain above phase for each output."""

    def __init__(self, model: LinearModel, omega: ArrayLike | None) -> None:
        self.model = check_kind("model", model, LinearModel)
        self.inputs, self.outputs = model.inputs[:_MOST], model.outputs[:_MOST]
        given = _range(model) if omega is None else omega
        self.omega = check_array("omega", given, (-1,))
        self.response = model.frequency_response(self.omega)
        # Rounding moves an undamped pole, and the response there is finite and has no meaning.
        poles = model.poles[_undamped(model.poles)]
        speed = np.abs(poles[np.abs(poles) > 0.0])
        near = np.abs(self.omega[:, None] - speed) < 0.5 * _BESIDE * speed
        self.response[near.any(axis=1)] = np.nan
        self.rows = max(1, len(self.outputs))
        self.size = (_WIDTH, _EDGES + (_GAIN + _PHASE) * self.rows)

    def arrange(self, sheet: Sheet) -> list[Axes]:
        """Add the axes of all outputs."""
        grid = sheet.add_gridspec(self.rows, 1)
        margins(sheet, left=0.85, bottom=0.45, right=0.2, top=0.4, hspace=0.2)
        made = []
        for row in range(self.rows):
            pair = grid[row].subgridspec(2, 1, height_ratios=(_GAIN, _PHASE), hspace=0.12)
            made += [sheet.add_subplot(pair[0]), sheet.add_subplot(pair[1])]
            made[-2].tick_params(labelbottom=False)
        return made

    def draw(self, made: Sequence[Axes]) -> None:
        """Draw gain and phase of each output."""
        hertz = np.abs(self.omega[self.omega != 0.0]) / (2.0 * np.pi)
        shown = (float(hertz.min()), float(hertz.max())) if np.unique(hertz).size > 1 else None
        for row, output in enumerate(self.outputs):
            gain, phase = made[2 * row : 2 * row + 2]
            for column, name in enumerate(self.inputs):
                values = self.response[:, row, column]
                _draw(gain, phase, self.omega, values, color=SERIES[column], label=name)
            gain.set(ylabel=f"{output}\n[{_gain_unit(self.model, output)}]")
            gain.set_xlim(shown)
            phase.set_xlim(shown)
            if not (np.abs(self.response[:, row]) > 0.0).any():  # zero, or NaN at a resonance
                gain.set_yticks([])
                words = "zero: no input moves it here"
                gain.text(0.5, 0.5, words, ha="center", transform=gain.transAxes)
            phase.set(ylabel="phase [°]")
        if self.outputs:
            legend_above(made[0])
            made[-1].set(xlabel="frequency [Hz]")


def _draw(
    gain: Axes,
    phase: Axes,
    omega: NDArray[np.float64],
    values: NDArray[np.complex128],
    **look: str,
) -> None:
    """Draw one response, without a line where it is zero or unbounded."""
    size = np.abs(values)
    hertz = omega / (2.0 * np.pi)
    size = np.where(size > 0.0, size, np.nan)
    degrees = np.where(np.isnan(size), np.nan, np.degrees(np.angle(values)))
    degrees = np.where(degrees > _HIGHEST_PHASE, degrees - 360.0, degrees)
    gain.loglog(hertz, size, linewidth=1.0, **look)
    phase.semilogx(hertz, degrees, linewidth=1.0, **look)
    phase.set_ylim(_HIGHEST_PHASE - 360.0, _HIGHEST_PHASE)
    phase.yaxis.set_major_locator(MultipleLocator(90.0))


def _gain_unit(model: LinearModel, output: str) -> str:
    """Return the unit of the gain; without the input's unit if the inputs have several."""
    unit = model.units[output]
    inputs = {model.units[name] for name in model.inputs[:_MOST]}
    return f"{unit} / ({inputs.pop()})" if len(inputs) == 1 else f"{unit} / input"


def _undamped(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    return np.abs(poles.real) < _UNDAMPED * np.abs(poles)


def _range(model: LinearModel) -> NDArray[np.float64]:
    """Return frequencies that resolve all vibrations in the range, rad/s."""
    slowest_first = np.argsort(np.abs(model.poles.imag))[::2]
    poles = model.poles[slowest_first]
    poles = poles[np.abs(poles.imag) > _RIGID * np.abs(poles).max(initial=0.0)]
    speed = np.abs(poles.imag)
    low, high = (0.1, 100.0) if speed.size == 0 else (0.1 * speed[0], 3.0 * speed[:5][-1])
    # Add the peaks between the grid points, or for undamped ones the points next to the peak.
    undamped = _undamped(poles)
    around = speed[undamped, None] * (1.0 + _BESIDE * np.array([-1.0, 0.0, 1.0]))
    own = np.concatenate([speed[~undamped], around.ravel()])
    return np.unique(np.concatenate([np.geomspace(low, high, _POINTS), own[own < high]]))
