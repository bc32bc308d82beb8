"""``flexarm check``: read and validate a file, and print a summary of its content."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import flexarm as fa
from flexarm.base.errors import FlexarmError
from flexarm.cli.failures import collected_warnings, warn
from flexarm.cli.options import Sets, argument, changed_document, flag
from flexarm.cli.tables import console, facts

if TYPE_CHECKING:
    from flexarm.cases.scenario.file_errors import Where
    from flexarm.cases.scenario.scenario import Prepared
    from flexarm.identification.identify import PreparedIdentification
    from flexarm.integrate.base import FloatArray
    from flexarm.model import StudySpec
    from flexarm.model.file_format.yaml_text import Document
    from flexarm.simulation.loop.stability import LoopPole

Rows = list[tuple[str, str]]

_MOST_FREQUENCIES = 4


def check(
    file: Annotated[Path, argument("FILE", "Arm, scenario, study or identification.")],
    sets: Sets = None,
    json: Annotated[bool, flag("--json", "Print the summary as JSON, and nothing else.")] = False,
) -> None:
    """Check the file of an arm, scenario, study or identification; report problems by line."""
    from json import dumps

    from flexarm.base.references import package_version
    from flexarm.cases.scenario.summary import about_arm
    from flexarm.model.plausible import implausible

    with collected_warnings() as texts:
        arm, rows, unstable, odd = _content(changed_document(file, sets), file.parent)
        rows = [*about_arm(arm), *rows]
    warnings = [*dict.fromkeys(texts), *filter(None, unstable)]
    conclusion = "ok, but for the warning" if warnings else "ok"
    if odd or implausible(arm.spec):
        conclusion = "valid, but not plausible: see the warning"
    screen = console()
    if not json:
        screen.print(facts(rows))
    for text in warnings:
        warn(text)
    if not json:
        screen.print(conclusion)
        return
    summary = {
        "flexarm": package_version(),
        "file": str(file),
        "changes": [f"--set {text}" for text in sets or ()],
        "summary": [{"name": name, "text": text} for name, text in rows],
        "warnings": warnings,
        "conclusion": conclusion,
    }
    print(dumps(summary, indent=2))


def _content(document: Document, folder: Path) -> tuple[fa.Arm, Rows, list[str], list[str]]:
    """Return the arm of a file, rows about the rest, unstable loops, and implausible numbers."""
    from flexarm.arm.arm import described_arm
    from flexarm.cases.scenario.scenario import prepare
    from flexarm.cases.scenario.study import PreparedStudy
    from flexarm.cases.scenario.summary import about_run
    from flexarm.model import load_arm_spec, locate_scenario, locate_study
    from flexarm.model.file_format.files import describes_arm_only
    from flexarm.model.plausible import implausible, warn_of

    if "records" in document.value:
        from flexarm.identification.identify import PreparedIdentification

        identification = PreparedIdentification(document, folder)
        identification.check()
        arm = identification.arm
        return arm, [*_about_records(identification), *_about_vibration(arm)], [], []
    if "drives" in document.value:
        located = locate_study(document)
        study = PreparedStudy(*located)
        arm = study.arm
        warn_of(implausible(arm.spec))
        unstable = [f"{name}: {text}" for name, text in study.unstable_loops().items()]
        return arm, [*_about_study(*located), *_about_vibration(arm)], unstable, []
    if describes_arm_only(document):
        arm = described_arm(load_arm_spec(document))
        integrator = [] if arm.closure_rows else _about_integrator(arm)
        return arm, [*_about_vibration(arm), *integrator], [], []
    scenario, where = locate_scenario(document)
    prepared = prepare(scenario, where)
    odd = prepared.implausible()
    warn_of(odd)
    loop = prepared.stability()
    rows = [*about_run(scenario), *_about_prepared(prepared, loop.poles)]
    return prepared.arm, rows, [loop.text, loop.slow], odd


def _about_records(identification: PreparedIdentification) -> Rows:
    rows = [("free", ", ".join(parameter.path for parameter in identification.study.free))]
    for kind in ("records", "validation"):
        for name, record in getattr(identification, kind).items():
            channels = ", ".join(label.text for label in record.outputs)
            text = f"{record.duration:g} s at {record.rate:g} Hz, {record.input}; {channels}"
            rows.append((f"{kind}: {name}", text))
    return rows


def _about_study(study: StudySpec, where: Where) -> Rows:
    from flexarm.cases.studies.samples import Samples

    names = (("drives", study.drives), ("plants", study.plants), ("motions", study.motions))
    rows = [(kind, ", ".join(list(items))) for kind, items in names]
    samples = Samples(study, where).count
    runs = samples * len(study.drives) * len(study.plants) * len(study.motions)
    if study.samples is not None:
        varied = ", ".join(study.vary) or "noise"
        rows.append(("samples", f"{samples}, {study.samples.method}: {varied}"))
    return [*rows, ("runs", f"{runs} of {study.run.duration:g} s")]


def _about_prepared(prepared: Prepared, poles: Sequence[LoopPole]) -> Rows:
    arm, options = prepared.arm, prepared.options
    angles = arm.joint_angles(options["initial"])
    if arm.closure_rows:
        rows = _about_closed(arm, options["initial"])
    else:
        rows = _about_vibration(arm, angles, prepared.sample_time)
    rows += _about_integrator(arm, options)
    if prepared.sample_time is not None:
        missing = "not analysed: the controller or an instrument does not permit it"
        worst = max((pole.growth for pole in poles if not pole.passing), default=0.0)
        shown = [pole for pole in poles if not pole.passing or pole.growth > max(worst, 0.0)]
        rows.append(("loop", "; ".join(map(_pole, shown)) or missing))
    return rows


def _about_closed(arm: fa.Arm, q: FloatArray) -> Rows:
    """Return the frequencies of a closed mechanism at the start q (dof,) with joints that move."""
    try:
        frequencies = fa.modes(arm, q=q, joints="free").frequency_hz
    except FlexarmError as error:
        return [("frequencies", f"not computed: {error}")]
    listed = ", ".join(f"{frequency:.4g}" for frequency in frequencies[:_MOST_FREQUENCIES])
    return [("frequencies", f"{listed} Hz with the joints free, at the start")]


def _about_vibration(
    arm: fa.Arm, angles: FloatArray | None = None, sample_time: float | None = None
) -> Rows:
    """Return the frequencies with locked joints at ``angles``, rad, and suitable sample times."""
    from flexarm.control.analysis.margins import (
        PHASE,
        controlled_modes,
        recommended_sample_time,
    )

    if arm.closure_rows:
        return [("frequencies", "depend on the posture that closes the loops: check a scenario")]
    frequencies = fa.modes(arm, angles).frequency_hz
    frequencies = frequencies[frequencies > 0.0]
    if not frequencies.size:
        return []
    where = "at joint angles of zero" if angles is None else "at the start"
    listed = ", ".join(f"{frequency:.4g}" for frequency in frequencies[:_MOST_FREQUENCIES])
    rows = [("frequencies", f"{listed} Hz with the joints locked, {where}")]
    longest = recommended_sample_time(arm, angles)
    if longest is not None:
        text = f"{1e3 * longest:g} ms or less for a controller: {2.0 * pi / PHASE:.0f} samples "
        text += f"in a period of mode {controlled_modes(arm, frequencies)}"
        if sample_time is not None:
            text += f"; this one has {1e3 * sample_time:g} ms"
        rows.append(("sample time", text))
    refused = {"branches", "closures"}.intersection(arm.spec.features)
    if any(link.flexible for link in arm.spec.links) and not refused:
        rows.append(("mesh", "fa.converged(arm, duration) finds the modes that a run needs"))
    return rows


def _about_integrator(arm: fa.Arm, options: Mapping[str, Any] | None = None) -> Rows:
    """Return the integrator of a run with these arguments of ``simulate``, and the reason."""
    # Without arguments, it is that of an arm which moves freely for one second.
    from flexarm.simulation.calls.preparation import integrator_of

    arguments = dict(options or {"duration": 1.0})
    requested, step = arguments.get("integrator", "auto"), arguments.get("step")
    recommended = integrator_of(arm, **{**arguments, "integrator": "auto", "step": None})
    text = f"{recommended.integrator.name} is recommended: {recommended.reason}"
    if requested == "auto" and step is None:
        return [("integrator", text)]
    used = integrator_of(arm, **arguments)
    reason = f" ({used.reason})" if requested == "auto" else ""
    return [("integrator", f"{used.integrator.name}{reason}; {text}")]


def _pole(pole: LoopPole) -> str:
    """Describe the sampled loop at the start or at the end of a motion."""
    if pole.growth == 0.0:
        return f"neutral {pole.when}: a pole at {pole.frequency:.3g} Hz neither grows nor decays"
    grows = pole.growth > 0.0
    time = log(10.0) / abs(pole.growth)
    changes = f"the {'fastest' if grows else 'slowest'} pole, at {pole.frequency:.3g} Hz,"
    changes += f" {'grows' if grows else 'decays'} tenfold in {time:.2g} s"
    return f"{'unstable' if grows else 'stable'} {pole.when}: {changes}"
