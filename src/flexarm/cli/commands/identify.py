"""``flexarm identify``: estimate parameters of an arm from measured records."""

from __future__ import annotations

import warnings
from pathlib import Path

import xarray as xr

from flexarm.base.errors import ConvergenceWarning, IdentifiabilityWarning
from flexarm.base.writing.places import check_place
from flexarm.cases.results import write_result
from flexarm.cli.failures import warn
from flexarm.cli.tables import console, numbers
from flexarm.identification.identify import PreparedIdentification
from flexarm.identification.result import FIT_HEADS, HEADS, Identification, fit_rows

SUFFIXES = (".yaml", ".yml")


def identify_file(path: Path, out: Path | None, result: Path | None, quiet: bool) -> None:
    """Run the identification in a file, print its result, and save the arm and the result.

    The file, its records and the output path are validated before the first run.

    Raises:
        InputError: if the file or a record is not valid, or the output cannot be written.
        SimulationError: if the arm cannot be simulated.
    """
    prepared = PreparedIdentification(path)
    if out is not None:
        check_place("--out", out, SUFFIXES)
    if result is not None:
        check_place("--result", result, (".nc",))
    with warnings.catch_warnings():  # printed below
        warnings.simplefilter("ignore", IdentifiabilityWarning)
        warnings.simplefilter("ignore", ConvergenceWarning)
        found = prepared.run(False if quiet else None)
    screen = console()
    screen.print(numbers("Estimates", HEADS, found.rows()), soft_wrap=True)
    screen.print(_fits("Fit", found, found.fit), soft_wrap=True)
    if found.validation.sizes["record"]:
        screen.print(_fits("Validation", found, found.validation), soft_wrap=True)
    for sentence in found.remarks:
        warn(sentence)
    if out is not None:
        found.write(out)
        screen.print(f"arm in {out}", soft_wrap=True)
    if result is not None:
        write_result(found.to_dataset(), result)
        screen.print(f"result in {result}", soft_wrap=True)


def _fits(title: str, found: Identification, fits: xr.Dataset) -> object:
    return numbers(title, FIT_HEADS, fit_rows(fits))
