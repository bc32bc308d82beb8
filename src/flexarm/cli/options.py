"""Options that several commands have, with their help."""

from __future__ import annotations

from typing import Annotated

import typer

Angles = Annotated[
    str | None,
    typer.Option(
        metavar='"A,B,..."', help="Joint angles of the equilibrium, rad; zero by default."
    ),
]
Inputs = Annotated[
    str, typer.Option(metavar='"A,B,..."', help="Inputs, such as torque, tip_force.")
]
Outputs = Annotated[
    str, typer.Option(metavar='"A,B,..."', help="Outputs, such as joint_angle, tip, strain.")
]
Parameters = Annotated[
    list[str] | None,
    typer.Option(
        "--parameter",
        metavar="PATH",
        help="A number that becomes an argument, such as payload.mass; repeatable.",
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Change a value of the file, such as arm.links[0].length=1.2; repeatable.",
    ),
]
