"""Frequency responses of a linear model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexarm.linear import LinearModel
from flexarm.plot.style import SERIES, Sheet, legend_above, margins, place_labels, styled

_WIDTH, _ROW, _EDGES = 8.27, 1.9, 0.85  # inches
_MOST = 6
_POINTS = 1200


def response_figure(model: LinearModel, omega: NDArray[np.float64] | None = None) -> Sheet:
    """Draw the gain from every input to every output over frequency, the first six of each.

    Args:
        model: the linear model.
        omega: rad/s; from a tenth of the slowest vibration to three times that of the fifth by
            default.
    """
    inputs, outputs = model.inputs[:_MOST], model.outputs[:_MOST]
    omega = _range(model) if omega is None else omega
    hertz, gains = omega / (2.0 * np.pi), _gains(model, omega)
    rows = max(1, len(outputs))
    sheet = Sheet(_WIDTH, _EDGES + _ROW * rows)
    with styled():
        grid = sheet.add_gridspec(rows, 1)
        margins(sheet, left=0.75, bottom=0.45, right=0.2, top=0.4, hspace=0.35)
        for row, output in enumerate(outputs):
            axes = sheet.add_subplot(grid[row])
            for column, name in enumerate(inputs):
                color = SERIES[column]
                axes.loglog(hertz, gains[:, row, column], color=color, linewidth=1.0, label=name)
            axes.set(ylabel=f"{output} [{model.units[output]}]")
            if row == 0:
                legend_above(axes)
            if row == len(outputs) - 1:
                axes.set(xlabel="frequency [Hz]")
            place_labels(axes)
    return sheet


def _gains(model: LinearModel, omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gains (frequencies, outputs, inputs).

    Solved at each frequency: by way of transfer functions, as ``scipy.signal.freqresp`` goes, the
    coefficients of twenty states have lost all digits.
    """
    dynamic = 1j * omega[:, None, None] * np.eye(len(model.A)) - model.A
    states = np.linalg.solve(dynamic, np.broadcast_to(model.B, (omega.size, *model.B.shape)))
    gain: NDArray[np.float64] = np.abs(model.C @ states + model.D)
    return np.where(gain > 0.0, gain, np.nan)


def _range(model: LinearModel) -> NDArray[np.float64]:
    speed = np.sort(np.abs(model.poles.imag))[::2]
    speed = speed[speed > 1e-2]
    low, high = (0.1, 100.0) if speed.size == 0 else (0.1 * speed[0], 3.0 * speed[:5][-1])
    # The resonances themselves too: their peaks lie between the points of a grid.
    grid = np.geomspace(low, high, _POINTS)
    return np.unique(np.concatenate([grid, speed[speed < high]]))
