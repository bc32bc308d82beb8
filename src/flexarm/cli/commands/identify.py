"""``flexarm identify``: estimate parameters of an arm from measured records."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

import flexarm as fa
from flexarm.base.errors import AccuracyWarning, ConvergenceWarning, IdentifiabilityWarning
from flexarm.cli.failures import warn
from flexarm.cli.options import argument, check_places, flag, option
from flexarm.cli.tables import numbers, print_line


def identify(
    study: Annotated[Path, argument("STUDY.yaml", "Arm, records and free parameters.")],
    out: Annotated[Path | None, option("FILE", "Save the arm with its estimates: .yaml.")] = None,
    result: Annotated[Path | None, option("FILE", "Save the result for `report`: .nc.")] = None,
    guided: Annotated[
        bool, flag("--guided", "Inspect the records, and fit in stages from the data sheet.")
    ] = False,
    quiet: Annotated[
        bool, flag("--quiet", "Do not print evaluations or stages while they run.")
    ] = False,
) -> None:
    """Estimate parameters of an arm from measured records."""
    from flexarm.identification.commission import commissioned
    from flexarm.identification.identify import PreparedIdentification
    from flexarm.identification.result import (
        FIT_HEADS,
        HEADS,
        RELATED_HEADS,
        fit_rows,
        related,
        stage_note,
        stage_rows,
    )

    prepared = PreparedIdentification(study, study.parent)
    check_places(("--out", out, (".yaml", ".yml")), ("--result", result, (".nc",)))
    with warnings.catch_warnings():  # printed below
        warnings.simplefilter("ignore", IdentifiabilityWarning)
        warnings.simplefilter("ignore", ConvergenceWarning)
        warnings.filterwarnings("ignore", "The residuals show", AccuracyWarning)
        progress = False if quiet else None
        identification = commissioned(prepared, progress) if guided else prepared.run(progress)
    for sentence in identification.findings:
        print_line(sentence)
    if guided:
        heads, *rows = stage_rows(identification.stages)
        print_line(numbers("Stages: fit on parts that no stage fits", heads, rows))
        print_line(stage_note(identification))
    print_line(numbers("Estimates", HEADS, identification.rows()))
    pairs = related(identification.parameters)
    if pairs:
        print_line(numbers("Correlations", RELATED_HEADS, pairs))
    print_line(numbers("Fit", FIT_HEADS, fit_rows(identification.fit)))
    if identification.validation.sizes["record"]:
        print_line(numbers("Validation", FIT_HEADS, fit_rows(identification.validation)))
    for sentence in identification.remarks:
        warn(sentence)
    if out is not None:
        identification.write(out)
        print_line(f"arm in {out}")
    if result is not None:
        fa.write_result(identification.to_dataset(), result)
        print_line(f"result in {result}")
