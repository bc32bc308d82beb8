"""Export of arms to simulators of rigid bodies."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_count, check_kind
from flexarm.base.errors import public_call
from flexarm.base.writing.places import check_place, write_text
from flexarm.bridges.rigid_chain.bodies import Body, bodies
from flexarm.bridges.rigid_chain.chain import RigidChain, rigid_chain
from flexarm.bridges.rigid_chain.exudyn_script import exudyn_script
from flexarm.bridges.rigid_chain.files import mjcf, urdf

#: Largest number of virtual joints of a link.
_MOST = 64


@public_call
def export_mjcf(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a model of MuJoCo (MJCF).

    Every flexible link becomes rigid bars on virtual joints with springs. Static deflections under
    forces and moments at the tip are exact for links without shear; the file contains the errors of
    the first frequencies. Driven joints have motors and sensors.

    Args:
        arm: the arm.
        path: the file, ``.xml``.
        virtual_joints: number of virtual joints of each flexible link, at least 2.

    Returns:
        The file.

    Raises:
        InputError: if a joint has friction, limits or a rotor, a part has no mass, or the file
            cannot be written.
    """
    return _export(arm, path, virtual_joints, ".xml", mjcf)


@public_call
def export_urdf(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a robot in URDF.

    The bars and joints are those of ``export_mjcf``. URDF has no springs: their stiffness is in
    elements for Gazebo, and other programs must be given it.

    Args:
        arm, virtual_joints: as in ``export_mjcf``.
        path: the file, ``.urdf``.

    Returns:
        The file.

    Raises:
        InputError: as in ``export_mjcf``.
    """
    return _export(arm, path, virtual_joints, ".urdf", urdf)


@public_call
def export_exudyn(arm: Arm, path: str | PathLike[str], *, virtual_joints: int = 4) -> Path:
    """Write an arm as a Python script that builds and simulates it in Exudyn.

    The bars and joints are those of ``export_mjcf``, as one kinematic tree. The functions ``build``
    and ``run`` of the script accept joint angles at the start, torques over time and a duration.

    Args:
        arm, virtual_joints: as in ``export_mjcf``.
        path: the file, ``.py``.

    Returns:
        The file.

    Raises:
        InputError: as in ``export_mjcf``, or if no joint moves.
    """
    return _export(arm, path, virtual_joints, ".py", exudyn_script)


def _export(
    arm: Arm,
    path: str | PathLike[str],
    virtual_joints: int,
    suffix: str,
    text_of: Callable[[RigidChain, list[Body], str], str],
) -> Path:
    check_kind("arm", arm, Arm)
    count = check_count("virtual_joints", virtual_joints, 2, _MOST)
    chain = rigid_chain(arm, count)
    parts = bodies(chain)
    place = check_place("path", path, (suffix,))
    write_text(text_of(chain, parts, place.stem), place)
    return place
