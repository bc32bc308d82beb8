"""Tables of docs/performance/controllers.md: statistics of twelve controllers on random arms.

    python docs/performance/measure_random_arms.py [samples]

A run on which the error of the tip exceeds 50 mm RMS, or which stops, counts as a failure.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import flexarm as fa
from flexarm.model import locate_study

STUDY = Path(__file__).parents[2] / "examples" / "studies" / "random_arms.yaml"
LIMIT = 0.05  # m
HEADS = "law", "nominal", "median", "95 %", "worst", "median / nominal", "failures"


def rows(found, nominal, plant):
    """Return the rows of the table of a plant, the smallest median first; errors in mm."""
    one = found.sel(plant=plant).squeeze("reference")
    for name in one.controller.values[one.tip_error_rms.sel(quantile=0.5).argsort().values]:
        law = one.sel(controller=name)
        alone = 1e3 * nominal.tip_error_rms.sel(controller=name, plant=plant).item()
        errors = [f"{value:.1f}" for value in 1e3 * law.tip_error_rms.values]
        ratio = f"{law.tip_error_rms_ratio.values[0]:.1f}"
        yield [str(name), f"{alone:.2f}", *errors, ratio, f"{100 * law.failure_rate.item():.0f} %"]


def print_tables(table, nominal):
    """Print a table for each plant."""
    limits = {"tip_error_rms": LIMIT}
    found = fa.study_statistics(table, [0.5, 0.95, 1.0], limits=limits, nominal=nominal)
    for plant in table.plant.values:
        print(f"\n{plant}\n")
        print("|", " | ".join(HEADS), "|")
        print("| --- " * len(HEADS) + "|")
        for row in rows(found, nominal, plant):
            print("|", " | ".join(row), "|")


def main(samples=None):
    """Run the study and print its tables; ``samples`` replaces the number in the file."""
    warnings.simplefilter("ignore", fa.FlexarmWarning)
    study, _ = locate_study(STUDY)
    if samples is not None:
        study = study.replace(samples=study.samples.replace(count=samples))
    run = fa.Study(study)
    nominal = run.nominal()
    print_tables(run.run(), nominal)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
