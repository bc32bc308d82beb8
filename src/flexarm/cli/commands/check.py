"""``flexarm check``: read and validate a file, and print a summary of its content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flexarm.arm.arm import described_arm
from flexarm.base.errors import InputError, Problem
from flexarm.cases.scenario.file_errors import Where
from flexarm.cases.scenario.scenario import prepare
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.scenario.summary import about_arm, about_run
from flexarm.cases.studies.samples import Samples
from flexarm.cli.advice import about_integrator, about_prepared, about_vibration
from flexarm.cli.failures import collected_warnings, warn
from flexarm.cli.tables import console, facts
from flexarm.model import StudySpec, load_arm_spec, locate_scenario, locate_study
from flexarm.model.arm.plausibility import implausible
from flexarm.model.file_format.changes import change_of, changed
from flexarm.model.file_format.files import describes_arm_only, load_document
from flexarm.model.plausible import warn_of


def check_file(path: Path, sets: Sequence[str] = ()) -> None:
    """Check an arm file, a scenario with its motion, or a study, and print a summary.

    Args:
        sets: values in place of those of the file, as ``PATH=VALUE``.

    Raises:
        InputError: if the file is not valid; it lists every problem.
    """
    document = changed(load_document(path), [change_of("--set", text) for text in sets])
    if "records" in document.value:
        rule = "describes an identification, which `check` does not read"
        hint = f"`flexarm identify {path}` validates it before the first run."
        raise InputError(Problem(path.name, rule, hint=hint))
    is_study = "drives" in document.value
    unstable: list[str] = []
    odd: list[str] = []
    with collected_warnings() as built:
        if is_study:
            located = locate_study(document)
            study = PreparedStudy(*located)
            arm = study.arm
            warn_of(implausible(arm.spec))
            unstable = [f"{name}: {text}" for name, text in study.unstable_loops().items()]
            found = [*about_arm(study.arm), *_about_study(*located), *about_vibration(study.arm)]
        elif describes_arm_only(document):
            arm = described_arm(load_arm_spec(document))
            found = [*about_arm(arm), *about_vibration(arm), *about_integrator(arm)]
        else:
            scenario, where = locate_scenario(document)
            prepared = prepare(scenario, where)
            arm = prepared.arm
            odd = prepared.implausible()
            warn_of(odd)
            poles = prepared.loop_poles()
            texts = prepared.unstable_loop(poles), prepared.slowly_unstable_loop(poles)
            unstable = list(filter(None, texts))
            found = [
                *about_arm(prepared.arm),
                *about_run(scenario),
                *about_prepared(prepared, poles),
            ]
    unstable = [*dict.fromkeys(built), *unstable]
    screen = console()
    screen.print(facts(found))
    for text in unstable:
        warn(text)
    if odd or implausible(arm.spec):
        screen.print("valid, but not plausible: see the warning")
    else:
        screen.print("ok, but for the warning" if unstable else "ok")


def _about_study(study: StudySpec, where: Where) -> list[tuple[str, str]]:
    names = (("drives", study.drives), ("plants", study.plants), ("motions", study.motions))
    rows = [(kind, ", ".join(list(items))) for kind, items in names]
    samples = Samples(study, where).count
    runs = samples * len(study.drives) * len(study.plants) * len(study.motions)
    if study.samples is not None:
        varied = ", ".join(study.vary) or "noise"
        rows.append(("samples", f"{samples}, {study.samples.method}: {varied}"))
    return [*rows, ("runs", f"{runs} of {study.run.duration:g} s")]
