"""Results that are kept for each arm: computed once, not changed by callers, released with it."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

import flexarm as fa
from arms import two_rods
from closed_mechanisms import four_bar
from flexarm.arm.assembly.coordinates import coordinate_sizes, once_per_arm


def test_each_combination_of_arguments_is_computed_once_for_each_arm():
    calls = []

    @once_per_arm
    def product(arm, factor, *, power=1):
        calls.append((arm, factor, power))
        return arm.dof * factor**power

    arm, other = two_rods(), two_rods()
    first = [product(a, 2.0, power=p) for a in (arm, other) for p in (1, 2)]
    assert [product(a, 2.0, power=p) for a in (arm, other) for p in (1, 2)] == first
    assert first == [2.0 * arm.dof, 4.0 * arm.dof] * 2
    assert len(calls) == 4


def test_arrays_cannot_be_changed_by_callers():
    with pytest.raises(ValueError, match="read-only"):
        coordinate_sizes(two_rods())[0] = 2.0


def test_an_arm_is_released_with_its_results():
    arm = two_rods()
    fa.simulate(arm, 0.01, initial=arm.rest([0.1, 0.2]))
    released = weakref.ref(arm)
    del arm
    gc.collect()
    assert released() is None


def test_a_start_is_checked_again_if_the_state_or_the_prescribed_joints_are_others():
    bars = four_bar()
    arm = fa.Arm(bars.spec)
    closed = arm.rest(bars.joints)
    open_posture = closed + 0.01 * np.eye(arm.dof)[arm.joint_index[0]]
    resting = {
        int(number): fa.PrescribedAngle.hold(float(angle))
        for number, angle in zip(arm.joint_numbers, bars.joints, strict=True)
    }
    fa.simulate(arm, 0.01, initial=closed)
    fa.simulate(arm, 0.01, initial=closed)
    with pytest.raises(fa.InputError, match="initial must close the loops"):
        fa.simulate(arm, 0.01, initial=open_posture)
    with pytest.raises(fa.InputError, match="initial_rate must keep the loops closed"):
        fa.simulate(arm, 0.01, initial=closed, initial_rate=np.eye(arm.dof)[arm.joint_index[0]])
    rigid = fa.Arm(four_bar(flexible=False).spec)
    fa.simulate(rigid, 0.01, initial=rigid.rest(bars.joints))
    with pytest.raises(fa.InputError, match="depends on the other closures"):
        fa.simulate(rigid, 0.01, initial=rigid.rest(bars.joints), prescribed=resting)
