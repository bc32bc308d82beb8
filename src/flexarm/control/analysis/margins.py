"""Gain, phase, delay and disk margins of a sampled loop, and the sample time for an arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import IntArray
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import as_list, check_each, check_kind, check_list_of, check_numbers
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.base.late import xr
from flexarm.control.analysis.linear_controller import FrozenReference
from flexarm.control.analysis.sampled_loop import (
    ComplexArray,
    SampledLoop,
    instruments_of,
    loop_of,
    model_at,
    signals_of,
    sliding,
)
from flexarm.control.contract.base import (
    Controller,
    Reference,
    around,
    check_controller,
    check_reference,
    has_poles,
    requirements_of,
)
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear import modes
from flexarm.linear.models.state_space import CHANNEL_OUTPUTS
from flexarm.model import Contact, Hardware, Instrument

#: Number of frequencies up to the Nyquist frequency, and number around each pole.
_FREQUENCIES, _AROUND = 300, 15
#: Lowest frequency, relative to the Nyquist frequency.
_LOWEST = 1e-6
#: Most steps to a crossing, and the relative step at which it is found.
_STEPS, _CLOSE = 120, 1e-13
#: Largest growth in a sample time that rounding causes, as of integrators without effect.
ROUNDED_GROWTH = 1e-7
#: Number of poles in tables, one for each complex pair.
_POLES = 12
#: Gain factors below this are zero except for rounding: the loop is stable when it is open.
_SMALLEST = 1e-6

#: Name, unit, meaning, and function that returns the worst of several values.
_MARGINS: tuple[tuple[str, str, str, Callable[..., Any]], ...] = (
    ("gain_margin", "1", "largest factor on the loop gain", np.min),
    ("gain_reduction_margin", "1", "smallest factor on the loop gain", np.max),
    ("phase_margin", "rad", "phase margin", np.min),
    ("delay_margin", "s", "delay margin", np.min),
    ("disk_margin", "1", "symmetric disk margin", np.min),
)


def loop_at(
    controller: Controller,
    plant: Arm | None,
    posture: ArrayLike,
    hardware: Hardware | None = None,
    contacts: Sequence[Contact] = (),
    reference: Reference | None = None,
    t: float = 0.0,
) -> SampledLoop:
    """Return the linear sampled loop around an arm at rest in a posture (joints,) rad."""
    own = getattr(controller, "arm", None)
    own = own if isinstance(own, Arm) else None
    arm = plant if plant is not None else own
    assert isinstance(arm, Arm)
    still = FrozenReference(reference, t) if reference is not None else None
    instruments = instruments_of(arm, hardware, len(contacts))
    if hardware is None or hardware.instruments is None:
        names = [item.output for item in instruments]
        reads = requirements_of(controller, arm, still).measured
        more = [name for name in reads if name not in names]
        instruments += [Instrument(signal=name) for name in more if name in CHANNEL_OUTPUTS]
    signals = signals_of(instruments)
    rate, (arm, mine_of) = sliding(controller, reference, arm, own if own is not None else arm)
    actuated = next((law.actuated for law in around(controller) if hasattr(law, "actuated")), None)
    believed = None
    model = model_at(arm, posture, signals, contacts, actuated)
    if mine_of is not arm:
        believed = model_at(mine_of, posture, signals, contacts, actuated)
    stay = getattr(controller, "at_rest", None)
    mine = stay() if callable(stay) else controller
    return loop_of(mine, model, instruments, hardware, still, t, believed, rate)


@public_call
def loop_margins(
    controller: Controller,
    plants: Arm | Sequence[Arm] | Mapping[str, Arm] | None = None,
    postures: ArrayLike | None = None,
    *,
    hardware: Hardware | None = None,
    contacts: Sequence[Contact] = (),
    reference: Reference | None = None,
) -> xr.Dataset:
    """Return gain, phase, delay and disk margins of a sampled loop, at one motor at a time.

    The loop is linearised about the arm at rest and opened at the torque of one joint while the
    others stay closed. Sampling, zero-order hold, delays and filters are exact. Joints have viscous
    friction only, because dry friction linearised at rest is a damper that moving joints do not
    have. Faults of instruments belong to the loop if they are gains or frozen readings from the
    start of a run to its end; others do not.

    Args:
        controller: a controller with a ``step`` that can be linearised, as all built-in ones except
            `EstimatorController`, `NonlinearMPC`, `RBFAdaptive` and `RepetitiveControl`.
        plants: arms to combine with the controller, as a list or by name; None for the model of
            the controller.
        postures: (joints,) or (k, joints) rad; None for the postures of the design, or zeros if the
            controller has none. With a ``reference``, its times (k,) s instead; None for its start.
        hardware: instruments and motors; None for exact ones.
        contacts: surfaces; those in contact with the arm at rest belong to the loop, without
            friction.
        reference: motion that presses (`pressed_motion`), for the force controllers.

    Returns:
        Dataset over ``plant``, ``posture`` and ``joint``: ``gain_margin`` and
        ``gain_reduction_margin`` (the largest and the smallest factor on the torque at which the
        loop is stable), ``phase_margin`` (rad), ``delay_margin`` (s) and ``disk_margin`` alpha
        = 2 / max|S - T| for simultaneous changes of gain and phase: it guarantees at least factors
        (2 + alpha) / (2 - alpha) and its inverse, and 2 arctan(alpha / 2) rad. ``worst_...`` over
        ``joint`` is the worst case over plants and postures; ``growth`` (plant, posture), 1/s, is
        the largest real part of the poles. For an unstable loop gain margins are 1, the others 0.
        ``damping_ratio`` and ``pole_frequency`` (plant, posture, pole), Hz, are those of the twelve
        poles that decay slowest, one for each complex pair; NaN if there are fewer.

    Raises:
        InputError: if the controller has no ``step``, an instrument has its own
            ``sample_time``, or an argument has the wrong shape.
        EquilibriumError: if an arm has no equilibrium at a posture.

    Warns:
        LargeDeflectionWarning: if a link of an arm bends too far at rest, once for all arms.

    Seiler, Packard and Gahinet 2020 for the disk margin.
    """
    bare = checked_surroundings(hardware, contacts, reference)
    arms = plants_of(controller, plants)
    places = places_of(controller, next(iter(arms.values())), postures, reference)
    names, shape = list(arms), (len(arms), len(places), next(iter(arms.values())).n_joints)
    found = {name: np.zeros(shape) for name, *_ in _MARGINS}
    growth, damping = np.zeros(shape[:2]), np.full((2, *shape[:2], _POLES), np.nan)
    with one_warning():
        loops = [
            [loop_at(controller, arm, at, hardware, bare, reference, t) for t, at in places]
            for arm in arms.values()
        ]
    for i, row in enumerate(loops):
        for k, loop in enumerate(row):
            check_single_rate(loop)
            growth[i, k], damping[:, i, k] = stability_of(loop)
            margins = margins_at(loop, bool(growth[i, k] <= 0.0))
            for (name, *_), value in zip(_MARGINS, margins, strict=True):
                found[name][i, k] = value
    first = next(iter(arms.values()))
    table = xr.Dataset(coords={"plant": names, "joint": list(first.joint_numbers)})
    angles = np.array([posture for _, posture in places])
    table["posture_angle"] = (("posture", "joint"), angles, {"units": "rad"})
    for name, unit, meaning, worst in _MARGINS:
        labels = {"units": unit, "long_name": meaning}
        table[name] = (("plant", "posture", "joint"), found[name], labels)
        labels = {"units": unit, "long_name": f"{meaning}, worst case"}
        table[f"worst_{name}"] = ("joint", worst(found[name], axis=(0, 1)), labels)
    labels = {"units": "1/s", "long_name": "largest real part of the poles"}
    table["growth"] = (("plant", "posture"), growth, labels)
    by_pole = ("plant", "posture", "pole")
    labels = {"units": "Hz", "long_name": "natural frequency of the pole"}
    table["pole_frequency"] = (by_pole, damping[0], labels)
    labels = {"units": "1", "long_name": "damping ratio of the pole"}
    table["damping_ratio"] = (by_pole, damping[1], labels)
    return table


def stability_of(loop: SampledLoop) -> tuple[float, FloatArray]:
    """Return the growth, and frequencies (Hz) and damping ratios (2, _POLES) of the slowest poles.

    Growth (1/s) is zero if rounding may have caused it.
    """
    poles = loop.poles()
    growth = float(poles[0].real)
    growth = growth if not 0.0 < growth * loop.sample_time < ROUNDED_GROWTH else 0.0
    each = poles[poles.imag >= 0.0][:_POLES]
    size = np.abs(each)
    found = np.full((2, _POLES), np.nan)
    found[0, : each.size] = size / (2.0 * np.pi)
    found[1, : each.size] = -each.real / np.maximum(size, 1e-300)
    return growth, found


def without_friction(contacts: Sequence[Contact]) -> list[Contact]:
    """Return contacts without friction, whose linearisation at rest is a strong damper."""
    return [contact.replace(friction=0.0) for contact in contacts]


def check_single_rate(loop: SampledLoop) -> None:
    """Raise if an instrument of a loop has its own sample time, which makes the loop periodic."""
    if len(loop.plant.A) > 1:
        rule = "has instruments with their own sample_time, which is not supported"
        raise InputError(Problem("hardware", rule))


def checked_surroundings(
    hardware: Hardware | None, contacts: Sequence[Contact], reference: Reference | None
) -> Sequence[Contact]:
    """Validate arguments of a linearised loop, and return its contacts, without friction."""
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    contacts = check_list_of("contacts", contacts, Contact)
    if reference is not None:
        check_reference(reference)
    return without_friction(contacts)


def plants_of(
    controller: Controller,
    plants: Arm | Sequence[Arm] | Mapping[str, Arm] | None,
    name: str = "plants",
) -> dict[str, Arm]:
    """Return the arms by name, after checking them and the controller."""
    check_controller("controller", controller)
    if not has_poles(controller):
        rule = "has no step, which poles and margins need"
        raise InputError(Problem("controller", rule))
    own = getattr(controller, "arm", None)
    if plants is None and not isinstance(own, Arm):
        rule = "be given, because the controller has no arm"
        raise InputError(Problem(name, rule, "None"))
    named = named_arms(own if plants is None else plants)
    joints = [arm.n_joints for arm in named.values()]
    if len(set(joints)) > 1:
        raise InputError(Problem("plants", "be arms with the same number of joints", shown(plants)))
    if isinstance(own, Arm) and own.n_joints != joints[0]:
        rule = f"have the number of joints of the controller's arm ({own.n_joints})"
        raise InputError(Problem("plants", rule, shown(joints[0])))
    for name, arm in named.items():
        required = requirements_of(controller, arm, None)
        if required.joints not in (None, arm.n_joints):
            rule = f"is for {required.joints} joint(s), but the plant {name!r} has {arm.n_joints}"
            raise InputError(Problem("controller", rule))
        if "strain" in required.measured and required.gauges not in (None, len(arm.gauges)):
            rule = f"have {required.gauges} gauge(s), which {type(controller).__name__} reads"
            raise InputError(Problem(f"plant {name!r}", rule, str(len(arm.gauges))))
    return named


def named_arms(plants: object) -> dict[str, Arm]:
    """Return arms by name; arms without a name are numbered from 1."""
    if isinstance(plants, Mapping):
        named = {str(name): arm for name, arm in plants.items()}
    else:
        listed = [plants] if isinstance(plants, Arm) else as_list(plants) or []
        named = {str(k): arm for k, arm in enumerate(listed, start=1)}
    if not named or not all(isinstance(arm, Arm) for arm in named.values()):
        rule = "be an Arm, or a list or mapping of arms"
        raise InputError(Problem("plants", rule, shown(plants)))
    return named


def places_of(
    controller: Controller,
    arm: Arm,
    postures: ArrayLike | None,
    reference: Reference | None,
    name: str = "postures",
) -> list[tuple[float, FloatArray]]:
    """Return the times (s) of the reference and the postures (joints,) of the linearisations."""
    if reference is not None:
        given = getattr(reference, "start_time", 0.0) if postures is None else postures
        times = np.atleast_1d(check_each(f"{name}, with a reference its times (s),", given))
        if not times.size:
            raise InputError(Problem(name, "are empty"))
        return [(float(t), np.asarray(reference.joint_angle(float(t)))) for t in times]
    if postures is None:
        designs = getattr(controller, "designs", ())
        listed = [item.posture for item in designs] or [np.zeros(arm.n_joints)]
        return [(0.0, posture) for posture in listed]
    angles = check_numbers(name, postures, "be numbers of shape (any, joints)")
    if not angles.size:
        raise InputError(Problem(name, "are empty"))
    angles = angles[None] if angles.ndim == 1 else angles
    checked = check_array(name, angles, (-1, arm.n_joints))
    return [(0.0, posture) for posture in checked]


def place_of(
    controller: Controller,
    arm: Arm,
    posture: ArrayLike | None,
    reference: Reference | None = None,
    rule: str = "be one posture",
) -> tuple[float, FloatArray]:
    """Return the time and the posture of one linearisation, by default the first of the design."""
    places = places_of(controller, arm, posture, reference, "posture")
    if posture is not None and len(places) > 1:
        raise InputError(Problem("posture", rule, f"{len(places)} of them"))
    return places[0]


def margins_at(loop: SampledLoop, stable: bool = True) -> list[FloatArray]:
    """Return the margins, (joints,) each, in the order of ``_MARGINS``."""
    joints = loop.plant.B.shape[1]
    if not stable:
        return [np.ones(joints), np.ones(joints), *np.zeros((3, joints))]
    angles = frequency_grid(loop)
    S = _at(loop, angles)
    L = 1.0 / S - 1.0

    def returned(at: FloatArray, joint: IntArray) -> ComplexArray:
        return np.asarray(1.0 / _at(loop, at)[np.arange(at.size), joint] - 1.0)

    def function(at: FloatArray, column: IntArray) -> FloatArray:
        value = returned(at, column % joints)
        return np.where(column < joints, value.imag, np.abs(value) - 1.0)

    at, column = _crossings(angles, np.hstack([L.imag, np.abs(L) - 1.0]), function)
    values = returned(at, column % joints)
    largest = _largest(loop, angles, np.abs(2.0 * S - 1.0))
    every = [
        _of_joint(L[:, k], values[column == k].real, at[later], values[later], loop.sample_time)
        for k in range(joints)
        for later in [column == joints + k]
    ]
    return [*map(np.array, zip(*every, strict=True)), 2.0 / largest]


def _at(loop: SampledLoop, angles: FloatArray) -> ComplexArray:
    """Return the sensitivity (f, joints) of each joint at angles (f,) in rad per sample."""
    return np.diagonal(loop.sensitivity(np.exp(1j * angles)), axis1=1, axis2=2)


def _of_joint(
    L: ComplexArray, real: FloatArray, at: FloatArray, values: ComplexArray, sample_time: float
) -> tuple[float, float, float, float]:
    """Return the margins of the loop opened at one joint, without the disk margin.

    ``L`` is its return ratio at all frequencies, and ``real`` the same where it is real; ``at`` are
    the frequencies (rad per sample) where its size is one, with the ratio there in ``values``.
    """
    real = np.append(real, L[[0, -1]].real)
    real[-2] = real[-2] if abs(L[0].imag) < 1e-3 * abs(L[0].real) else 0.0
    factors = -1.0 / real[real < 0.0]
    more, less = factors[factors > 1.0], factors[(factors < 1.0) & (factors > _SMALLEST)]
    phase = np.angle(-values)
    lag = np.where(phase > 0.0, phase, phase + 2.0 * np.pi)
    gains = float(more.min(initial=np.inf)), float(less.max(initial=0.0))
    delay = float((lag / np.maximum(at, 1e-300)).min(initial=np.inf)) * sample_time
    return *gains, float(np.abs(phase).min(initial=np.pi)), delay


def _largest(loop: SampledLoop, angles: FloatArray, size: FloatArray) -> FloatArray:
    """Return the largest |S - T| (joints,), refined on a finer grid around the largest samples."""
    k, joints = np.argmax(size, axis=0), range(size.shape[1])
    ends = angles[np.maximum(k - 1, 0)], angles[np.minimum(k + 1, len(angles) - 1)]
    between = np.linspace(*ends, 101)
    closer = np.abs(2.0 * _at(loop, between.ravel()) - 1.0).reshape(101, -1, size.shape[1])
    return np.array([max(size[k[j], j], closer[:, j, j].max()) for j in joints])


def _crossings(
    at: FloatArray, values: FloatArray, function: Callable[[FloatArray, IntArray], FloatArray]
) -> tuple[FloatArray, IntArray]:
    """Return the sign changes of functions between the points ``at`` (f,), and their columns.

    ``values`` (f, columns) are those of the functions at the points. By the Illinois method (Dowell
    and Jarratt 1971), and every third step by bisection, because a secant approaches a pole slowly.
    """
    rising, column = np.nonzero(values[:-1] * values[1:] < 0.0)
    before, last = at[rising], at[rising + 1]
    old, new = values[rising, column], values[rising + 1, column]
    todo = np.arange(rising.size)
    for step in range(_STEPS):
        if not todo.size:
            break
        low, high, f_low, f_high = before[todo], last[todo], old[todo], new[todo]
        share = f_high / (f_high - f_low) if step % 3 < 2 else 0.5
        place = high - share * (high - low)
        value = function(place, column[todo])
        crossed = value * f_high < 0.0
        before[todo] = np.where(crossed, high, low)
        old[todo] = np.where(crossed, f_high, 0.5 * f_low)
        last[todo], new[todo] = place, value
        apart = np.minimum(np.abs(place - high), np.abs(place - before[todo]))
        todo = todo[(value != 0.0) & (apart > _CLOSE * place)]
    return last, column


def frequency_grid(loop: SampledLoop) -> FloatArray:
    """Return frequencies (f,) in rad per sample, with a dense grid around every pole."""
    everywhere = np.pi * np.geomspace(_LOWEST, 1.0, _FREQUENCIES)
    z = np.concatenate([loop.multipliers(), np.linalg.eigvals(loop.plant.A[0])])
    pole = np.log(z[(np.abs(z) > 1e-3) & (z.imag >= 0.0)])
    width = np.maximum(np.abs(pole.real), 1e-7)
    spread = np.tan(np.linspace(-1.5, 1.5, _AROUND))
    near = (np.abs(pole.imag)[:, None] + width[:, None] * spread).ravel()
    near = near[(near > everywhere[0]) & (near < np.pi)]
    return np.unique(np.concatenate([everywhere, near]))


#: Phase (rad) by which the fastest mode to control turns in a sample: the middle of 0.1 to 0.6, the
#: range of K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., Prentice Hall
#: 1997, for the poles of a sampled loop.
PHASE = 0.2


def recommended_sample_time(arm: Arm, angles: FloatArray | None = None) -> float | None:
    """Return the longest sample time (s) that suits one mode for each joint; None without modes."""
    found = modes(arm, angles).frequency_hz
    found = found[found > 0.0]
    mode = controlled_modes(arm, found)
    if not mode:
        return None
    longest = PHASE / (2.0 * np.pi * found[mode - 1])
    unit = 10.0 ** (np.floor(np.log10(longest)) - 1.0)
    return float(f"{np.floor(longest / unit + 1e-9) * unit:.2g}")


def controlled_modes(arm: Arm, frequencies: FloatArray) -> int:
    """Return the number of modes that a controller damps: one for each joint, if it exists."""
    return min(arm.n_joints, frequencies.size)
