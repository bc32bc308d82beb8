"""Derivatives of a run with respect to parameters: ``flexarm.sensitivities``."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Never

import numpy as np
from numpy.typing import ArrayLike

from flexarm.actions.environment import BaseAcceleration
from flexarm.arguments import check_kind, check_list_of
from flexarm.arm import Arm
from flexarm.control.base import Controller, Reference
from flexarm.engine.channels import CHANNELS
from flexarm.engine.new_run import ATOL, RTOL
from flexarm.engine.progress import Meter
from flexarm.engine.stepping import Run
from flexarm.errors import AccuracyWarning, InputError, Problem, public_call, warn_caller
from flexarm.histories.prescribed import Prescribed
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.kernels.compilation.duals import DIRECTIONS
from flexarm.model import Contact, Hardware, Load
from flexarm.processes import usable_cores
from flexarm.run_derivatives.channels import channel_derivatives
from flexarm.run_derivatives.dual_run import run_in_duals
from flexarm.run_derivatives.inputs import Inputs
from flexarm.run_derivatives.loop_in_duals import loop_in_duals
from flexarm.run_derivatives.parameters import Parameters, has_samples
from flexarm.run_derivatives.preparation import check_channels, refuse_unsupported, simulated
from flexarm.simulation.preparation import Torque, run_options
from flexarm.simulation.result import coordinates_of

if TYPE_CHECKING:
    import xarray as xr


@public_call
def sensitivities(
    arm: Arm,
    duration: float,
    parameters: Sequence[str],
    *,
    channels: Sequence[str] | None = None,
    torque: Torque | None = None,
    controller: Controller | None = None,
    reference: Reference | None = None,
    hardware: Hardware | None = None,
    prescribed: Prescribed | None = None,
    initial: ArrayLike | None = None,
    initial_rate: ArrayLike | None = None,
    tip_force: ArrayLike | None = None,
    loads: Sequence[Load] = (),
    base_acceleration: BaseAcceleration | None = None,
    contacts: Sequence[Contact] = (),
    integrator: str | Integrator = "auto",
    rate: float = 1000.0,
    step: float | None = None,
    rtol: float = RTOL,
    atol: float = ATOL,
    torque_interpolation: str = "cubic",
    breaks: ArrayLike = (),
    progress: bool | None = None,
    **unsupported: Never,
) -> xr.Dataset:
    """Compute the derivatives of a run with respect to parameters, exact to rounding.

    They are the derivatives of the numbers that ``simulate`` computes, with the steps of the
    integrator constant.

    Args:
        arm: the arm.
        duration: s, positive.
        parameters: paths of numbers of the arm, ``links[0].flexural_rigidity``,
            ``joints[1].friction.coulomb``, ``payload.mass``; entries of the initial state,
            ``initial[0]`` (of q) and ``initial_rate[0]`` (of qd); and numbers of other arguments:
            ``torque[12][0]`` (sample, joint; both from 0), ``tip_force[1]``,
            ``loads[0].force[0]``, ``contacts[0].stiffness``.
        channels: names of channels that follow from the states; None: all of them.

    The other arguments are those of ``simulate``; ``arm`` is the simulated arm, and a controller
    has its own model. The updates of a controller are differentiated with respect to its readings
    and its ``memory``, which it must declare. Events, changes of the arm and section forces are not
    supported.

    Returns:
        Dataset with the derivatives of the channels over ``parameter`` and ``time``, in the unit of
        the channel per unit of the parameter.

    Raises:
        InputError: if an argument has the wrong type or value or is not supported, or a parameter
            does not exist or is not one on which the equations depend smoothly, or a controller is
            not differentiable, reads rounded signals or keeps undeclared numbers.
        SimulationError: if the run stops early, or a function of time raises an exception.

    Warns:
        AccuracyWarning: under the conditions of ``simulate``.

    Theory page "separation", section 7.
    """
    refuse_unsupported(unsupported)
    check_kind("arm", arm, Arm)
    paths = check_list_of("parameters", parameters, str)
    names = check_channels(arm, "channels", channels)
    if not paths:
        raise InputError(Problem("parameters", "must not be empty"))
    given = {
        "torque": torque,
        "controller": controller,
        "reference": reference,
        "hardware": hardware,
        "prescribed": prescribed,
        "initial": initial,
        "initial_rate": initial_rate,
        "tip_force": tip_force,
        "loads": loads,
        "base_acceleration": base_acceleration,
        "contacts": contacts,
    }
    options = run_options(
        duration,
        rate=rate,
        step=step,
        rtol=rtol,
        atol=atol,
        breaks=breaks,
        torque_interpolation=torque_interpolation,
        integrator=integrator,
        stations=0,
        specialized=None,
    )
    with Meter("differentiating", progress) as meter:
        known = simulated(arm, options, given, has_samples(paths), meter)
        found = _derivatives(known, paths, names)
    run = known.run
    if run.doubt:
        warn_caller(run.doubt, AccuracyWarning)
    return _dataset(run, paths, found)


def _derivatives(
    known: Parameters, paths: Sequence[str], names: Sequence[str]
) -> list[dict[str, FloatArray]]:
    """Return the derivatives of the channels by each parameter, eight at a time in each thread."""
    by = known.derivatives(paths)
    blocks = [by[k : k + DIRECTIONS] for k in range(0, len(by), DIRECTIONS)]

    def of_block(block: list[Inputs]) -> list[dict[str, FloatArray]]:
        numbers = known.run, known.inputs, block
        loop = known.loop
        found = run_in_duals(*numbers) if loop is None else loop_in_duals(*numbers, loop)
        return channel_derivatives(known.run.arm, found, len(block), names)

    threads = min(len(blocks), usable_cores())
    with ThreadPoolExecutor(threads) as pool:
        return [one for found in pool.map(of_block, blocks) for one in found]


def _dataset(run: Run, paths: Sequence[str], found: Sequence[dict[str, FloatArray]]) -> xr.Dataset:
    import xarray as xr

    variables = {}
    for name in found[0]:
        channel = CHANNELS[name]
        labels = {
            "units": f"{channel.unit} per unit of the parameter",
            "long_name": f"derivative of: {channel.meaning}",
        }
        values = np.stack([one[name] for one in found])
        variables[name] = (("parameter", "time", *channel.dims), values, labels)
    coordinates = coordinates_of(run.arm, run.sample_times) | {
        "parameter": ("parameter", list(paths), {"long_name": "path of the parameter"})
    }
    used = {"parameter", "time"}.union(*(variable[0] for variable in variables.values()))
    coordinates = {name: value for name, value in coordinates.items() if name in used}
    attributes = {"integrator": run.integrator.name, "steps": run.progress.steps}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)
