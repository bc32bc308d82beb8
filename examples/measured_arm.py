"""A real robot arm: two modes, fitted to the first half of a record, predict the second half.

`measured/robot_arm.csv` has the torque and the acceleration of a robot arm of KU Leuven (DaISY,
data set 96-009). Its sample time is not published; with 1 s, frequencies are periods per sample.
The second half is masked: there the fit goes on from its state at the end of the first half.

Prints: two modes predict 94.5 % of the second half
Usage: python measured_arm.py [figure.png]
"""

import sys
from pathlib import Path

import numpy as np

import flexarm as fa

half = 512


def read(**options):
    """Return the record; the place of its accelerometer is unknown, and does not matter here."""
    path = Path(__file__).parent / "measured" / "robot_arm.csv"
    channels = {"torque_1": "input", "acceleration_1": "output"}
    sensors = [fa.InertialSensor(link=1)]
    return fa.read_record(path, channels, sample_time=1.0, sensors=sensors, **options)


measured = read().data["acceleration"].values[:, 0]
modes = fa.measured_modes(read(masks={"acceleration_1": [(half, 2 * half - 1)]}), 2)
predicted = modes.fitted[:, 0]
error = measured - predicted
unseen = measured[half:]
fit = 100.0 * (1.0 - np.linalg.norm(error[half:]) / np.linalg.norm(unseen - unseen.mean()))
print(f"two modes predict {fit:.1f} % of the second half")

if len(sys.argv) > 1:
    from matplotlib.figure import Figure

    def amplitudes(values):
        return np.abs(np.fft.rfft(values))[1:410] / half

    with fa.plot.styled():
        figure = Figure(figsize=(7.0, 5.0), dpi=150, layout="constrained")
        above, below = figure.subplots(2)
        above.plot(measured, color="#B0B0B0", linewidth=1.6, label="measured")
        above.plot(predicted, linewidth=0.7, label="predicted")
        above.plot(error, linewidth=0.7, label="difference")
        above.set(xlim=(half, 2 * half - 1), xlabel="sample", ylabel="acceleration")
        above.set_title("Second half, which the fit did not use", pad=18.0)
        lines = np.arange(1, 410)
        odd = lines % 2 == 1
        everything = fa.measured_modes(read(), 2).fitted[:, 0]
        size, rest = amplitudes(measured), amplitudes(measured - everything)
        hertz = lines / (2 * half)
        below.semilogy(hertz[odd], size[odd], color="#B0B0B0", linewidth=1.6, label="measured")
        style = {"linestyle": "none", "marker": "o", "markersize": 2.2}
        below.semilogy(
            hertz[odd], rest[odd], **style, color="C1", label="difference, lines of the sweep"
        )
        below.semilogy(hertz[~odd], rest[~odd], **style, color="C0", label="lines between them")
        below.annotate(
            "third mode?",
            (0.339, 4e-5),
            (0.339, 2e-3),
            arrowprops={"arrowstyle": "->"},
            ha="center",
        )
        below.set(xlabel="frequency [periods per sample]", ylabel="amplitude")
        below.set_title("Whole record, fitted as a whole", pad=18.0)
        for axes in (above, below):
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, frameon=False)
        figure.savefig(sys.argv[1])
