"""Identification of mechanisms from noisy records of their joints."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import flexarm as fa

#: Standard deviation of the encoders, rad, and samples a second.
NOISE, RATE = 1e-4, 200.0


def four_bar(coupler: float = 120.0, rocker: float = 0.7, damping: float = 0.05) -> fa.Arm:
    """Return a four-bar with the rigidity of its coupler, length of its rocker, crank damping."""
    bar = {
        "mass_per_length": 0.5,
        "elements": 2,
        "modes": 1,
        "damping": fa.ModalDamping(ratio=0.02),
    }
    links = [
        fa.Link(length=0.3, flexural_rigidity=200.0, **bar),
        fa.Link(length=0.9, flexural_rigidity=coupler, **bar),
        fa.Link(length=rocker, flexural_rigidity=200.0, parent=0, **bar),
    ]
    joints = [fa.Joint(hub_inertia=0.01, damping=damping), fa.Joint(), fa.Joint(offset=(1.0, 0.0))]
    return fa.Arm(links=links, joints=joints, closures=[fa.Closure(link=2, to_link=3)])


def record(arm: fa.Arm, start: np.ndarray, folder, samples: int = 101) -> fa.MeasuredRecord:
    """Return a record of the first joint's torque and of all joint angles, with noise."""
    rng = np.random.default_rng(0)
    torque = np.zeros((samples, arm.n_joints))
    torque[:, 0] = 1.0 + np.repeat(rng.choice([-1.5, 1.5], samples // 10 + 1), 10)[:samples]
    options = {"torque": torque, "torque_interpolation": "hold", "rate": RATE}
    run = fa.simulate(arm, (samples - 1) / RATE, initial=start, **options)
    table = {"time": run.time.values}
    for k in range(arm.n_joints):
        table[f"torque_{k + 1}"] = torque[:, k]
        noise = NOISE * rng.standard_normal(samples)
        table[f"joint_angle_{k + 1}"] = run.joint_angle.values[:, k] + noise
    path = folder / "record.csv"
    pd.DataFrame(table).to_csv(path, index=False)
    columns = {name: name for name in table if name != "time"}
    return fa.read_record(path, columns, interpolation="hold")


def test_a_four_bar_is_identified_with_a_length_that_closes_its_loop(tmp_path) -> None:
    true = four_bar()
    start = fa.assembled(true, true.rest([0.7, -0.4, 1.4]), held=[1]).q
    measured = record(true, start, tmp_path)
    guess = four_bar(coupler=200.0, rocker=0.72, damping=0.01)
    free = ["links[1].flexural_rigidity", "links[2].length", "joints[0].damping"]
    found = fa.identify(guess, {"run": measured}, free, progress=False)
    with pytest.raises(fa.InputError, match="prediction_error is not supported for arms with clos"):
        fa.identify(guess, {"run": measured}, free, method="prediction_error")
    table = found.parameters
    error = np.abs(table.estimate.values - [120.0, 0.7, 0.05])
    # Four standard deviations: one noise record in 5,000 for each of three numbers.
    assert np.all(error < 4.0 * table.standard_deviation.values)
    assert np.all(table.standard_deviation.values < [3.0, 1e-4, 1e-3])


def test_an_arm_on_a_cart_is_identified(tmp_path) -> None:
    def cart(rigidity: float, mass: float) -> fa.Arm:
        bar = {"mass_per_length": 0.5, "elements": 1, "damping": fa.ModalDamping(ratio=0.02)}
        links = [fa.Link(length=0.8, flexural_rigidity=rigidity, **bar)]
        base = fa.Base(mass=mass, free=("x",))
        return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.01)], base=base)

    true = cart(20.0, 2.0)
    measured = record(true, true.rest([0.3]), tmp_path)
    free = ["links[0].flexural_rigidity", "base.mass"]
    found = fa.identify(cart(30.0, 1.5), {"run": measured}, free, progress=False)
    table = found.parameters
    assert np.all(
        np.abs(table.estimate.values - [20.0, 2.0]) < 4.0 * table.standard_deviation.values
    )
    assert np.all(table.standard_deviation.values < [0.5, 0.05])


@pytest.mark.thorough
def test_four_bars_have_identifiability(tmp_path) -> None:
    arm = four_bar()
    start = fa.assembled(arm, arm.rest([0.7, -0.4, 1.4]), held=[1]).q
    measured = record(arm, start, tmp_path)
    free = ["links[1].flexural_rigidity", "links[2].length"]
    noisy = fa.MeasuredRecord(
        measured.data, measured.settings.replace(noise={"joint_angle": NOISE})
    )
    predicted = fa.identifiability(arm, {"run": noisy}, free)
    assert np.all(predicted.parameters.standard_deviation.values < [3.0, 1e-4])
