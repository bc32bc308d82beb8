"""Commands of the command line with options and help; each command imports its own modules.

This keeps ``flexarm --help`` fast, because NumPy, Numba and the other libraries take a second to
load.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flexarm.cli.design import design
from flexarm.cli.export import export
from flexarm.cli.failures import end_orderly_when_terminated, report_failures
from flexarm.cli.options import Angles, Inputs, Outputs, Sets
from flexarm.cli.standard_streams import checked_streams

app = typer.Typer(
    name="flexarm",
    help="Planar manipulators with flexible links: model and simulate.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(export, name="export")


class Joints(StrEnum):
    """State of the joints while the arm vibrates."""

    LOCKED = "locked"
    FREE = "free"


class Kind(StrEnum):
    """Kinds of files."""

    SCENARIO = "scenario"
    ARM = "arm"
    STUDY = "study"


def _show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"flexarm {version('flexarm')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_show_version),
    ] = False,
) -> None:
    pass


@app.command()
@report_failures
def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for figures and data.")] = Path(
        "flexarm-paper"
    ),
    report: Annotated[
        bool, typer.Option("--report", help="Also write report.html: animation, all numbers.")
    ] = False,
) -> None:
    """Reproduce the paper: its arm, its figures 3 to 16, and a table of numbers."""
    from flexarm.cli.commands.paper import reproduce

    reproduce(out, report)


@app.command()
@report_failures
def warmup() -> None:
    """Compile everything now, so that no later run waits; needed once on a machine."""
    from flexarm.cli.commands.warmup import compile_everything

    compile_everything()


@app.command()
@report_failures
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="[FOLDER]", help="Output folder; created if missing.")
    ] = Path(),
    links: Annotated[int, typer.Option(min=1, max=8, help="Number of links.")] = 2,
    gravity: Annotated[
        bool, typer.Option("--gravity", help="The arm moves in a vertical plane.")
    ] = False,
) -> None:
    """Write a commented arm and scenario to start from: arm.yaml and scenario.yaml."""
    from flexarm.cli.commands.init import write_starting_files

    write_starting_files(folder, links, gravity)


@app.command()
@report_failures
def run(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO.yaml", help="Scenario file.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the result: .nc (all of it) or .csv.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save a plot: .png, .pdf or .svg.")
    ] = None,
    animate: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save an animation: .mp4, .gif or .html.")
    ] = None,
    sets: Sets = None,
    duration: Annotated[
        str | None, typer.Option(metavar="SECONDS", help="Duration in place of that of the file.")
    ] = None,
    integrator: Annotated[
        str | None, typer.Option(metavar="NAME", help="Integrator in place of that of the file.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the summary as JSON, and nothing else.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print warnings and errors only.")] = False,
) -> None:
    """Simulate a scenario file."""
    from flexarm.cli.commands.run import run_file, run_options

    files = (out, plot, animate)
    options = run_options(files, sets or [], duration, integrator, json=json, quiet=quiet)
    run_file(scenario, options)


@app.command()
@report_failures
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Arm, scenario or study.")],
    sets: Sets = None,
) -> None:
    """Check an arm, scenario or study file and report every problem with its line."""
    from flexarm.cli.commands.check import check_file

    check_file(file, sets or ())


@app.command()
@report_failures
def compare(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml", help="Drives, plants and motions to compare.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the numbers: .nc or .csv.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save a plot: .png, .pdf or .svg.")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Processes; by default one for each core."),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--limit",
            metavar="NAME=VALUE",
            help="A run of random plants above it counts as failed; repeatable.",
        ),
    ] = None,
) -> None:
    """Compare drives on plants along motions: errors, vibration, torque, computing time."""
    from flexarm.cli.commands.compare import compare_file

    compare_file(study, out, plot, workers, limits or ())


app.command()(design)


@app.command()
@report_failures
def sweep(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml", help="A study with varied numbers.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the results; by default STUDY.zarr."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the results if they exist.")
    ] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Repeat ten samples and compare all digits.")
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster: tcp://HOST:8786."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Processes here; by default one for each core."),
    ] = None,
    chunk: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Samples of a task; measured by default."),
    ] = None,
    limits: Annotated[
        list[str] | None,
        typer.Option(
            "--limit",
            metavar="NAME=VALUE",
            help="A run above it counts as failed: tip_error_peak=0.01; repeatable.",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save a plot: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """Run a study for many samples of uncertain numbers: quantiles and failure rates."""
    from flexarm.cli.commands.sweep import SweepOptions, sweep_file

    where = (out, plot, scheduler, workers, chunk)
    sweep_file(study, SweepOptions(*where, limits or (), resume, verify))


@app.command()
@report_failures
def identify(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml", help="Arm, records and free parameters.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the arm with its estimates: .yaml.")
    ] = None,
    result: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the result for `report`: .nc.")
    ] = None,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="Do not print the fit after each evaluation.")
    ] = False,
) -> None:
    """Estimate parameters of an arm from measured records."""
    from flexarm.cli.commands.identify import identify_file

    identify_file(study, out, result, quiet)


@app.command()
@report_failures
def modes(
    arm: Annotated[Path, typer.Argument(metavar="ARM.yaml", help="Arm or scenario.")],
    joints: Annotated[
        Joints | None,
        typer.Option(help="Condition of the joints; locked by default."),
    ] = None,
    angles: Annotated[
        str | None,
        typer.Option(metavar='"A,B,..."', help="Relative joint angles, rad; zero by default."),
    ] = None,
    proportional: Annotated[
        str | None,
        typer.Option(metavar='"A,B,..."', help="Proportional gains at the joints, N m/rad."),
    ] = None,
    derivative: Annotated[
        str | None,
        typer.Option(metavar='"A,B,..."', help="Derivative gains at the joints, N m s/rad."),
    ] = None,
    sag: Annotated[
        bool, typer.Option("--sag", help="Modes about the equilibrium under gravity.")
    ] = False,
    spin: Annotated[
        float, typer.Option(metavar="RATE", help="Spin of the whole arm about its base, rad/s.")
    ] = 0.0,
    to: Annotated[
        str | None,
        typer.Option(metavar='"A,B,..."', help="Track the modes from --angles to these, rad."),
    ] = None,
    campbell: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Track the modes from --spin to this spin, rad/s."),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Number of modes.")] = 6,
    sets: Sets = None,
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the modes as a table: .csv.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save a plot: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """Show natural frequencies and damping of an arm at rest, or along postures or spins."""
    from flexarm.cli.commands.modes import ModesOptions, show_modes

    held = (None if joints is None else joints.value, angles, proportional, derivative)
    show_modes(arm, ModesOptions(*held, sag, spin, to, campbell, count, csv, plot, sets or ()))


@app.command()
@report_failures
def linearize(
    arm: Annotated[Path, typer.Argument(metavar="ARM.yaml", help="Arm or scenario.")],
    angles: Angles = None,
    inputs: Inputs = "torque",
    outputs: Outputs = "joint_angle,tip",
    count: Annotated[int, typer.Option(min=1, help="Number of poles to print.")] = 8,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the model: .mat or .json.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the responses: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """Compute a linear model of an arm at rest: A, B, C, D and their poles."""
    from flexarm.cli.commands.linearize import show_linear

    show_linear(arm, angles, inputs, outputs, count, out, plot)


@app.command()
@report_failures
def report(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT.nc", help="Result of `flexarm run` or `identify`.")
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The .html file; default: beside it.")
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Title; by default the name of the file.")
    ] = None,
    magnify: Annotated[
        float,
        typer.Option(
            metavar="FACTOR", min=0, max=10_000, help="Factor on the drawn bending of the links."
        ),
    ] = 1.0,
    rigid: Annotated[
        bool, typer.Option("--rigid", help="Also draw the rigid arm at the same joint angles.")
    ] = False,
) -> None:
    """Write a report of a run or an identification: one HTML page with all numbers."""
    from flexarm.cli.commands.report import report_file

    report_file(result, out, title, magnify, rigid)


@app.command()
@report_failures
def studio(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="[FILE]", help="Arm, scenario or study; by default the paper's arm."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address of this machine to listen on.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8550,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open a browser window.")
    ] = True,
) -> None:
    """Change an arm and its run in the browser and see it move: a local web application."""
    from flexarm.cli.commands.studio import open_studio

    open_studio(file, host, port, browser)


@app.command()
@report_failures
def schema(
    kind: Annotated[Kind, typer.Option(help="Kind of file.")] = Kind.SCENARIO,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Save the schema: .json.")
    ] = None,
) -> None:
    """Print the JSON schema of files, from which editors complete and check."""
    from flexarm.cli.commands.schema import print_schema

    print_schema(kind.value, out)


def main() -> None:
    """Run the command line.

    The exit status is 0, 1 (a run failed), 2 (wrong input, or output that cannot be written),
    130 (Ctrl-C) or 143 (SIGTERM).
    """
    end_orderly_when_terminated()
    with checked_streams():
        app()
