"""Long runs conserve energy and need little memory."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.integrate import simpson

import flexarm as fa
from arms import table_one_arm


def total_energy(result) -> np.ndarray:
    return (result.kinetic_energy + result.strain_energy + result.gravity_energy).values


@pytest.mark.thorough
def test_free_arm_conserves_energy_over_ten_seconds() -> None:
    for gravity in ((0.0, 0.0), (0.0, -9.81)):
        arm = table_one_arm(gravity=gravity)
        rates = arm.rest([1.0, -2.0])
        # Under gravity it falls so far that its links bend by 14 %, which does not affect the
        # energy.
        with pytest.warns(fa.LargeDeflectionWarning) if any(gravity) else nullcontext():
            result = fa.simulate(
                arm, 10.0, initial=arm.rest([0.3, 0.8]), initial_rate=rates, rtol=1e-11, atol=1e-13
            )
        energy = total_energy(result)
        # Gravity energy may pass zero, so the tolerance is relative to the largest kinetic energy.
        scale = float((result.kinetic_energy + result.strain_energy).max())
        assert np.max(np.abs(energy - energy[0])) < 1e-9 * scale


def test_work_of_the_torques_is_the_change_of_energy() -> None:
    arm = table_one_arm(gravity=(0.0, -9.81))
    result = fa.simulate(
        arm,
        1.0,
        torque=lambda t: [3.0 * np.sin(7.0 * t), np.cos(3.0 * t)],
        initial=arm.rest([-1.2, 0.3]),
        rate=20_000.0,
        rtol=1e-10,
        atol=1e-12,
    )
    power = (result.torque * result.joint_rate).sum("joint").values
    work = simpson(power, x=result.time.values)
    energy = total_energy(result)
    moved = float(result.kinetic_energy.max())
    # Simpson's rule at 20 kHz has an error of 1e-10 here: the fastest mode has 4000 rad/s.
    assert abs(work - (energy[-1] - energy[0])) < 1e-8 * moved


def test_damping_never_increases_energy() -> None:
    arm = table_one_arm()
    links = [link.replace(damping=fa.ModalDamping(ratio=0.02)) for link in arm.spec.links]
    damped = fa.Arm(links=links, joints=[fa.Joint(damping=0.05)] * 2)
    result = fa.simulate(damped, 2.0, initial_rate=damped.rest([2.0, -1.0]), rtol=1e-7)
    energy = total_energy(result)
    assert np.all(np.diff(energy) < 1e-9 * energy[0])
    assert energy[-1] < 0.95 * energy[0]


@pytest.mark.thorough
def test_memory_of_a_minute_at_one_kilohertz() -> None:
    """60001 samples of every channel within 200 MB in addition to the imports, in a separate
    process."""
    script = textwrap.dedent(
        """
        import resource
        import flexarm as fa
        rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
        arm = fa.Arm(links=[fa.Link(length=1.4142, elements=2, **rod),
                            fa.Link(length=1.0, elements=1, **rod)])
        peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        fa.simulate(arm, 0.01)
        before = peak()
        result = fa.simulate(arm, 60.0, torque=lambda t: [0.01, -0.01])
        assert result.sizes["time"] == 60001
        after = peak()
        # More steps for the same samples must not cost memory.
        fa.simulate(arm, 60.0, torque=lambda t: [0.01, -0.01], rate=10.0, rtol=1e-10, atol=1e-12)
        print(after - before, peak() - after)
        """
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    recorded, stepped = map(float, run.stdout.split())
    assert recorded < 200.0
    assert stepped < 10.0
