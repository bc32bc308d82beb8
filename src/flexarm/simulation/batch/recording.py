"""Dataset of a batch: the stored channels, reductions and outcomes of all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.events import FAILURE
from flexarm.simulation.batch.execution import Outcome
from flexarm.simulation.batch.reductions import Reduction, reduced
from flexarm.simulation.batch.variations import Variations
from flexarm.simulation.calls.limits import limit_variables
from flexarm.simulation.calls.result import coordinates_of
from flexarm.simulation.run.channels import CHANNELS, LIMITS

if TYPE_CHECKING:
    import xarray as xr

#: Texts and counts of each run, with their meanings; the texts are those of a single result.
TEXTS = {
    "ended_by": "duration, failure, or the event that ended the run",
    "failure": "why the run stopped early, or empty",
    "warning": "warnings of the run, or empty",
    "integrator": "method of the run",
}
COUNTS = {"steps": "accepted steps", "evaluations": "evaluations of the dynamics"}
_END_TIME = {"units": "s", "long_name": "time reached by the run"}
_RUN = {"long_name": "run, counted from 0"}
#: Names that reductions cannot have.
TAKEN = (
    *CHANNELS,
    *LIMITS,
    *TEXTS,
    *COUNTS,
    "end_time",
    "run",
    "time",
    "seed",
    "position",
    "station",
)


class Recorder:
    """Arrays of a batch. Threads may record different runs at the same time.

    Args:
        arm: the first arm, for the sizes of the channels.
        times: (samples,) s, sample times of a run that is complete.
        channels: names of the stored channels.
        reductions: by the names of their variables.
        stride: stride of the stored samples.
        counts: numbers of contacts, and of stations on each link.
        absent: channels that the runs do not have beyond those of an empty dimension, by name,
            with what is missing.

    Raises:
        InputError: if the runs do not have one of the channels.
    """

    def __init__(
        self,
        runs: int,
        arm: Arm,
        times: FloatArray,
        channels: Sequence[str],
        reductions: Mapping[str, Reduction],
        stride: int,
        counts: tuple[int, int],
        absent: Mapping[str, str],
    ) -> None:
        contacts, stations = counts
        self._arm, self._counts = arm, counts
        self._times, self._stride = times, stride
        self._reductions = reductions
        self._sizes = {
            "joint": arm.joints,
            "link": arm.links,
            "axis": 2,
            "coordinate": arm.dof,
            "gauge": len(arm.gauges),
            "contact": contacts,
            "station": stations,
        }
        needed = {f"reductions[{name!r}]": item.channels for name, item in reductions.items()}
        self._check({"channels": tuple(channels), **needed}, absent)
        stored = times[::stride].size
        self._channels = {
            name: np.full((runs, stored, *self._shape(CHANNELS[name].dims)), np.nan)
            for name in channels
        }
        self._reduced = {
            name: np.full((runs, *self._shape(item.dims)), np.nan)
            for name, item in reductions.items()
        }
        self.texts = {name: [""] * runs for name in TEXTS}
        self._numbers = {name: np.zeros(runs, dtype=np.int64) for name in COUNTS}
        self._end = np.zeros(runs)
        self._limits: dict[str, FloatArray] = {}
        self._lock = Lock()

    def _shape(self, dims: Sequence[str]) -> list[int]:
        return [self._sizes[dim] for dim in dims]

    def _check(self, own: Mapping[str, Sequence[str]], absent: Mapping[str, str]) -> None:
        """Raise if the runs do not have a channel, because of the arm or the arguments."""
        problems = []
        for argument, names in own.items():
            for name in names:
                empty = next((d for d in CHANNELS[name].dims if not self._sizes[d]), "")
                missing = absent.get(name, empty)
                if missing:
                    rule = f"has {name!r}, which the runs do not have: there is no {missing}"
                    problems.append(Problem(argument, rule))
        if problems:
            raise InputError(*problems)

    def record(self, outcome: Outcome) -> None:
        """Record the outcome of one or several runs."""
        times, runs = outcome.times, outcome.runs
        count = min(times.size, self._times.size)
        if count and times[count - 1] != self._times[count - 1]:
            count -= 1  # an event that ends the run is its last sample, between two others
        for name, stored in self._channels.items():
            if name in outcome.channels:
                kept = outcome.channels[name][:, : count : self._stride]
                stored[runs, : kept.shape[1]] = kept
        for name, numbers in outcome.limits.items():
            with self._lock:
                unknown = np.full((self._end.size, *numbers.shape[1:]), np.nan)
                self._limits.setdefault(name, unknown)[runs] = numbers
        for row, k in enumerate(runs):
            failure = outcome.failure
            if outcome.ended_by != FAILURE and self._reductions:
                failure = self._reduce(k, outcome, row)
            self.texts["ended_by"][k] = FAILURE if failure else outcome.ended_by
            self.texts["failure"][k] = failure
            self.texts["warning"][k] = outcome.warnings[row]
            self.texts["integrator"][k] = outcome.integrator
        self._numbers["steps"][runs] = outcome.steps
        self._numbers["evaluations"][runs] = outcome.evaluations
        self._end[runs] = outcome.end_time

    def _reduce(self, k: int, outcome: Outcome, row: int) -> str:
        """Compute the reductions of run k; return why one failed, or an empty text."""
        failure = ""
        channels = {name: values[row] for name, values in outcome.channels.items()}
        for name, item in self._reductions.items():
            try:
                self._reduced[name][k] = reduced(item, outcome.times, channels)
            except Exception as error:  # of a function of the user
                words = " ".join(str(error).split())
                text = f"The reduction {name!r} failed with {type(error).__name__}: {words}"
                failure = failure or text
        return failure

    def dataset(self, variations: Variations, attributes: dict[str, Any]) -> xr.Dataset:
        """Return the labelled dataset."""
        import xarray as xr

        variables: dict[str, Any] = {
            name: (
                ("run", "time", *CHANNELS[name].dims),
                values,
                {"units": CHANNELS[name].unit, "long_name": CHANNELS[name].meaning},
            )
            for name, values in self._channels.items()
        }
        for name, item in self._reductions.items():
            variables[name] = (("run", *item.dims), self._reduced[name], item.labels)
        limits = {name: self._limits[name] for name in LIMITS if name in self._limits}
        variables |= limit_variables(limits, ("run",))
        variables["end_time"] = ("run", self._end, _END_TIME)
        for name, meaning in COUNTS.items():
            variables[name] = ("run", self._numbers[name], {"long_name": meaning})
        for name, meaning in TEXTS.items():
            variables[name] = ("run", np.array(self.texts[name], dtype=str), {"long_name": meaning})
        used = {"run", "time"}.union(*(dims for dims, *_ in variables.values() if dims != "run"))
        return xr.Dataset(variables, self._coordinates(variations, used), attributes)

    def _coordinates(self, variations: Variations, used: set[str]) -> dict[str, Any]:
        contacts, stations = self._counts
        instruments = (variations.hardware and variations.hardware.instruments) or ()
        names = [item.label for item in instruments if item.limit < np.inf]
        label = {"long_name": "instrument with a limit"}
        found = coordinates_of(self._arm, self._times[:: self._stride], stations, contacts)
        found["instrument"] = ("instrument", names, label)
        if not variations.same_arm:
            found.pop("position", None)  # the lengths of the links may differ
        own: dict[str, Any] = {"run": ("run", np.arange(variations.count), _RUN)}
        for path, values in variations.parameters.items():
            own[path] = ("run", values, {"long_name": f"{path} of the simulated arm"})
        if variations.seeds is not None:
            own["seed"] = ("run", variations.seeds, {"long_name": "seed of the noise"})
        kept = {
            name: item
            for name, item in found.items()
            if used.issuperset([item[0]] if isinstance(item[0], str) else item[0])
        }
        return own | kept
