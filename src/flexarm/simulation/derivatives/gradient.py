"""Gradient of a scalar goal of a run: ``flexarm.goal_gradient``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Never

from numpy.typing import ArrayLike

from flexarm.arm.actions.environment import BaseAcceleration
from flexarm.arm.arm import Arm
from flexarm.arm.observe import channels_of
from flexarm.base.arguments import check_flag, check_kind, check_mapping
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    warn_caller,
)
from flexarm.integrate import Integrator
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.model import Contact, Load
from flexarm.simulation.calls.preparation import RunOptions, run_options
from flexarm.simulation.calls.result import coordinates_of
from flexarm.simulation.calls.second_run import relative_error, second_run
from flexarm.simulation.derivatives.adjoint import Gradient, goal_gradient_of
from flexarm.simulation.derivatives.preparation import check_channels, refuse_unsupported, simulated
from flexarm.simulation.run.new_run import RTOL
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.work.open_loop import Checkpoints

if TYPE_CHECKING:
    import xarray as xr


@public_call
def goal_gradient(
    arm: Arm,
    duration: float,
    weights: Mapping[str, ArrayLike],
    *,
    torque: ArrayLike,
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
    atol: float | None = None,
    torque_interpolation: str = "cubic",
    breaks: ArrayLike = (),
    error_estimate: bool = True,
    progress: bool | None = None,
    **unsupported: Never,
) -> xr.Dataset:
    """Compute the gradient of a goal with respect to all torque samples and the initial state.

    Its cost does not depend on the number of samples. The steps end at every torque sample and are
    constant, as in ``sensitivities``.

    Args:
        arm: the arm.
        duration: s, positive.
        weights: for each channel in the goal, the derivatives of the goal by its samples, with the
            shape of the channel in the result of ``simulate``. Channels that follow from q and qd
            are possible.
        torque: samples (samples, joints), N m.
        error_estimate: whether a run that meets a contact or a joint stop is repeated at a second
            tolerance, as in ``sensitivities``. The attribute ``relative_error`` is the largest
            difference of both gradients by ``torque``, relative to the largest entry.

    The other arguments are those of ``simulate``.

    Returns:
        Dataset with the gradient by ``torque`` over ``sample`` and ``joint``, per N m, and by
        ``initial`` and ``initial_rate`` over ``coordinate``.

    Raises:
        InputError: if an argument has the wrong type or value, or the integrator is not an explicit
            Runge-Kutta method or ``kennedy_carpenter_5``.
        SimulationError: if the run stops early, or a function of time raises an exception.

    Warns:
        AccuracyWarning: under the conditions of ``simulate``, or if the estimated error exceeds
            1e-2 (with a given step: 1e-3).

    Theory page "separation", (D.17).
    """
    refuse_unsupported(unsupported)
    check_kind("arm", arm, Arm)
    refuse_bristles(arm, "the gradient", hint="fa.sensitivities supports them.")
    check_mapping("weights", weights, "channels and arrays")
    names = check_channels(arm, "weights", list(weights))
    if not names:
        raise InputError(Problem("weights", "must not be empty"))
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
    torque = check_array("torque", torque, (-1, arm.joints))
    given = {
        "torque": torque,
        "initial": initial,
        "initial_rate": initial_rate,
        "tip_force": tip_force,
        "loads": loads,
        "base_acceleration": base_acceleration,
        "contacts": contacts,
    }
    check_flag("error_estimate", error_estimate)
    with Meter("differentiating", progress) as meter:

        def differentiated(options: RunOptions, once: bool = False) -> tuple[Run, Gradient]:
            checkpoints = Checkpoints.among(len(options.times))
            known = simulated(arm, options, given, True, meter, checkpoints, once=once)
            channels = channels_of(arm, known.run.samples, names)
            arrays = {
                name: check_array(f"weights[{name!r}]", weights[name], channels[name].shape)
                for name in names
            }
            assert known.samples is not None
            return known.run, goal_gradient_of(known, known.samples, arrays)

        run, found = differentiated(options)
        doubt, attributes = run.doubt, {}
        second = second_run(run, options) if error_estimate else None
        if second is not None:
            other = differentiated(second.options, once=True)
            error = relative_error(found.torque, other[1].torque)
            attributes["relative_error"] = error
            run, found = other if second.tighter else (run, found)
            doubt = doubt or second.doubt(error)
    if doubt:
        warn_caller(doubt, AccuracyWarning)
    import xarray as xr

    own = coordinates_of(arm, run.sample_times)
    return xr.Dataset(
        {
            "torque": (("sample", "joint"), found.torque),
            "initial": ("coordinate", found.state[0]),
            "initial_rate": ("coordinate", found.state[1]),
        },
        coords={name: own[name] for name in ("joint", "coordinate")},
        attrs={"integrator": run.integrator.name, "steps": run.progress.steps, **attributes},
    )
