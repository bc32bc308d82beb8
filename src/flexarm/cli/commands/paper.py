"""``flexarm paper``: compute the paper's example, draw its figures, print a table of results."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.console import Console, Group, RenderableType

import flexarm as fa
from flexarm.base.processes import process_pool, usable_cores
from flexarm.cli.options import flag, option
from flexarm.cli.tables import console, numbers, print_line

if TYPE_CHECKING:
    from flexarm.view.paper import PaperCase
    from flexarm.view.plot.paper.paper_data import Histories


_MOST_PROCESSES = 2  # more would not speed up the figures of the paper


def load_plotting() -> None:
    """Import the modules for drawing."""
    import flexarm.cases.results
    import flexarm.view.plot.paper.paper_figures  # noqa: F401


def draw_figures(names: Sequence[str], case: Histories, folder: Path) -> None:
    """Save figures of the paper as PNG and PDF; also accepts "overview" and "theories"."""
    from flexarm.cases.results import write_figure
    from flexarm.view.plot.paper.paper_figures import FIGURES

    for name in names:
        figure = FIGURES[name](case)
        for suffix in (".png", ".pdf"):
            write_figure(figure, folder / f"{name}{suffix}")


@contextmanager
def drawing() -> Iterator[Callable[..., None]]:
    """Provide a function like `draw_figures`, in other processes if possible, and wait for it."""
    try:
        pool = process_pool(_MOST_PROCESSES, load_plotting) if usable_cores() > 1 else None
    except (OSError, NotImplementedError, ImportError):  # no semaphores on this system
        pool = None
    if pool is None:
        yield draw_figures
        return
    tasks: list[tuple[Future[None], tuple[Any, ...]]] = []
    try:
        yield lambda *arguments: tasks.append((pool.submit(draw_figures, *arguments), arguments))
        for future, arguments in tasks:
            try:
                future.result()
            except BrokenProcessPool:
                draw_figures(*arguments)
    finally:
        pool.shutdown(cancel_futures=True)


#: Number of single figures that a process draws in one task.
_AT_ONCE = 4
_ROWS = {
    "peak": "peak deflection",
    "residual": "residual vibration",
    "theory": "linear less second order",
}
_NOTES = """\
The arm and its mesh are the paper's. Path, timing and torques are our choice,
because the paper shows them only as pictures: compare shapes, not values.

peak deflection: of the link's tip from its root tangent, during the motion
residual vibration: amplitude of that deflection after the torques have ended
linear less second order: largest difference of the deflection between the
  paper's theory and the second-order theory, during the motion
tip error: distance of the flexible arm's tip from the rigid arm's
"""


def paper(
    out: Annotated[Path, option("DIR", "Folder for figures and data.")] = Path("flexarm-paper"),
    report: Annotated[
        bool, flag("--report", "Also write report.html: animation, all numbers.")
    ] = False,
) -> None:
    """Reproduce the paper: its arm, its figures 3 to 16, and a table of numbers."""
    from importlib.resources import files

    from flexarm.base.writing.places import check_folder, write_text

    check_folder("--out", out)
    if report:
        from flexarm.view.reporting import template_engine

        template_engine()
    with drawing() as draw:
        # Import here, because the other processes load Matplotlib at the same time.
        from flexarm.view.paper import FAST, SLOW, PaperCase, histories
        from flexarm.view.plot.paper.paper_data import FIGURE_NAMES

        slow, fast = PaperCase(SLOW), PaperCase(FAST)
        shown = histories(slow)
        # The overview takes as long as seven single figures. Small tasks after it keep both
        # processes busy to the end.
        draw(["overview"], shown, out)
        for k in range(0, len(FIGURE_NAMES), _AT_ONCE):
            draw(FIGURE_NAMES[k : k + _AT_ONCE], shown, out)
        compared = histories(fast, ("flexible", "rigid", "second_order"))
        draw(["theories"], compared, out)
        text = Group(*_report(slow, fast))
        console().print(text)
        fa.write_result(slow.flexible, out / "result.nc")
        fa.write_result(slow.rigid, out / "result_rigid.nc")
        write_text(_as_text(text), out / "numbers.txt")
        arm = (files("flexarm") / "library" / "paper.yaml").read_text(encoding="utf-8")
        write_text(arm, out / "paper.yaml")
        if report:
            title, notes = "The paper's arm along a line", _as_text(text)
            place = out / "report.html"
            fa.report(slow.flexible, place, title=title, notes=notes, rigid=slow.rigid)
    print_line(f"figures, data and numbers in {out}")


def _report(slow: PaperCase, fast: PaperCase) -> Iterator[RenderableType]:
    yield numbers(
        "The paper's arm, tip sent from (2, 1) to (1, 2) m",
        ("", f"in {slow.duration:g} s", f"in {fast.duration:g} s"),
        _comparison(slow, fast),
    )
    yield _NOTES
    from flexarm.view.paper import FINE_ELEMENTS, frequency_tables

    tables = frequency_tables(slow)
    fine = f"{FINE_ELEMENTS} + {FINE_ELEMENTS}"
    heads = ["mode", *(f"{table.joints}, {mesh}" for table in tables for mesh in ("2 + 1", fine))]
    columns = [column for table in tables for column in (table.paper_mesh, table.fine_mesh)]
    rows = [
        (str(mode), *(f"{value:.3f}" for value in row))
        for mode, row in enumerate(zip(*columns, strict=True), start=1)
    ]
    title = "Natural frequencies at the start [Hz]"
    yield numbers(title, heads, rows)
    yield "locked, free: the joints. 2 + 1 are the paper's elements."


def _comparison(slow: PaperCase, fast: PaperCase) -> Iterator[tuple[str, ...]]:
    from flexarm.view.paper import link_numbers, tip_numbers, torque_range

    cases = (slow, fast)
    for k, pair in enumerate(zip(*map(torque_range, cases), strict=True), start=1):
        low_high = [f"{low:.2f} to {high:.2f}" for low, high in pair]
        yield f"joint {k}: torque [N m]", low_high[0], low_high[1]
    for k, links in enumerate(zip(*map(link_numbers, cases), strict=True), start=1):
        for name, meaning in _ROWS.items():
            a, b = (_millimetres(getattr(link, name)) for link in links)
            yield f"link {k}: {meaning} [mm]", a, b
    tips = [tip_numbers(case) for case in cases]
    yield "largest tip error [mm]", *(_millimetres(tip.largest) for tip in tips)
    yield "tip error at the end [mm]", *(_millimetres(tip.at_end) for tip in tips)


def _millimetres(metres: float) -> str:
    return f"{1e3 * metres:.2f}"


def _as_text(report: Group) -> str:
    text = StringIO()
    Console(file=text, width=80, highlight=False, markup=False).print(report)
    return text.getvalue()
