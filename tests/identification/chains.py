"""Records of benches with one link, simulated here: friction laws and gaps of a gear.

The link is a chain of rigid bars on torsional springs with dampers, as in ``data.bench_records``,
in absolute angles: its equations, its steps and its laws of friction are not those of flexarm. A
record of ``tests/data`` changes by the difference of two chains: of many bars, it is more accurate
than they are.
"""

import numpy as np
from numba import njit

from data.bench_records import GAUGE, RATE, Bench, interpolated

#: Bars of the link, steps per sample, and part of the hub's inertia that is the motor's.
_BARS, _STEPS, _MOTOR = 8, 200, 0.4
#: Rate (rad/s) below which friction is smooth, and vibration of a gear with a gap (rad/s), so
#: stiff that the gap is all that a record shows.
_SMOOTH, _STIFF = 0.01, 2000.0


@njit
def _acceleration(angle, rate, torque, lever, inertia, bend, damp, drive, gear):
    """Return the accelerations of the motor and of the bars (bars + 1,)."""
    viscous, coulomb, negative, static, stribeck, smooth = drive
    motor, gap, stiffness, damping = gear
    count = angle.size - 1
    forces = np.zeros(count + 1)
    sign = np.tanh(rate[0] / smooth)
    level = 0.5 * (coulomb * (1.0 + sign) + negative * (1.0 - sign))
    level += static * np.exp(-((rate[0] / stribeck) ** 2))
    applied = torque - viscous * rate[0] - level * sign
    mass = np.zeros((count, count))
    for i in range(count):
        for j in range(count):
            difference = angle[i + 1] - angle[j + 1]
            mass[i, j] = lever[i, j] * np.cos(difference)
            forces[i + 1] -= lever[i, j] * np.sin(difference) * rate[j + 1] ** 2
        mass[i, i] += inertia[i]
    for k in range(1, count):
        moment = bend * (angle[k + 1] - angle[k]) + damp * (rate[k + 1] - rate[k])
        forces[k] += moment
        forces[k + 1] -= moment
    result = np.empty(count + 1)
    if gap < 0.0:  # the motor is fixed to the first bar
        mass[0, 0] += motor
        forces[1] += applied
        result[1:] = np.linalg.solve(mass, forces[1:])
        result[0] = result[1]
        return result
    twist = angle[0] - angle[1]
    moment = 0.0
    if abs(twist) > 0.5 * gap:
        moment = stiffness * (twist - np.sign(twist) * 0.5 * gap) + damping * (rate[0] - rate[1])
    forces[1] += moment
    result[0] = (applied - moment) / motor
    result[1:] = np.linalg.solve(mass, forces[1:])
    return result


@njit
def _run(torque, steps, step, lever, inertia, bend, damp, drive, gear):
    """Return angles (samples, bars + 1) of the motor and the bars, by Runge and Kutta."""
    samples, size = torque.size, inertia.size + 1
    rows = np.zeros((samples, size))
    angle, rate = np.zeros(size), np.zeros(size)
    model = (lever, inertia, bend, damp, drive, gear)
    for k in range(samples - 1):
        for _ in range(steps):
            a1 = _acceleration(angle, rate, torque[k], *model)
            r2 = rate + 0.5 * step * a1
            a2 = _acceleration(angle + 0.5 * step * rate, r2, torque[k], *model)
            r3 = rate + 0.5 * step * a2
            a3 = _acceleration(angle + 0.5 * step * r2, r3, torque[k], *model)
            r4 = rate + step * a3
            a4 = _acceleration(angle + step * r3, r4, torque[k], *model)
            angle = angle + step / 6.0 * (rate + 2.0 * r2 + 2.0 * r3 + r4)
            rate = rate + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        rows[k + 1] = angle
    return rows


def simulated(
    bench: Bench,
    torque: np.ndarray,
    coulomb: tuple[float, float] = (0.0, 0.0),
    static: float = 0.0,
    stribeck: float = 0.1,
    backlash: float | None = None,
    bars: int = _BARS,
) -> np.ndarray:
    """Return joint angle and strain (samples, 2) for torques (samples,) that are held, N m.

    ``coulomb`` is the friction at positive and at negative rates, ``static`` that which joins it at
    rest and decays over the rate ``stribeck`` (rad/s). With ``backlash`` (rad) a stiff gear is
    between the motor and the link.
    """
    piece = bench.lengths[0] / bars
    lengths = np.full(bars + 1, piece)
    lengths[[0, -1]] = 0.5 * piece
    masses = np.append(bench.mass_per_length[0] * lengths, bench.payload)
    inertia = masses[:-1] * lengths**2 / 12.0
    reach = np.tril(np.tile(lengths, (bars + 2, 1)), -1)  # of each angle for each mass
    reach[np.arange(bars + 1), np.arange(bars + 1)] = 0.5 * lengths
    lever = reach.T @ (masses[:, None] * reach)
    motor = _MOTOR * bench.hub_inertia[0]
    hub = bench.hub_inertia[0] - motor
    inertia[0] += hub
    bend = bench.rigidity[0] / piece
    moved = motor * hub / bench.hub_inertia[0]
    gear = motor, -1.0 if backlash is None else backlash, moved * _STIFF**2, 1.4 * moved * _STIFF
    drive = bench.joint_damping[0], *coulomb, static, stribeck, _SMOOTH
    step = 1.0 / (RATE * _STEPS)
    damp = bench.damping[0] * bend
    angles = _run(torque, _STEPS, step, lever, inertia, bend, damp, drive, gear)
    curvature = np.diff(angles[:, 1:], axis=1) / piece
    centres = (np.arange(bars) + 0.5) * piece
    strain = -GAUGE * interpolated(centres, curvature, bench.station[0])
    return np.stack([angles[:, 0], strain], axis=1)


def change_of(bench: Bench, torque: np.ndarray, **effects: object) -> np.ndarray:
    """Return the change of joint angle and strain by effects, the arguments of ``simulated``."""
    return simulated(bench, torque, **effects) - simulated(bench, torque)
