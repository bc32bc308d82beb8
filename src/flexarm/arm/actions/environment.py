"""The environment of an arm: loads, the acceleration of its base, and contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexarm.arm.actions.contacts import place_contacts
from flexarm.arm.actions.loads import place_loads, tip_load
from flexarm.arm.assembly.coordinates import Coordinates
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import check_array
from flexarm.kernels.layout import Loads
from flexarm.model import AccelerationTable, Contact, Load

#: Acceleration (2,) m/s^2 in world axes, a function of time (s) that returns it, or a table.
BaseAcceleration = ArrayLike | Callable[[float], ArrayLike] | AccelerationTable


@dataclass(frozen=True, eq=False)
class Environment:
    """External actions on an arm.

    Public functions take them as separate arguments and combine them at once with ``of``; all
    other functions pass the environment on.

    Attributes:
        loads: forces and moments, including the force at the tip.
        base_acceleration: acceleration of the base; None for a base at rest.
        contacts: contacts of points of the arm with surfaces.
    """

    loads: Sequence[Load] = ()
    base_acceleration: BaseAcceleration | None = None
    contacts: Sequence[Contact] = ()

    @classmethod
    def of(
        cls,
        arm: Coordinates,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: BaseAcceleration | None = None,
        contacts: Sequence[Contact] = (),
    ) -> Environment:
        """Combine the arguments of a public function, after validation.

        ``tip_force`` is (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, N and N m.
        """
        return cls(
            [*tip_load(arm, tip_force), *check_list_of("loads", loads, Load)],
            base_acceleration,
            check_list_of("contacts", contacts, Contact),
        )

    def placed(self, arm: Coordinates) -> Loads:
        """Return the kernels' arrays for one state; time factors of loads are ignored."""
        placed = place_loads(arm, self.loads)
        base = self.base_acceleration
        if base is not None:
            placed.base_acceleration[:] = check_array("base_acceleration", base, (2,))
        if not self.contacts:
            return placed
        return placed._replace(contacts=place_contacts(arm, self.contacts))


#: The environment of an arm on which nothing acts except gravity.
EMPTY = Environment()
