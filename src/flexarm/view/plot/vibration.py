"""Plots of modes, of their frequencies over a parameter, and of frequency responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_kind
from flexarm.base.errors import check_array, public_call_as
from flexarm.linear import LinearModel, Modes, ModeTracks
from flexarm.model.quantities import Count
from flexarm.view.plot import style
from flexarm.view.plot.palette import series_colors

_WIDTH, _ROW, _EDGES = 8.27, 2.3, 0.85  # inches
_COLUMNS = 3
_MOST_NAMES = 6


@public_call_as("plot.modes")
def modes(found: Modes, count: Count = 6, *, axes: Any = None) -> style.AxesArray:
    """Draw the lowest mode shapes, one per panel: displaced to both sides, arm at rest dashed.

    Args:
        found: modes from `flexarm.modes`.
        count: number of modes to draw.
        axes: Matplotlib axes to draw into, one for each mode; None for a new figure.

    Returns:
        An array of Matplotlib axes, one for each mode: ``count``, or fewer if the arm has fewer.

    Raises:
        InputError: if ``found`` is not a `Modes` object, ``count`` is not a positive integer, or
            ``axes`` does not have one item for each mode.
    """
    return _Shapes(check_kind("found", found, Modes), count).on(axes)


@public_call_as("plot.modes_figure")
def modes_figure(modes: Modes, count: Count = 6) -> style.Sheet:
    """Draw the lowest mode shapes as `modes` does, in a figure not registered with pyplot.

    Args:
        modes: modes from `flexarm.modes`.
        count: number of modes to draw.

    Raises:
        InputError: if ``modes`` is not a `Modes` object, or ``count`` is not a positive integer.
    """
    return _Shapes(check_kind("modes", modes, Modes), count).page()


class _Shapes(style.Drawing):
    """Shapes of the lowest modes."""

    def __init__(self, modes: Modes, count: int) -> None:
        self.modes, self.shape = modes, (min(count, modes.frequency_hz.size),)
        self.rows = max(1, -(-self.shape[0] // _COLUMNS))
        self.size = (_WIDTH, _EDGES + _ROW * self.rows)

    def arrange(self, sheet: style.Sheet) -> list[Axes]:
        grid = sheet.add_gridspec(self.rows, _COLUMNS)
        style.margins(sheet, left=0.6, bottom=0.5, right=0.2, top=0.35, wspace=0.3, hspace=0.5)
        return [sheet.add_subplot(grid[k]) for k in range(*self.shape)]

    def draw(self, made: Sequence[Axes]) -> None:
        modes, arm = self.modes, self.modes.arm
        curves = modes.curves(amplitude=0.12 * arm.reach)
        rest = arm.shape(modes.q)
        for k, axes in enumerate(made):
            for link in range(arm.n_links):
                axes.plot(*rest[link].T, **{**style.RIGID, "label": "_"})
                axes.plot(*curves[k, link].T, color=style.BLUE, linewidth=1.3)
                axes.plot(*(2 * rest[link] - curves[k, link]).T, color=style.GREY, linewidth=0.7)
            axes.set(title=_title(modes, k), xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
            axes.set_aspect("equal", adjustable="datalim")


def _title(modes: Modes, k: int) -> str:
    hertz, ratio = modes.frequency_hz[k], modes.damping_ratio[k]
    if hertz == 0.0:
        return f"{k + 1}: does not vibrate"
    damping = f", {float(f'{100.0 * ratio:.2g}'):g} %" if abs(ratio) > 1e-9 else ""
    return f"{k + 1}: {hertz:.4g} Hz{damping}"


@public_call_as("plot.campbell")
def campbell(tracks: ModeTracks, *, axes: Any = None) -> Axes:
    """Draw frequencies over a spin rate, a time, or a sequence of postures.

    Over the spin rate this is the Campbell diagram: dashed lines are the spin frequency and its
    multiples, whose intersections are resonances with excitations that rotate with the arm.

    Args:
        tracks: from `flexarm.campbell` or `track_modes`.
        axes: Matplotlib axes to draw into; None for a new figure.

    Returns:
        The Matplotlib axes. `tracks_figure` also draws the damping ratios.

    Raises:
        InputError: if ``tracks`` is not a `ModeTracks` object.
    """
    tracks = check_kind("tracks", tracks, ModeTracks)
    with style.panels(axes, 1, (style.WIDTH, 3.6), style.rows(1)) as (panel,):
        _draw_frequencies(panel, tracks)
        style.legend_above(panel)
    return panel


@public_call_as("plot.tracks_figure")
def tracks_figure(tracks: ModeTracks) -> style.Sheet:
    """Draw frequencies as `campbell` does, and below them the damping ratios if there is damping.

    Raises:
        InputError: if ``tracks`` is not a `ModeTracks` object.
    """
    tracks = check_kind("tracks", tracks, ModeTracks)
    damped = bool(np.nanmax(np.abs(tracks.damping_ratio), initial=0.0) > 1e-6)
    sheet = style.Sheet(_WIDTH, 4.2 if not damped else 6.4)
    with style.styled():
        grid = sheet.add_gridspec(1 + damped, 1)
        style.margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, hspace=0.3)
        axes = sheet.add_subplot(grid[0])
        _draw_frequencies(axes, tracks)
        if damped:
            below = sheet.add_subplot(grid[1])
            _draw_lines(below, tracks, 100.0 * tracks.damping_ratio, "damping ratio [%]")
        style.legend_above(axes)
        for each in sheet.axes:
            style.place_labels(each)
    return sheet


def _draw_frequencies(axes: Axes, tracks: ModeTracks) -> None:
    _draw_lines(axes, tracks, tracks.frequency_hz, "frequency [Hz]")
    if tracks.parameter_name == "spin":
        # Draw the lines of one, two, ... cycles per revolution that are within the plot.
        top = axes.get_ylim()[1]
        turns = tracks.parameter / (2.0 * np.pi)
        for order in (1, 2, 3, 4):
            if order * turns[-1] > 0.05 * top:
                axes.plot(tracks.parameter, order * turns, **{**style.RIGID, "label": "_"})
                at = min(turns[-1], 0.97 * top / order)
                white = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
                place = (2.0 * np.pi * at, order * at)
                axes.annotate(f"{order}×", place, ha="right", va="center", bbox=white)
        axes.set_ylim(top=top)


def _draw_lines(axes: Axes, tracks: ModeTracks, values: np.ndarray, label: str) -> None:
    count = values.shape[1]
    for j, color in enumerate(series_colors(count)):
        name = f"mode {j + 1}" if count <= _MOST_NAMES or j in (0, count - 1) else "_"
        axes.plot(tracks.parameter, values[:, j], color=color, linewidth=1.2, label=name)
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    axes.set(xlabel=f"{tracks.parameter_name}{unit}", ylabel=label)
    axes.set_ylim(bottom=min(0.0, float(np.nanmin(values, initial=0.0))))


_GAIN, _PHASE = 1.7, 1.0  # inches
_MOST_SIGNALS = 6
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
def bode(
    model: LinearModel, omega: ArrayLike | None = None, *, axes: Any = None
) -> style.AxesArray:
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
    return _Responses(model, omega).on(axes)


@public_call_as("plot.response_figure")
def response_figure(model: LinearModel, omega: ArrayLike | None = None) -> style.Sheet:
    """Draw gain and phase as `bode` does, in a figure that is not registered with pyplot.

    Args:
        model, omega: as in `bode`.

    Raises:
        InputError: if the model is not a `LinearModel`, or ``omega`` is not finite numbers.
    """
    return _Responses(model, omega).page()


class _Responses(style.Drawing):
    """Responses of a model and their layout: gain above phase for each output."""

    def __init__(self, model: LinearModel, omega: ArrayLike | None) -> None:
        self.model = check_kind("model", model, LinearModel)
        self.inputs, self.outputs = model.inputs[:_MOST_SIGNALS], model.outputs[:_MOST_SIGNALS]
        given = _range(model) if omega is None else omega
        self.omega = check_array("omega", given, (-1,))
        self.response = model.frequency_response(self.omega)
        # Rounding moves an undamped pole, and the response there is finite and has no meaning.
        poles = model.poles[_undamped(model.poles)]
        speed = np.abs(poles[np.abs(poles) > 0.0])
        near = np.abs(self.omega[:, None] - speed) < 0.5 * _BESIDE * speed
        self.response[near.any(axis=1)] = np.nan
        self.rows = max(1, len(self.outputs))
        self.size, self.shape = (_WIDTH, _EDGES + (_GAIN + _PHASE) * self.rows), (self.rows, 2)

    def arrange(self, sheet: style.Sheet) -> list[Axes]:
        grid = sheet.add_gridspec(self.rows, 1)
        style.margins(sheet, left=0.85, bottom=0.45, right=0.2, top=0.4, hspace=0.2)
        made = []
        for row in range(self.rows):
            pair = grid[row].subgridspec(2, 1, height_ratios=(_GAIN, _PHASE), hspace=0.12)
            made += [sheet.add_subplot(pair[0]), sheet.add_subplot(pair[1])]
            made[-2].tick_params(labelbottom=False)
        return made

    def draw(self, made: Sequence[Axes]) -> None:
        hertz = np.abs(self.omega[self.omega != 0.0]) / (2.0 * np.pi)
        shown = (float(hertz.min()), float(hertz.max())) if np.unique(hertz).size > 1 else None
        for row, output in enumerate(self.outputs):
            gain, phase = made[2 * row : 2 * row + 2]
            for column, name in enumerate(self.inputs):
                values = self.response[:, row, column]
                _draw(
                    gain,
                    phase,
                    self.omega / (2.0 * np.pi),
                    values,
                    color=style.SERIES[column],
                    label=name,
                )
            gain.set(ylabel=f"{output}\n[{_gain_unit(self.model, output)}]")
            gain.set_xlim(shown)
            phase.set_xlim(shown)
            if not (np.abs(self.response[:, row]) > 0.0).any():  # zero, or NaN at a resonance
                gain.set_yticks([])
                words = "zero: no input moves it here"
                gain.text(0.5, 0.5, words, ha="center", transform=gain.transAxes)
            phase.set(ylabel="phase [°]")
        if self.outputs:
            style.legend_above(made[0])
            made[-1].set(xlabel="frequency [Hz]")


def _draw(
    gain: Axes, phase: Axes, hertz: FloatArray, values: NDArray[np.complex128], **look: str
) -> None:
    """Draw one response, without a line where it is zero or unbounded."""
    size = np.abs(values)
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
    inputs = {model.units[name] for name in model.inputs[:_MOST_SIGNALS]}
    return f"{unit} / ({inputs.pop()})" if len(inputs) == 1 else f"{unit} / input"


def _undamped(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    return np.abs(poles.real) < _UNDAMPED * np.abs(poles)


def _range(model: LinearModel) -> FloatArray:
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
