"""HTML of a report, from a Jinja template."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from flexarm.arm.arm import Arm
from flexarm.base.arguments import library_missing
from flexarm.base.errors import printable
from flexarm.base.references import citation
from flexarm.cases.scenario.summary import about_arm, about_run
from flexarm.simulation.calls.compare import warnings_of
from flexarm.simulation.calls.result import package_version
from flexarm.view.plot.animation.page import style
from flexarm.view.plot.drawn_arm import scenario_of
from flexarm.view.plot.selection import Signals
from flexarm.view.reporting.measures import (
    energies_table,
    errors_table,
    extremes_table,
    key_figures,
    run_facts,
)

if TYPE_CHECKING:
    import xarray as xr

#: Longest file that is shown in full, and longest link to save one, characters. Tables of torques
#: may take megabytes.
_MOST_TEXT, _MOST_LINK = 100_000, 200_000


def template_engine() -> Any:
    """Return the Jinja environment with the templates of reports.

    Raises:
        InputError: if Jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError:
        raise library_missing("Jinja2", "report") from None
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(text_of),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


@cache
def text_of(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def render(
    engine: Any,
    result: xr.Dataset,
    arm: Arm,
    reference: Any,
    histories: Sequence[Signals],
    title: str,
    notes: str,
    player: str,
    magnify: float,
) -> str:
    """Return the page of a report.

    Args:
        engine: from `template_engine`.
        reference: motion to compute errors from, or None.
        histories: of the tables, with all samples.
        player: HTML fragment that plays the arm, with its bending drawn ``magnify`` times as large.
    """
    scenario = scenario_of(result)
    tables = [energies_table(result)] if "kinetic_energy" in result else []
    if reference is not None:
        tables.insert(0, errors_table(result, arm, reference))
    page: str = engine.get_template("report.html").render(
        title=clean(title),
        notes=clean(notes.strip()),
        style=style() + text_of("report.css"),
        failure=clean(str(result.attrs.get("failure", ""))),
        warnings=[clean(text) for text in warnings_of(result)],
        player=player,
        magnify=magnify,
        figures=key_figures(result, arm, reference),
        about=[*about_arm(arm), *(about_run(scenario) if scenario else [])],
        run=run_facts(result),
        tables=[extremes_table(each for each in histories if each.name != "energy"), *tables],
        files=[file_item(*each) for each in _model_files(result, arm)],
        scenario=scenario is not None,
        version=str(result.attrs.get("flexarm_version", "")),
        software=str(result.attrs.get("software", "")),
        writer=package_version(),
        citation=file_item("citation.bib", citation(result)),
    )
    return page


def _model_files(result: xr.Dataset, arm: Arm) -> list[tuple[str, str]]:
    """Return names and texts of the files in a result: the scenario, and the arm if it differs."""
    scenario, text = scenario_of(result), result.attrs.get("scenario")
    found = [("scenario.yaml", str(text))] if text else []
    if scenario is None or scenario.arm != arm.spec:
        found.append(("arm.yaml", str(result.attrs["arm"])))
    return found


def file_item(name: str, text: str) -> dict[str, str]:
    """Return name, shown text and link of a file."""
    shown, link = text, f"data:text/plain;charset=utf-8,{quote(text[:_MOST_LINK])}"
    if len(text) > _MOST_TEXT:
        more = len(text) - _MOST_TEXT
        shown = f"{text[:_MOST_TEXT]}\n... ({more} more characters, in the result)"
    if max(len(text), len(link)) > _MOST_LINK:
        link = ""
    return {"name": name, "text": clean(shown), "link": link}


def clean(text: str) -> str:
    """Return text without control characters, line by line."""
    return "\n".join(map(printable, text.split("\n")))
