"""Materials, cross-sections, and tables of section properties along a link."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Finite, Listed, NonNegative, Number, Positive, plain
from flexarm.model.wording import Fault, refuse, suggestion


def _of_a_section(value: float) -> float:
    """Raise if a dimension is so small or large that its unit must be wrong.

    Within these limits fourth powers are finite and greater than zero.
    """
    if not 1e-9 <= value <= 1e3:
        raise refuse("be between 1e-9 and 1000", value, "Dimensions are in metres.")
    return value


Dimension = Annotated[Positive, AfterValidator(_of_a_section)]
PoissonsRatio = Annotated[Finite, Field(gt=-1, le=0.5), BeforeValidator(plain)]


class Material(Record):
    """A homogeneous, isotropic, linearly elastic material."""

    density: Positive
    """Mass per volume (kg/m^3)."""
    youngs_modulus: Positive
    """Young's modulus (Pa)."""
    poissons_ratio: PoissonsRatio = 0.3
    """Poisson's ratio; used with element: timoshenko."""

    @property
    def shear_modulus(self) -> float:
        """Shear modulus (Pa)."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))


MATERIALS = {
    # Rounded handbook values of structural alloys. Measured values can be given in the file.
    "steel": Material(density=7850.0, youngs_modulus=210e9, poissons_ratio=0.3),
    "aluminium": Material(density=2700.0, youngs_modulus=70e9, poissons_ratio=0.33),
}


def _by_name(value: Any) -> Any:
    """Replace the name of a preset by its material."""
    if not isinstance(value, str):
        return value
    if value not in MATERIALS:
        rule = "be density and youngs_modulus, or the name of a preset"
        raise refuse(rule, value, suggestion(value, MATERIALS))
    return MATERIALS[value]


MaterialOrName = Annotated[Material, BeforeValidator(_by_name)]


class Rectangle(Record):
    """A solid rectangle; the link bends in the direction of its `height`."""

    kind: Literal["rectangle"] = "rectangle"
    width: Dimension
    """Width out of the plane of motion (m)."""
    height: Dimension
    """Depth in the plane of motion (m)."""

    @property
    def area(self) -> float:
        """Area (m^2)."""
        return self.width * self.height

    @property
    def second_moment(self) -> float:
        """Second moment of area about the bending axis (m^4)."""
        return self.width * self.height**3 / 12

    @property
    def shear_coefficient(self) -> float:
        """Shear coefficient k of the area; theory page "beams", (B.36)."""
        return 5 / 6

    @property
    def depth(self) -> float:
        """Extent in the plane of motion (m)."""
        return self.height


class Circle(Record):
    """A solid circle."""

    kind: Literal["circle"] = "circle"
    diameter: Dimension
    """Diameter (m)."""

    @property
    def area(self) -> float:
        """Area (m^2)."""
        return math.pi * self.diameter**2 / 4

    @property
    def second_moment(self) -> float:
        """Second moment of area about the bending axis (m^4)."""
        return math.pi * self.diameter**4 / 64

    @property
    def shear_coefficient(self) -> float:
        """Shear coefficient k of the area; theory page "beams", (B.36)."""
        return 6 / 7

    @property
    def depth(self) -> float:
        """Extent in the plane of motion (m)."""
        return self.diameter


class Tube(Record):
    """A circular tube."""

    kind: Literal["tube"] = "tube"
    outer_diameter: Dimension
    """Outer diameter (m)."""
    thickness: Dimension
    """Wall thickness (m)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("outer_diameter", "thickness"):
            yield from _wall_fits(given.thickness, "outer_diameter", given.outer_diameter)

    @property
    def _inner_diameter(self) -> float:
        return self.outer_diameter - 2 * self.thickness

    @property
    def area(self) -> float:
        """Area of the wall (m^2)."""
        return math.pi * self.thickness * (self.outer_diameter - self.thickness)

    @property
    def second_moment(self) -> float:
        """Second moment of area of the wall about the bending axis (m^4)."""
        # pi (D^4 - d^4) / 64, factored to avoid the cancellation for thin walls.
        squares = self.outer_diameter**2 + self._inner_diameter**2
        return self.area * squares / 16

    @property
    def shear_coefficient(self) -> float:
        """Shear coefficient k of the area, 6/7 (solid) to 1/2 (thin wall); (B.36)."""
        ratio = (self._inner_diameter / self.outer_diameter) ** 2
        return 6 * (1 + ratio) ** 2 / (7 * (1 + ratio) ** 2 + 20 * ratio)

    @property
    def depth(self) -> float:
        """Extent in the plane of motion (m)."""
        return self.outer_diameter


class Box(Record):
    """A hollow rectangle with uniform wall thickness."""

    kind: Literal["box"] = "box"
    width: Dimension
    """Outer width out of the plane of motion (m)."""
    height: Dimension
    """Outer depth in the plane of motion (m)."""
    thickness: Dimension
    """Wall thickness (m)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("width", "height", "thickness"):
            name = "width" if given.width <= given.height else "height"
            yield from _wall_fits(given.thickness, name, min(given.width, given.height))

    @property
    def area(self) -> float:
        """Area of the wall (m^2)."""
        return 2 * self.thickness * (self.width + self.height - 2 * self.thickness)

    @property
    def second_moment(self) -> float:
        """Second moment of area of the wall about the bending axis (m^4)."""
        inner_width = self.width - 2 * self.thickness
        inner_height = self.height - 2 * self.thickness
        # (B H^3 - b h^3) / 12, with H^3 - h^3 factored to avoid the cancellation for thin walls.
        squares = self.height**2 + self.height * inner_height + inner_height**2
        return self.thickness * (inner_width * squares + self.height**3) / 6

    @property
    def shear_coefficient(self) -> float:
        """Shear coefficient k of the area, for thin walls; (B.36).

        Mainly the two walls along the `height` carry shear, 5/6 of their area in a narrow box.
        """
        m = (self.width - self.thickness) / (self.height - self.thickness)
        return 10 * (1 + 3 * m) ** 2 / (12 + 72 * m + 150 * m**2 + 120 * m**3 + 30 * m**4)

    @property
    def depth(self) -> float:
        """Extent in the plane of motion (m)."""
        return self.height


Section = Annotated[Rectangle | Circle | Tube | Box, Field(discriminator="kind")]


class SectionTable(Record):
    """Section properties at points along a link, linear between the points.

    Only a rigid link may omit `flexural_rigidity`.
    """

    x: Listed[Number]
    """Distances from the root from 0 to the link's length (m)."""
    flexural_rigidity: Listed[Positive] | None = None
    """Bending stiffness E I at each point (N m^2)."""
    mass_per_length: Listed[NonNegative]
    """Mass per length at each point (kg/m)."""
    rotary_inertia_per_length: Listed[NonNegative] | None = None
    """Rotary inertia rho I per length at each point (kg m)."""
    shear_rigidity: Listed[Positive] | None = None
    """Shear stiffness k G A at each point (N); for links with element: timoshenko."""

    _columns: ClassVar[tuple[str, ...]] = (
        "x",
        "flexural_rigidity",
        "mass_per_length",
        "rotary_inertia_per_length",
        "shear_rigidity",
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("x"):
            return
        yield from _points_faults(given.x)
        points = len(given.x)
        for name in filter(given.has, cls._columns[1:]):
            if len(getattr(given, name)) != points:
                rule = f"have length {points}, one value for each point of x"
                yield Fault((name,), rule, str(len(getattr(given, name))))


def _points_faults(x: tuple[float, ...]) -> Iterator[Fault]:
    """Yield the faults of the points of a table."""
    if len(x) < 2:
        yield Fault(("x",), "have at least two points, the root and the tip", str(len(x)))
        return
    if x[0] != 0:
        yield Fault(("x", 0), "be 0", shown(x[0]), "A table starts at the root of the link.")
    for i, (left, right) in enumerate(pairwise(x)):
        if right <= left:
            yield Fault(("x", i + 1), f"be greater than the previous point ({left})", shown(right))


def _wall_fits(thickness: float, name: str, outer: float) -> Iterator[Fault]:
    """Yield a fault if walls of this thickness leave no hollow inside an outer dimension."""
    if thickness >= outer / 2:
        rule = f"be less than {outer / 2:g} (half of {name})"
        yield Fault(("thickness",), rule, shown(thickness), "The wall fills the section.")
