"""`realtime`: a plant and a controller against the clock, in one process or in two."""

from __future__ import annotations

import gc
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import (
    check_count,
    check_flag,
    check_kind,
    check_mapping,
    check_positive,
)
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.control.contract.base import (
    Controller,
    ControllerRequirements,
    Reference,
    check_controller,
    check_reference,
    requirements_of,
)
from flexarm.model import Link
from flexarm.simulation.calls.plant import Plant
from flexarm.simulation.loop.control_loop import sampled_reference
from flexarm.simulation.real_time.loops import ControllerLoop, PlantLoop
from flexarm.simulation.real_time.packets import (
    REFERENCE,
    Layout,
    SentReference,
    check_address,
    reference_values,
)
from flexarm.simulation.real_time.partners import Clock, OwnController, Partner, UdpController

if TYPE_CHECKING:
    import xarray as xr

#: Difference of two times, relative to them, that is rounding.
_ROUNDING = 1e-9
#: Distance of two joint angles (rad) at which a controller starts with a jump.
_FAR = 0.01
#: Largest number of values of a reading.
_LARGEST = 1000


@public_call
def realtime(
    plant: Plant | str,
    controller: Controller | str,
    duration: float | None = None,
    reference: Reference | None = None,
    *,
    readings: Mapping[str, int] | None = None,
    clock: bool = True,
    answer_within: float | None = None,
    timeout: float = 5.0,
) -> xr.Dataset:
    """Run a plant or a controller against the clock, also with the other one in another process.

    An address, ``"127.0.0.1:5005"``, in place of the plant or of the controller, is that at which
    the controller listens for UDP packets. Both processes give the same one.

    Args:
        plant: the plant, at time zero, in its own state: a warning reports a reference that starts
            at other joint angles; or the address at which this process, the controller,
            listens.
        controller: the controller; or the address at which it listens.
        duration: s, rounded to whole samples. The plant determines the end of a run.
        reference: motion that the controller follows. A plant sends its values to another process;
            without ``reference``, a controller uses those that it receives.
        readings: names and sizes of the values in the packets of a plant in another process, such
            as ``{"joint_angle": 2, "joint_rate": 2}``.
        clock: whether each sample of the plant waits for its time. Without the clock (lockstep),
            the plant waits for the controller only, and sends packets again until they are
            answered: the result is that of ``simulate``, whatever the delays and losses.
        answer_within: time (s) from the start of a sample in which an answer over UDP is expected;
            at most the sample time, half of it by default. After it, the last torque is held, and
            the answer is discarded.
        timeout: s, without an answer, or without a packet, after which the run fails. The first
            sample waits so long for the controller to start; then the clock starts.

    Returns:
        Result with one sample per sample time. ``sample_late``, ``sample_answer`` and
        ``sample_busy`` (tick) are its times on the clock, s; the attribute ``timing`` is a table of
        their percentiles. A plant starts its clock with the first answer, so the first value of
        ``sample_answer`` is NaN. ``missed_deadlines`` counts the samples that were not ready at the
        next sample time, ``torques_held`` those without an answer in time. A plant that is late
        does not skip samples: it catches up. Over UDP, ``packets_repeated`` counts the packets that
        the plant sent again, or that the controller answered again; ``packets_discarded`` the
        answers with another number or time than the sample, or the packets that reached the
        controller after a newer one; ``packets_lost``, of the controller only, the samples without
        a packet before that of a later one; ``packets_foreign`` the packets of other programs and
        of earlier runs, which are ignored.

    Raises:
        InputError: if an argument has the wrong kind or value, the sample times differ, or the
            controller needs a reading that the plant, or ``readings``, does not have.
        SimulationError: if the plant or the controller fails, the other process ends the run or is
            silent, or a packet has the wrong length. ``result`` is the result so far.

    Packets are rows of little-endian doubles: token, sequence number, time (s), values. The plant
    sends its readings, then the angles, rates and accelerations of the reference; the controller
    answers with the same token, number and time, and the torques (N m). The number -1 ends the run.
    The plant requests a run with the number -2 and a random token; the controller answers with the
    same token and number, and in place of the time with the token of the run, also random.
    """
    timeout = check_positive("timeout", timeout, "s")
    paced = check_flag("clock", clock)
    if reference is not None:
        check_reference(reference)
    if isinstance(plant, str):
        loop = _controller_loop(plant, controller, duration, reference, readings, timeout)
        with _without_collection(paced):
            return loop.run()
    check_kind("plant", plant, Plant, "a Plant or an address such as '127.0.0.1:5005'")
    if readings is not None:
        rule = "is only for a controller whose plant is in another process"
        raise InputError(Problem("readings", rule))
    h = plant.sample_time
    samples = _samples(plant, duration)
    within = (
        0.5 * h if answer_within is None else check_positive("answer_within", answer_within, "s")
    )
    if within > h:
        rule = f"be at most the sample time ({h:g} s)"
        raise InputError(Problem("answer_within", rule, shown(answer_within)))
    if answer_within is not None and not paced:
        raise InputError(Problem("answer_within", "cannot be combined with clock=False"))
    now = Clock()
    motion = sampled_reference(reference, h, samples * h)
    if motion is not None:
        _warn_of_another_start(plant, motion)
    partner = _partner(plant, controller, motion, now)
    sent = motion if isinstance(controller, str) else None
    with _without_collection(paced):
        return PlantLoop(plant, partner, sent, now, paced, within, timeout).run(samples)


def _warn_of_another_start(plant: Plant, reference: Reference) -> None:
    """Warn if the reference starts at other joint angles than the plant, which keeps its state."""
    own, wanted = plant.q[plant.arm.joint_index], np.asarray(reference.joint_angle(0.0))
    if wanted.shape == own.shape and np.abs(wanted - own).max() > _FAR:
        angles = np.array2string(wanted, separator=", ", precision=4)
        warn_caller(
            f"realtime: the reference starts {np.abs(wanted - own).max():.3g} rad from the joint "
            "angles of the plant, and the controller jumps there; "
            f"plant.reset(arm.rest({angles})) starts the plant with the motion",
            FlexarmWarning,
        )


def _samples(plant: Plant, duration: float | None) -> int:
    """Return the number of samples of a plant at time zero."""
    if plant.time != 0.0:
        hint = "Call plant.reset(initial) first."
        raise InputError(Problem("plant", "be at time zero", f"{plant.time:.6g} s", hint))
    if duration is None:
        raise InputError(Problem("duration", "is required with a plant"))
    given = check_positive("duration", duration, "s")
    h = plant.sample_time
    samples = check_count("duration / plant.sample_time", round(given / h), 1, 10**8)
    if samples * h > plant.duration * (1.0 + _ROUNDING):
        rule = f"be at most that of the plant ({plant.duration:g} s)"
        raise InputError(Problem("duration", rule, shown(duration)))
    return samples


def _partner(
    plant: Plant, controller: Controller | str, reference: Reference | None, clock: Clock
) -> Partner:
    """Return the controller of a plant."""
    joints = plant.arm.joints
    shapes = {name: values.shape for name, values in plant.measurement.items()}
    if isinstance(controller, str):
        motion = dict.fromkeys(REFERENCE, (joints,)) if reference is not None else {}
        address = check_address("controller", controller)
        for name, values in reference_values(reference, 0.0).items():
            check_array(f"reference.{REFERENCE[name]}(0.0)", values, (joints,))
        return UdpController(address, Layout(shapes | motion), joints, clock)
    check_controller("controller", controller)
    needed = requirements_of(controller, plant.arm, reference)
    problems = _missing("plant", "measure", controller, needed, shapes)
    h = plant.sample_time
    if abs(controller.sample_time - h) > _ROUNDING * h:
        rule = f"equal that of the plant ({h:g} s)"
        problems.append(Problem("controller.sample_time", rule, shown(controller.sample_time)))
    if needed.joints not in (None, joints):
        problems.append(Problem("controller", f"be for {joints} joints", shown(needed.joints)))
    if problems:
        raise InputError(*problems)
    return OwnController(controller, reference, joints)


def _missing(
    place: str,
    verb: str,
    controller: Controller,
    needed: ControllerRequirements,
    names: Collection[str],
) -> list[Problem]:
    """Return a problem for each required reading that is not among names."""
    kind = type(controller).__name__
    lacking = [name for name in needed.measured if name not in names]
    return [Problem(place, f"does not {verb} {name}, which {kind} reads") for name in lacking]


def _controller_loop(
    plant: str,
    controller: Controller | str,
    duration: float | None,
    reference: Reference | None,
    readings: Mapping[str, int] | None,
    timeout: float,
) -> ControllerLoop:
    """Return the loop of a controller whose plant is in another process."""
    address = check_address("plant", plant)
    if isinstance(controller, str):
        raise InputError(Problem("plant and controller", "are both addresses"))
    check_controller("controller", controller)
    check_positive("controller.sample_time", controller.sample_time)
    if duration is not None:
        raise InputError(Problem("duration", "is determined by the plant in the other process"))
    if readings is None:
        hint = "Such as readings={'joint_angle': 2, 'joint_rate': 2}, in the order of the packet."
        rule = "is required for a plant in another process"
        raise InputError(Problem("readings", rule, hint=hint))
    sizes = {
        str(name): (check_count(f"readings[{name!r}]", size, 0, _LARGEST),)
        for name, size in check_mapping("readings", readings, "names and sizes").items()
    }
    sent = [name for name in REFERENCE if name in sizes]
    if reference is None and len(sent) == len(REFERENCE):
        reference = SentReference(*sizes[sent[0]])
    needed = requirements_of(controller, _arm_of(controller, sizes), reference)
    problems = _missing("readings", "contain", controller, needed, sizes)
    if 0 < len(sent) < len(REFERENCE):
        rule = f"contain all of {', '.join(REFERENCE)}, or none"
        problems.append(Problem("readings", rule, ", ".join(sent)))
    if problems:
        raise InputError(*problems)
    return ControllerLoop(controller, address, Layout(sizes), reference, Clock(), timeout)


def _arm_of(controller: Controller, sizes: Mapping[str, tuple[int]]) -> Arm:
    """Return the arm of a controller, or one of rigid links if it has none.

    Requirements are stated for an arm, and only the other process has that of the plant.
    """
    arm = getattr(controller, "arm", None)
    if isinstance(arm, Arm):
        return arm
    link = Link(length=1.0, flexible=False, mass_per_length=1.0)
    return Arm(links=[link] * max(1, sizes.get("joint_angle", (1,))[0]))


@contextmanager
def _without_collection(paced: bool) -> Iterator[None]:
    """Suspend the garbage collection, which takes milliseconds, while the clock runs."""
    enabled = gc.isenabled()
    if paced:
        gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
