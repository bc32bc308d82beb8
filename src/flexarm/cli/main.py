"""The command line; each command is declared in a file of `flexarm.cli.commands`.

A command imports its libraries when it is called. This keeps ``flexarm --help`` fast, because
NumPy, Numba and the other libraries take a second to load.
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flexarm.base.errors import nearest
from flexarm.cli.commands.check import check
from flexarm.cli.commands.compare import compare
from flexarm.cli.commands.design import design
from flexarm.cli.commands.export import export
from flexarm.cli.commands.identify import identify
from flexarm.cli.commands.init import init
from flexarm.cli.commands.linearize import linearize
from flexarm.cli.commands.modes import modes
from flexarm.cli.commands.paper import paper
from flexarm.cli.commands.report import report
from flexarm.cli.commands.run import run
from flexarm.cli.commands.schema import schema
from flexarm.cli.commands.studio import studio
from flexarm.cli.commands.sweep import sweep
from flexarm.cli.commands.warmup import warmup
from flexarm.cli.failures import checked_streams, end_orderly_when_terminated, report_failures


class _Commands(TyperGroup):
    """The commands, whose error for an unknown one suggests the most similar one."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and arguments, or end with an error."""
        if self.get_command(ctx, args[0]) is None:
            near = nearest(args[0], self.list_commands(ctx))
            ctx.fail(f"No such command {args[0]!r}. {near}".strip())
        return super().resolve_command(ctx, args)


app = typer.Typer(
    name="flexarm",
    cls=_Commands,
    help="Planar manipulators with flexible links: model and simulate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _command in (
    *(paper, warmup, init, run, check, compare, design, sweep),
    *(identify, modes, linearize, report, studio, schema),
):
    app.command()(report_failures(_command))
app.add_typer(export, name="export")


def _show_version(requested: bool) -> None:
    if requested:
        from flexarm.base.references import package_version

        typer.echo(f"flexarm {package_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_show_version),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line.

    The exit status is 0, 1 (a run failed), 2 (wrong input, or output that cannot be written),
    130 (Ctrl-C) or 143 (SIGTERM).
    """
    end_orderly_when_terminated()
    with checked_streams():
        app()
