"""Links of an arm: their cross-sections, materials, gauges and damping."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from flexarm.base.errors import public_call, shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    Count,
    CountOrZero,
    Finite,
    Flag,
    Fraction,
    Listed,
    NonNegative,
    Number,
    OneOrMany,
    Positive,
    must,
    plain,
)
from flexarm.model.wording import Fault, Path, refuse, suggestion

# Beyond these limits the unit must be wrong; within them fourth powers are finite and not zero.
Dimension = Annotated[
    Positive,
    must("be between 1e-9 and 1000", lambda m: 1e-9 <= m <= 1e3, "Dimensions are in metres."),
]
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


class CrossSection(Record):
    """Base of cross-sections, which have an `area` and a `second_moment`."""

    _depth: ClassVar[str] = "height"

    @property
    def depth(self) -> float:
        """Extent in the plane of motion (m)."""
        depth: float = getattr(self, self._depth)
        return depth


class Rectangle(CrossSection):
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


class Circle(CrossSection):
    """A solid circle."""

    kind: Literal["circle"] = "circle"
    diameter: Dimension
    """Diameter (m)."""

    _depth: ClassVar[str] = "diameter"

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


class Tube(CrossSection):
    """A circular tube."""

    kind: Literal["tube"] = "tube"
    outer_diameter: Dimension
    """Outer diameter (m)."""
    thickness: Dimension
    """Wall thickness (m)."""

    _depth: ClassVar[str] = "outer_diameter"

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


class Box(CrossSection):
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


class ModalDamping(Record):
    """Damping ratios of the modes of a link with clamped root and free tip."""

    kind: Literal["modal"] = "modal"
    ratio: OneOrMany[Fraction]
    """Fraction of critical damping: one for all modes, or one for each from the lowest; the last
    one applies to all higher modes."""

    _hints: ClassVar[dict[str, str]] = {
        "ratio": "A ratio is a fraction: 0.01 is one per cent of critical damping."
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("ratio") and given.ratio == ():
            yield Fault(("ratio",), "is empty: give the ratio of at least the lowest mode")

    @public_call
    def ratios(self, modes: CountOrZero) -> tuple[float, ...]:
        """Return the ratios of the given number of modes, from the lowest.

        Raises:
            InputError: if the number is not a whole one from 0.
        """
        if not isinstance(self.ratio, Sequence):
            return (self.ratio,) * modes
        missing = modes - len(self.ratio)
        return (*self.ratio[:modes], *(self.ratio[-1],) * missing)


class RayleighDamping(Record):
    """Rayleigh damping of a link: ``mass_coefficient * M + stiffness_coefficient * K``."""

    kind: Literal["rayleigh"] = "rayleigh"
    mass_coefficient: NonNegative = 0.0
    """Factor of the mass matrix (1/s)."""
    stiffness_coefficient: NonNegative = 0.0
    """Factor of the stiffness matrix (s); without mass_coefficient, Kelvin-Voigt damping."""


Damping = Annotated[ModalDamping | RayleighDamping, Field(discriminator="kind")]


MOST_ELEMENTS = 256

_CONSTANTS = (
    "flexural_rigidity",
    "mass_per_length",
    "rotary_inertia_per_length",
    "shear_rigidity",
)
_WAYS = (
    "A link is described by flexural_rigidity and mass_per_length, by material and section, "
    "or by table."
)


Elements = Annotated[
    int,
    Field(strict=True, ge=1, json_schema_extra={"maximum": MOST_ELEMENTS}),
    must(
        f"be at most {MOST_ELEMENTS}",
        lambda elements: elements <= MOST_ELEMENTS,
        "The modal basis of a link is dense: more elements increase memory and rounding errors "
        "and do not improve the accuracy.",
    ),
    BeforeValidator(plain),
]


class Gauge(Record):
    """A strain gauge; it reads ``-distance`` times the curvature at its station."""

    station: NonNegative
    """Distance from the root along the link (m)."""
    distance: Number
    """Distance from the neutral axis, positive on the side of +y (m)."""


class Link(Record):
    """A link, described in exactly one of three ways.

    The ways are constants (`flexural_rigidity` and `mass_per_length`), `material` and `section`,
    or a `table` along the link. A rigid link (``flexible=False``) does not require
    `flexural_rigidity` and ignores `elements`, `segments`, `modes` and `damping`.
    """

    length: Positive
    """Length (m), from the root to the tip."""
    parent: CountOrZero | None = None
    """Number of the link that carries the joint of this one, counted from 1, or 0 for the base; by
    default the link before."""
    parent_station: NonNegative | None = None
    """Distance from the root of the parent to the joint (m); by default at its tip. A flexible
    parent is divided there."""
    hub_radius: NonNegative = 0.0
    """Distance from the joint to the root of the link (m), along the root tangent; rigid and
    without mass."""
    flexural_rigidity: Positive | None = None
    """Constant bending stiffness E I (N m^2)."""
    mass_per_length: NonNegative | None = None
    """Constant mass per length (kg/m)."""
    rotary_inertia_per_length: NonNegative | None = None
    """Constant rotary inertia rho I of the section per length (kg m)."""
    shear_rigidity: Positive | None = None
    """Constant shear stiffness k G A (N); for links with element: timoshenko."""
    material: MaterialOrName | None = None
    """Material, or the name of a preset: steel, aluminium."""
    section: Section | None = None
    """Cross-section, the same along the link."""
    table: SectionTable | None = None
    """Section properties along the link."""
    element: Literal["euler_bernoulli", "timoshenko"] = "euler_bernoulli"
    """Beam theory: without (euler_bernoulli) or with (timoshenko) shear deformation."""
    elements: Elements = 4
    """Number of equal beam elements."""
    segments: Count = 1
    """Number of equal pieces, rigidly joined, for large deflection; a divisor of elements."""
    modes: Count | None = None
    """Number of modes of each segment; by default all of its coordinates, two for each element. A
    link in several parts, by segments or points in between, has at least two in each."""
    flexible: Flag = True
    """Whether the link bends."""
    rotary_inertia: Flag | None = None
    """Whether rotary inertia of the sections is included; by default, if material and section, a
    table or rotary_inertia_per_length define it."""
    damping: Damping | None = None
    """Structural damping; none by default."""
    gauges: Listed[Gauge] = ()
    """Strain gauges on the link."""

    _hints: ClassVar[dict[str, str]] = {"element": "`elements` is their number."}

    @property
    def reach(self) -> float:
        """Distance from the joint to the tip of the straight link (m)."""
        return self.hub_radius + self.length

    @property
    def coordinates(self) -> int:
        """Number of elastic coordinates: 0 for a rigid link, else those of its segments."""
        if not self.flexible:
            return 0
        return self.segments * (self.modes or 2 * (self.elements // self.segments))

    def beam(self) -> SectionTable:
        """Return the section properties along the link for any of the three descriptions.

        Returns:
            A table from 0 to `length` with at least two points and a column of rotary inertia,
            which is zero if it is switched off. `shear_rigidity` is set for the Timoshenko element
            only. A rigid link may have neither `flexural_rigidity` nor `shear_rigidity`. It is not
            validated, because the fields of this link are, and because they may be symbols.
        """
        if self.table is not None:
            columns = dict(self.table)
            # The last point may differ from the length by rounding in the user's computation.
            columns["x"] = (*self.table.x[:-1], self.length)
        else:
            values = {name: getattr(self, name) for name in _CONSTANTS}
            if self.material is not None and self.section is not None:
                effective = self.section.shear_coefficient * self.section.area
                values = {
                    "flexural_rigidity": self.material.youngs_modulus * self.section.second_moment,
                    "mass_per_length": self.material.density * self.section.area,
                    "rotary_inertia_per_length": self.material.density * self.section.second_moment,
                    "shear_rigidity": self.material.shear_modulus * effective,
                }
            columns = {k: None if v is None else (v, v) for k, v in values.items()}
            columns["x"] = (0.0, self.length)
        if self.rotary_inertia is False or columns["rotary_inertia_per_length"] is None:
            columns["rotary_inertia_per_length"] = (0.0,) * len(columns["x"])
        if self.element != "timoshenko":
            columns["shear_rigidity"] = None
        return SectionTable.model_construct(**columns)

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        numbers = [name for name in _CONSTANTS if not given.absent(name)]
        shape = [name for name in ("material", "section") if not given.absent(name)]
        table = ["table"] if not given.absent("table") else []
        ways = [names for names in (table, shape, numbers) if names]
        if not ways:
            yield Fault(("mass_per_length",), "is missing", hint=_WAYS)
        for names in ways[1:]:
            for name in names:
                yield Fault((name,), f"cannot be combined with {' and '.join(ways[0])}", hint=_WAYS)
        if len(ways) == 1 and len(shape) == 1:
            other = "section" if shape == ["material"] else "material"
            yield Fault((other,), f"is required with {shape[0]}")
        if ways == [numbers] and given.absent("mass_per_length"):
            yield Fault(("mass_per_length",), "is missing", hint=_WAYS)
        yield from _rigid_or_flexible_faults(given)
        yield from _shear_faults(given)
        if given.has("rotary_inertia") and given.rotary_inertia:
            in_table = given.has("table") and given.table.rotary_inertia_per_length is not None
            constants = (
                given.absent("table") and given.absent("material") and given.absent("section")
            )
            if (given.has("table") and not in_table) or (
                constants and given.absent("rotary_inertia_per_length")
            ):
                yield Fault(("rotary_inertia",), "requires rotary_inertia_per_length")
        if given.has("length", "table"):
            end, whole = given.table.x[-1], "A table covers the link from root to tip."
            # The tolerance is above rounding, and below any intended difference.
            if not math.isclose(end, given.length, rel_tol=1e-9):
                rule = f"end at {given.length:.9g} (the length of the link)"
                yield Fault(("table", "x"), rule, shown(end), whole)
        if given.has("elements", "segments"):
            yield from _mesh_faults(given)
        if given.has("segments", "damping") and given.segments > 1:
            yield from _segment_damping_faults(given.damping)
        if given.has("length", "gauges"):
            for i, gauge in enumerate(given.gauges):
                if gauge.station > given.length:
                    rule = f"be at most {given.length:.9g} (the length of the link)"
                    yield Fault(("gauges", i, "station"), rule, shown(gauge.station))


def _rigid_or_flexible_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults of a flexible link without stiffness or mass."""
    if not given.has("flexible") or not given.flexible:
        return
    hint = "Only a rigid link (flexible: false) does not need it."
    constants = all(given.absent(name) for name in ("material", "section", "table"))
    if constants and not given.absent("mass_per_length") and given.absent("flexural_rigidity"):
        yield Fault(("flexural_rigidity",), "is missing", hint=hint)
    if given.has("table") and given.table.flexural_rigidity is None:
        yield Fault(("table", "flexural_rigidity"), "is missing", hint=hint)
    hint = "Only a rigid link (flexible: false) may be massless."
    if given.has("mass_per_length") and given.mass_per_length == 0:
        yield Fault(("mass_per_length",), "be greater than 0", "0", hint)
    if given.has("table") and 0 in given.table.mass_per_length:
        where = ("table", "mass_per_length", given.table.mass_per_length.index(0))
        yield Fault(where, "be greater than 0", "0", hint)


def _segment_damping_faults(damping: Damping) -> Iterator[Fault]:
    """Yield a fault if damping would have another meaning for a segment than for the whole link."""
    if damping.kind == "rayleigh" and damping.mass_coefficient == 0:
        return
    hint = (
        "Ratios and mass_coefficient refer to modes of the whole link, which its segments do not "
        "have. Use stiffness_coefficient alone (Kelvin-Voigt)."
    )
    rule = "be rayleigh without mass_coefficient on a link with segments"
    yield Fault(("damping",), rule, damping.kind, hint)


def _shear_faults(given: Given) -> Iterator[Fault]:
    """Yield a fault if a Timoshenko link has no shear rigidity, or another link has one."""
    if not given.has("element"):
        return
    constants = all(given.absent(name) for name in ("table", "material", "section"))
    if given.has("table"):
        path: Path = ("table", "shear_rigidity")
        value, needed = given.table.shear_rigidity, True
    elif constants:
        path, value = ("shear_rigidity",), given.raw("shear_rigidity")
        needed = not given.absent("mass_per_length")
    else:
        return
    if given.element == "euler_bernoulli" and value is not None:
        hint = "For shear deformation use element: timoshenko."
        yield Fault(path, "is not supported for an Euler-Bernoulli link", hint=hint)
    flexible = given.has("flexible") and given.flexible
    if given.element == "timoshenko" and value is None and needed and flexible:
        yield Fault(
            path, "is missing", hint="It is k G A. A material and a section define it, too."
        )


def _mesh_faults(given: Given) -> Iterator[Fault]:
    """Yield a fault if segments do not divide the mesh, or have fewer modes than requested."""
    if given.elements % given.segments:
        rule = f"be a divisor of elements ({given.elements})"
        yield Fault(("segments",), rule, shown(given.segments), "Each segment has its own mesh.")
        return
    most = 2 * (given.elements // given.segments)
    modes = given.modes if given.has("modes") else None
    if modes is not None and modes > most:
        rule = f"be at most {most} (twice the number of elements of a segment)"
        yield Fault(("modes",), rule, shown(modes), "Use more elements, or fewer modes.")
        return
    if modes == 1 and given.segments > 1:
        less = 0.25 * (1.0 - 1.0 / given.segments)
        hint = f"With one mode in each, the tip moves {less:.0%} too little under a moment."
        yield Fault(("modes",), "be at least 2 with segments", shown(modes), hint)
        return
    ratio = given.damping.ratio if given.has("damping") and given.damping.kind == "modal" else ()
    kept = modes or most
    if isinstance(ratio, tuple) and len(ratio) > kept:
        rule = f"have length at most {kept} (the number of modes of the link)"
        yield Fault(("damping", "ratio"), rule, str(len(ratio)))
