"""Measured modes, and their comparison with those of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, few, public_call
from flexarm.base.notebook import html_table
from flexarm.identification.labels import Label, place_of
from flexarm.integrate.base import FloatArray
from flexarm.linear import Modes, linearize

#: Motion of an output, relative to the RMS of its channel, that is rounding.
_STILL = 1e-9


@dataclass(frozen=True, eq=False)
class MeasuredModes:
    """Modes that were fitted to a `FrequencyResponse`, in the order of ascending frequency.

    Attributes:
        frequency_hz: (k,) natural frequencies, the moduli of the poles over 2 pi.
        damping_ratio: (k,)
        frequency_deviation, damping_deviation: (k,) standard deviations, from the deviation of the
            response, and from the errors of the fit if these are larger.
        residues: (k, outputs, inputs) complex numbers A of the terms A / (s - p) of the response.
        fitted: (F, outputs, inputs) response of the fit at the frequencies in the band.
        fit: (outputs, inputs) percent, 100 is perfect.
        outputs, inputs: names, as in the response.
    """

    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_deviation: FloatArray
    damping_deviation: FloatArray
    residues: NDArray[np.complex128]
    fitted: NDArray[np.complex128] = field(repr=False)
    fit: FloatArray
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    _labels: tuple[Label, ...] = field(repr=False)
    references: ClassVar[str] = "AllemangBrown1982"

    def __repr__(self) -> str:
        frequencies = few(self.frequency_hz)
        return f"<flexarm.MeasuredModes: {self.frequency_hz.size}: {frequencies} Hz>"

    def _repr_html_(self) -> str:
        heads = ("mode", "frequency (Hz)", "std. deviation", "damping ratio", "std. deviation")
        columns = (
            self.frequency_hz,
            self.frequency_deviation,
            self.damping_ratio,
            self.damping_deviation,
        )
        rows = zip(range(1, self.frequency_hz.size + 1), *columns, strict=True)
        return html_table(repr(self).strip("<>"), heads, rows)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles (k,) with positive imaginary part, 1/s."""
        omega, zeta = 2.0 * np.pi * self.frequency_hz, self.damping_ratio
        return np.asarray(omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))

    @property
    def shapes(self) -> NDArray[np.complex128]:
        """Shapes (k, outputs), in output units of the residue of the input with the largest effect.

        With several inputs, the shapes that fit the residues of all of them best.
        """
        left, size, right = np.linalg.svd(self.residues)
        turned = left[:, :, 0] * size[:, :1]
        largest = np.argmax(np.abs(right[:, 0]), axis=1)
        phase = np.take_along_axis(right[:, 0], largest[:, None], axis=1)
        return np.asarray(turned * phase / np.abs(phase))

    @public_call
    def compare(self, modes: Modes) -> xr.Dataset:
        """Compare with the modes of a model by the modal assurance criterion.

        Args:
            modes: those of the model in the posture of the experiment, with ``joints="free"`` if
                torques were the inputs. Only those that oscillate are compared.

        Returns:
            Dataset over ``measured`` and ``model`` (numbers of modes from 1): ``mac``, from 0 to 1
            for equal shapes; over ``measured``: ``match``, the mode of the model with the largest
            ``mac``, and ``frequency_error`` and ``damping_error`` (percent), model minus measured.

        Raises:
            InputError: if the arm does not have the outputs, there is only one, no mode of the
                model oscillates, or these modes do not move the outputs.

        Outputs are divided by the RMS of their channel in the modes of the model, one number for
        all joints, gauges or axes of a channel: outputs of equal units keep their ratios. Allemang
        and Brown, Proceedings of the 1st International Modal Analysis Conference, 1982, p. 110.
        """
        modes = check_kind("modes", modes, Modes)
        if len(self.outputs) < 2:
            rule = "requires at least two outputs: with one, all shapes are equal"
            raise InputError(Problem("compare", rule))
        vibrating = np.flatnonzero(modes.eigenvalues.imag > 0.0)
        if not vibrating.size:
            raise InputError(Problem("modes", "contain no mode that oscillates"))
        own, sizes = shapes_at(modes, vibrating, self._labels)
        if not np.any(np.abs(own) > _STILL * sizes):
            raise InputError(Problem("modes", "do not move any of the outputs"))
        weight = np.where(sizes > 0.0, 1.0 / np.where(sizes > 0.0, sizes, 1.0), 0.0)
        mac = assurance(self.shapes * weight, own * weight)
        match = np.argmax(mac, axis=1)
        eigenvalues = modes.eigenvalues[vibrating][match]
        hertz = np.abs(eigenvalues) / (2.0 * np.pi)
        damping = -eigenvalues.real / np.abs(eigenvalues)
        errors = {
            "frequency_error": 100.0 * (hertz / self.frequency_hz - 1.0),
            "damping_error": 100.0 * (damping / self.damping_ratio - 1.0),
        }
        percent = {"units": "%", "long_name": "model minus measured, relative"}
        return xr.Dataset(
            {
                "mac": (("measured", "model"), mac, {"long_name": "modal assurance criterion"}),
                "match": ("measured", vibrating[match] + 1, {"long_name": "mode of the model"}),
                **{name: ("measured", values, percent) for name, values in errors.items()},
            },
            {"measured": np.arange(1, len(mac) + 1), "model": vibrating + 1},
        )


def shapes_at(
    modes: Modes, numbers: NDArray[np.intp], labels: tuple[Label, ...]
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Return shapes (k, outputs) of modes of a model, and the RMS (outputs,) of their channels.

    The RMS is over the modes and all parts of a channel, because a part that does not move, such as
    the axis along the arm, has no size of its own.

    Raises:
        InputError: if the arm does not have an output.
    """
    states = np.concatenate(
        [modes.complex_shapes, modes.eigenvalues[:, None] * modes.complex_shapes], axis=1
    )[numbers]
    places = [place_of(modes.arm, label) for label in labels]
    parts = {
        name: states @ linearize(modes.arm, modes.q, outputs=[name]).C.T
        for name in dict.fromkeys(label.channel for label in labels)
    }
    own = [parts[label.channel][:, place] for label, place in zip(labels, places, strict=True)]
    sizes = [np.sqrt(np.mean(np.abs(parts[label.channel]) ** 2)) for label in labels]
    return np.stack(own, axis=1), np.array(sizes)


def assurance(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> FloatArray:
    """Return the modal assurance criterion (k, l) of shapes (k, n) and (l, n)."""
    sizes = np.outer(np.sum(np.abs(first) ** 2, axis=1), np.sum(np.abs(second) ** 2, axis=1))
    return np.asarray(np.abs(first.conj() @ second.T) ** 2 / np.where(sizes > 0.0, sizes, 1.0))
