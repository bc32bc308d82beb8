"""Compile the C++ templates beside this file and call them with an arm's constants."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

import flexarm as fa
from flexarm.kernels.layout import ArmConstants

FOLDER = Path(__file__).resolve().parent
FLAGS = ("-std=c++17", "-O3", "-march=native", "-shared", "-fPIC")


def compiler() -> str | None:
    """Return the C++ compiler of this machine ($CXX, g++ or clang++), or None."""
    for name in (os.environ.get("CXX", ""), "g++", "clang++"):
        if name and shutil.which(name):
            return name
    return None


class Limit:
    """Repeat the forward dynamics of an arm at a state in compiled C++.

    Args:
        arm: at most 64 modes a link; joints all free, without friction, stops or rotors.
        q, qd: (dof,) coordinates and rates.
        torque: (joints,) N m.

    Raises:
        ValueError: the arm has what the templates leave out.
        RuntimeError: there is no compiler.
    """

    def __init__(self, arm: fa.Arm, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> None:
        constants = arm.assembly.constants
        n, m = constants.S.shape
        if m > 64 or constants.has_joint_laws or not constants.free.all():
            raise ValueError("the templates know free joints without laws and 64 modes at most.")
        self._second_order = int(constants.D0.shape[1] > 0)
        self._sizes = n, m
        self._bodies = _bodies(constants)
        self._gravity = np.ascontiguousarray(constants.gravity)
        self._q, self._qd = arm.padded(np.stack([q, qd]))
        self._torque = np.ascontiguousarray(arm.padded_torque(torque))
        self.acceleration = np.zeros((n, 1 + m))
        self._library = _library(n, m)

    def compile_time_sizes(self, calls: int) -> None:
        """Evaluate ``calls`` times with loops of constant length."""
        self._library.repeat_fixed(self._second_order, *self._arrays(), ctypes.c_long(calls))

    def run_time_sizes(self, calls: int) -> None:
        """Evaluate ``calls`` times with loops whose length is an argument."""
        theory, sizes = self._second_order, self._sizes
        self._library.repeat_free(theory, *sizes, *self._arrays(), ctypes.c_long(calls))

    def _arrays(self) -> list[ctypes.c_void_p]:
        arrays = self._bodies, self._gravity, self._q, self._qd, self._torque, self.acceleration
        return [ctypes.c_void_p(array.ctypes.data) for array in arrays]


def _bodies(c: ArmConstants) -> np.ndarray:
    """Return the numbers of each body in the order of ``recursion.hpp``, (n, numbers)."""
    n, m = c.S.shape
    scalars = [c.mass, c.inverse_mass, c.first_moment_x, c.first_moment_y, c.length]
    scalars += [c.inertia, c.hub, c.inverse_inertia]
    scalars += [*c.residual_inertia.T, *c.residual_tip.T, *c.N.T, c.tip_mass, c.tip_inertia]
    scalars += [c.joint_damping, c.joint_stiffness, c.joint_rest, c.joint_angle]
    columns = [np.array(scalars).T, c.S, c.a, c.P, c.dP, c.w2, c.damping]
    if c.D0.shape[1]:
        columns += [square.reshape(n, m * m) for square in (c.D0, c.D1, c.G)]
    if c.centrifugal.shape[1]:
        raise ValueError("the templates know no rotary inertia.")
    return np.ascontiguousarray(np.concatenate(columns, axis=1))


@cache  # one for all arms of a size: compiling takes seconds
def _library(bodies: int, modes: int) -> ctypes.CDLL:
    command = compiler()
    if command is None:
        raise RuntimeError("there is no C++ compiler on this machine.")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "limit.so")
        sizes = [f"-DBODIES={bodies}", f"-DMODES={modes}"]
        source = str(FOLDER / "limit.cpp")
        subprocess.run([command, *FLAGS, *sizes, source, "-o", str(path)], check=True)
        # The loader keeps what it has mapped; the file may go.
        return ctypes.CDLL(str(path))
