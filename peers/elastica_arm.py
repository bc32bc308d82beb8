"""A case in PyElastica: one Cosserat rod that does not resist bending where the joints are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import elastica
import numpy as np

from peers.arms import Case, steps_per_sample


class _Collection(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
    """What PyElastica integrates."""


class _Motors(elastica.NoForces):
    """The motors' torques on the elements at both sides of each joint."""

    def __init__(self, case: Case, roots: Sequence[int]) -> None:
        super().__init__()
        self._case = case
        self._roots = roots

    def apply_torques(self, system: elastica.CosseratRod, time: float = 0.0) -> None:
        """Add them, about the first director, which is normal to the plane."""
        for root, torque in zip(self._roots, self._case.torque(float(time)), strict=True):
            system.external_torques[0, root] += torque
            if root:
                system.external_torques[0, root - 1] -= torque


def tip(case: Case, elements: Sequence[int], radius: float, step: float) -> np.ndarray:
    """Return the tip's path (samples, 2), m; see ``prepare``."""
    return prepare(case, elements, radius, step)()


def prepare(
    case: Case, elements: Sequence[int], radius: float, step: float
) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it, once, and gives the tip's path (samples, 2), m.

    ``elements`` of each link; explicit steps of ``step`` s, which are stable as long as no wave of
    stretch or shear passes an element within one. Those waves, c = sqrt(EA / mass per length), are
    slowed by a rod that is thicker than the links, ``radius`` in m, at the same flexural rigidity
    and mass per length. Its sections resist rotation by radius^2 / 4 of the mass, and the masses at
    the nodes do by length^2 / 6 of an element: that is what this path errs by. It raises
    ``RuntimeError`` where the motion became unstable.
    """
    roots = [int(count) for count in np.cumsum([0, *elements[:-1]])]
    rod = _rod(case, elements, radius)
    rod.bend_matrix[:, :, [root - 1 for root in roots[1:]]] = 0.0
    system = _Collection()
    system.append(rod)
    system.constrain(rod).using(elastica.GeneralConstraint, constrained_position_idx=(0,))
    system.add_forcing_to(rod).using(_Motors, case, roots)
    if case.gravity:
        gravity = np.array([0.0, -case.gravity, 0.0])
        system.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=gravity)
    system.finalize()
    stepper = elastica.PositionVerlet()
    count = steps_per_sample(case, step)

    def run() -> np.ndarray:
        path = np.empty((case.samples, 2))
        path[0] = rod.position_collection[:2, -1]
        for sample in range(1, case.samples):
            for number in range(count):
                stepper.step(system, (sample - 1) / case.rate + number * step, step)
            path[sample] = rod.position_collection[:2, -1]
            # What is unstable stays finite for long; nothing tells but that the rod is longer.
            if not np.linalg.norm(path[sample]) < 1.1 * sum(case.lengths):
                raise RuntimeError(
                    f"PyElastica became unstable with {elements} elements and step {step} s."
                )
        return path

    return run


def _rod(case: Case, elements: Sequence[int], radius: float) -> elastica.CosseratRod:
    """Return the links, end to end."""
    count = sum(elements)
    turned = np.repeat(case.start, elements)
    pieces = np.repeat(np.divide(case.lengths, elements), elements)
    tangents = np.array([np.cos(turned), np.sin(turned), np.zeros(count)])
    nodes = np.zeros((3, count + 1))
    np.cumsum(pieces * tangents, axis=1, out=nodes[:, 1:])
    normal = np.array([0.0, 0.0, 1.0])
    directors = np.empty((3, 3, count))
    directors[0] = normal[:, None]
    directors[1] = np.cross(tangents, normal, axis=0)
    directors[2] = tangents
    return elastica.CosseratRod.straight_rod(
        count,
        nodes[:, 0],
        tangents[:, 0],
        normal,
        float(sum(case.lengths)),
        radius,
        case.mass_per_length / (np.pi * radius**2),
        youngs_modulus=case.flexural_rigidity / (0.25 * np.pi * radius**4),
        position=nodes,
        directors=directors,
    )
