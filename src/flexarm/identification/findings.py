"""Sentences on physics and instruments from the estimates of guided identification."""

from __future__ import annotations

from collections.abc import Container

import numpy as np
import xarray as xr

from flexarm.identification.data_sheet import Parameters
from flexarm.identification.missing import OF_JOINT, error_of_stated, unit_of
from flexarm.identification.record import label_of
from flexarm.identification.space import in_words
from flexarm.model.identification import INPUTS

#: Relative error of a gauge's distance, and of friction by its breakaway torque, that is named, and
#: least size of an error in standard deviations. Smooth friction has a smaller peak for sticking.
_NAMED, _SURE = 0.05, 3.0
#: Errors of gains beyond which a unit is wrong.
_FACTORS, _UNITS = (1.0 / 3.0, 3.0), ": check the units of the record, such as degrees"
_RIVAL = ", or masses that differ from the data sheet by more than 10 %"


def findings_of(
    table: xr.Dataset, stated: Container[str], slides: Container[object] = ()
) -> list[str]:
    """Return sentences on physics and instruments from the estimates of the last fit.

    ``stated``: channels whose delay the records state; ``slides``: numbers of joints that slide.
    """
    sentences = []
    estimates = table["estimate"].to_series().to_dict()
    columns = (table[name].values for name in ("estimate", "start", "standard_deviation"))
    rows = zip(table["parameter"].values.tolist(), *columns, strict=True)
    changed = {
        path: (float(value), float(start))
        for path, value, start, deviation in rows
        if abs(value - start) >= _SURE * deviation
    }
    for path, (value, start) in changed.items():
        kind, _, text = path.partition(".")
        label = label_of(text)
        unit = unit_of(label, slides) if label else ""
        match = OF_JOINT.match(path)
        joint = int(match[1]) + 1 if match else 0
        torque = "N" if joint in slides else "N m"
        if match and match[2] == "backlash":
            sentences.append(f"Joint {joint} has backlash of about {value:.2g} rad.")
        elif match and match[2] == "friction.static":
            if value < (1.0 + _NAMED) * estimates.get(path.replace("static", "coulomb"), 0.0):
                continue
            sentences.append(
                f"Joint {joint} breaks away at about {value:.2g} {torque}: Stribeck friction."
            )
        elif match and start == 0.0:
            sentence = f"Joint {joint} stops early: Coulomb friction of about {value:.2g} {torque}"
            # While a joint moves, an offset of its torque and friction of each direction are equal.
            offset = changed.get(f"offsets.torque_{joint}", (0.0, 0.0))[0]
            if offset:
                sentence += (
                    f"; without the offset of torque_{joint}, {value + offset:.2g} {torque} "
                )
                sentence += f"at positive and {value - offset:.2g} {torque} at negative rates"
            sentences.append(f"{sentence}.")
        elif kind == "offsets":
            size = f"{value:+.2g} {unit}".strip()
            sentences.append(f"{text} reads {size} at zero: an offset.")
        elif kind == "gains":
            error = 100.0 * (value - 1.0)
            rival = _RIVAL if label and label.channel in INPUTS else ""
            rival = rival if _FACTORS[0] < value < _FACTORS[1] else _UNITS
            sentences.append(f"{text} reads {error:+.2g} % too much: an error of its gain{rival}.")
        elif kind == "delays":
            named = text if label else f"The {text}"
            if (label.channel if label else text) in stated:
                whose = named.replace("The ", "the ")
                sentences.append(f"The stated delay of {whose} is about {error_of_stated(value)}.")
            elif value < 0.0:
                sentences.append(f"{named} acts about {-value:.2g} s before the record shows it.")
            else:
                sentences.append(f"{named} is late by about {value:.2g} s: a delay.")
        elif path.endswith(".distance"):
            change = value / start - 1.0 if start else 0.0
            if abs(change) > _NAMED:
                sentences.append(
                    f"The {in_words(path)} differs from the data sheet by {100 * change:+.0f} %; "
                    "an error of the gain of its amplifier acts in the same way"
                    f"{'' if _FACTORS[0] < value / start < _FACTORS[1] else _UNITS}."
                )
    return sentences


def alike_masses(table: xr.Dataset, free: Parameters) -> list[str]:
    """Return the sentence on masses that all end at the same bounds.

    An arm whose masses, inertias, stiffnesses and dampings are all larger by a factor moves in the
    same way if the torque is, too, so that a record cannot distinguish it from a gain.
    """
    masses = [path for path in free if path.endswith((".mass", ".mass_per_length"))]
    rows = table.sel(parameter=[path for path in masses if path in table["parameter"].values])
    sides = np.sign(rows["estimate"].values - rows["start"].values)
    alike = ("motors.torque_constant", *(f"gains.{channel}" for channel in INPUTS))
    gained = any(path.startswith(alike) for path in free)
    if gained or sides.size < 2 or not rows["at_bound"].values.all() or np.ptp(sides) > 0.0:
        return []
    side = "upper" if sides[0] > 0.0 else "lower"
    sentence = (
        f"All masses end at their {side} bounds: an error of the gain of the torque acts in the "
        "same way as masses, inertias, stiffnesses and damping that all differ from the data sheet "
        "by as much."
    )
    return [sentence]
