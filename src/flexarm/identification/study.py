"""Identifications that are described by files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flexarm.arm.arm import described_arm
from flexarm.base.errors import InputError, Problem
from flexarm.cases.scenario.file_errors import problems_at
from flexarm.identification.identify import identify
from flexarm.identification.reading import record_of_file
from flexarm.identification.record import MeasuredRecord
from flexarm.identification.result import Identification
from flexarm.model.identification.study import locate_identification
from flexarm.model.wording import path_of


class PreparedIdentification:
    """Identification of a file, with its records read.

    Args:
        path: of the file; the paths of its records are relative to it.

    Raises:
        InputError: if the file or a record is invalid; the problems are listed with their lines.
    """

    def __init__(self, path: Path) -> None:
        self.study, self._where = locate_identification(path)
        self.arm = described_arm(self.study.arm)
        self._folder = path.parent
        self._records = self._read("records")
        self._validation = self._read("validation")

    def _read(self, key: str) -> dict[str, MeasuredRecord]:
        found = {}
        for name, description in getattr(self.study, key).items():
            with problems_at(self._where, f"{key}.{name}", {"path": "file", "the record": ""}):
                found[name] = record_of_file(description, self._folder / description.file)
        return found

    def run(self, progress: bool | None = None) -> Identification:
        """Estimate the parameters.

        Raises:
            InputError, SimulationError: as ``identify``.
        """
        study, fit = self.study, self.study.fit
        try:
            return identify(
                self.arm,
                self._records,
                list(study.free),
                validation=self._validation,
                motors=study.motors,
                progress=progress,
                **dict(fit),
            )
        except InputError as error:
            raise InputError(*map(self._in_file, error.problems)) from None

    def _in_file(self, problem: Problem) -> Problem:
        """Return a problem with its key and its line if its place is a record."""
        for key in ("records", "validation"):
            if problem.where in getattr(self.study, key):
                name = f"{key}.{problem.where}.{problem.name}"
                return replace(problem, name=name, where=self._where(path_of(name)))
        return problem
