"""Derivatives of the outputs of a record with respect to free parameters."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Case, Space, initial_argument
from flexarm.integrate.base import FloatArray
from flexarm.simulation.derivatives.sensitivities import sensitivities

#: Step of central differences, as a fraction of the scale of a parameter: the error of the
#: difference, which grows with its square, stays below that of the runs divided by it.
_STEP = 1e-4
#: Fewest numbers by which ``sensitivities`` is faster than differences in a closed loop.
_FEWEST_IN_LOOP = 3
#: Numbers that determine the torque of a current or voltage.
_OF_MOTORS = re.compile(r"motors\.|joints\[\d+\]\.(winding|gear_ratio)")
#: Numbers of the arm that only outputs depend on.
_OF_OUTPUTS = re.compile(r"links\[\d+\]\.gauges\[")
_DISTANCE = re.compile(r"links\[(\d+)\]\.gauges\[(\d+)\]\.distance")
_REFUSED = re.compile(r"parameters\[(\d+)\]")


def output_derivatives(
    run: RecordRun, space: Space, record: int, vector: FloatArray, places: NDArray[np.intp]
) -> FloatArray | str:
    """Return the derivatives of the outputs, or the reason why the run at ``vector`` fails.

    Args:
        record: index of the record of ``run`` in ``space``.
        places: of the numbers to differentiate by in ``vector``.

    Returns:
        (samples, channels, places) per unit of each number: those of ``sensitivities`` where it
        supports the run and the number, else central differences.
    """
    derivatives = np.zeros((run.times.size, len(run.labels), len(places)))
    exact = _exact_places(run, space, places)
    try:
        exact = _by_duals(run, space.case(record, vector), space, places, exact, derivatives)
    except FlexarmError as error:
        return str(error)
    others = [k for k in range(len(places)) if k not in exact]
    if not others:
        return derivatives
    return _by_differences(run, space, record, vector, places, others, derivatives)


def _exact_places(run: RecordRun, space: Space, places: NDArray[np.intp]) -> list[int]:
    """Return the indices of the places by which ``sensitivities`` may differentiate."""
    if not run.differentiable:
        return []
    if run.record.controller is not None and len(places) < _FEWEST_IN_LOOP:
        return []
    paths = [space.slots[place].path for place in places]
    driven = run.record.input in ("current", "voltage")
    return [
        k
        for k, path in enumerate(paths)
        if not (driven and _OF_MOTORS.match(path)) and not _OF_OUTPUTS.match(path)
    ]


def _by_duals(
    run: RecordRun,
    case: Case,
    space: Space,
    places: NDArray[np.intp],
    exact: Sequence[int],
    derivatives: FloatArray,
) -> list[int]:
    """Fill the derivatives that ``sensitivities`` supports; return their indices in ``places``.

    Raises:
        InputError: if the case is not possible.
        SimulationError: if its run fails.
    """
    exact = list(exact)
    while exact:
        paths = [space.slots[places[k]].path for k in exact]
        paths = [initial_argument(path) or path for path in paths]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FlexarmWarning)
                # Without a second run: derivatives better than the runs are not needed.
                found = sensitivities(
                    Arm(case.spec),
                    parameters=paths,
                    error_estimate=False,
                    progress=False,
                    **run.arguments(case),
                )
        except InputError as error:
            refused = [_REFUSED.match(problem.name) for problem in error.problems]
            wrong = {int(match[1]) for match in refused if match}
            if not wrong:
                if run.record.controller is None:
                    raise
                return []  # a loop that is not differentiable, such as one that rounds
            exact = [k for j, k in enumerate(exact) if j not in wrong]
            continue
        channels = {name: np.moveaxis(found[name].values, 0, -1) for name in run.channels}
        derivatives[..., exact] = run.changes(channels)
        return exact
    return []


def _by_differences(
    run: RecordRun,
    space: Space,
    record: int,
    vector: FloatArray,
    places: NDArray[np.intp],
    chosen: Sequence[int],
    derivatives: FloatArray,
) -> FloatArray | str:
    """Fill the derivatives by central differences, or return why the run at ``vector`` fails.

    They are one-sided at a bound, or where one of both runs fails, and zero where both fail, so
    that no step goes in that direction.
    """
    lower, upper = space.bounds
    cases: list[Case] = [space.case(record, vector)]
    steps: list[tuple[int, float]] = []
    readings = {k: _column_of(run, space.slots[places[k]].path) for k in chosen}
    for k in chosen:
        place = places[k]
        if readings[k] is not None and vector[place] != 0.0:
            continue
        for sign in (1.0, -1.0):
            moved = vector.copy()
            moved[place] += sign * _STEP * space.scale[place]
            moved[place] = min(max(moved[place], lower[place]), upper[place])
            change = moved[place] - vector[place]
            if change == 0.0:
                continue
            try:
                cases.append(space.case(record, moved))
            except InputError:  # a limit of several numbers together
                continue
            steps.append((k, change))
    center, *others = run.simulate(cases)
    if isinstance(center, str):
        return center
    for k in chosen:
        column, value = readings[k], vector[places[k]]
        if column is not None and value != 0.0:
            # A strain is proportional to the distance of its gauge.
            derivatives[:, column, k] = center[:, column] / value
            continue
        ends = [
            (change, outputs)
            for (j, change), outputs in zip(steps, others, strict=True)
            if j == k and not isinstance(outputs, str)
        ]
        if len(ends) == 1:
            ends.append((0.0, center))
        if ends:
            (high, after), (low, before) = ends
            derivatives[..., k] = (after - before) / (high - low)
    return derivatives


def _column_of(run: RecordRun, path: str) -> int | None:
    """Return the index of the output that is proportional to the number at a path, or None."""
    match = _DISTANCE.fullmatch(path)
    if match is None or not run.proportional:
        return None
    text = f"strain_{run.gauge_number(int(match[1]), int(match[2]))}"
    return next((k for k, label in enumerate(run.labels) if label.text == text), None)
