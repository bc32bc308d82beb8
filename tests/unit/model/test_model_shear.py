"""Links with shear: shear coefficients of sections, the beam of a link, and wrong values."""

import numpy as np
import pytest

from flexarm.base.errors import ModelError
from flexarm.model import Box, Circle, Link, Material, Rectangle, SectionTable, Tube, json_schema
from flexarm.model.arm.links import MATERIALS

CONSTANTS = {"length": 2.0, "flexural_rigidity": 3.0, "mass_per_length": 0.5}
TABLE = {"x": [0, 2], "flexural_rigidity": [3, 1], "mass_per_length": [0.5, 0.2]}
SHEARED = {**TABLE, "shear_rigidity": [40, 20]}
GIVE = "It is k G A. A material and a section define it, too."
SET = "For shear deformation use element: timoshenko."
WAYS = (
    "A link is described by flexural_rigidity and mass_per_length, by material and section, "
    "or by table."
)
EULER = "is not supported for an Euler-Bernoulli link"


def problems_of(**values):
    with pytest.raises(ModelError) as caught:
        Link(**values)
    return [line.removeprefix("Link: ") for line in str(caught.value).splitlines()]


def annulus(inner, outer=1.0):
    """Return the shear coefficient of a ring: Saint-Venant's stresses at a Poisson's ratio of zero.

    Stresses are V/I times the gradient of cos(t) (a r + b/r - r^3/8): its divergence -r cos(t)
    balances the bending stress, and a and b make both edges free of radial stress.
    """
    edges = np.array([[1.0, -1 / r**2] for r in (inner, outer)])
    a, b = np.linalg.solve(edges, [3 * inner**2 / 8, 3 * outer**2 / 8])
    node, weight = np.polynomial.legendre.leggauss(200)
    r, dr = (outer + inner) / 2 + (outer - inner) / 2 * node, (outer - inner) / 2 * weight
    radial, hoop = a - b / r**2 - 3 * r**2 / 8, a + b / r**2 - r**2 / 8
    energy = np.pi * np.sum(dr * r * (radial**2 + hoop**2))
    area, second_moment = np.pi * (outer**2 - inner**2), np.pi / 4 * (outer**4 - inner**4)
    return second_moment**2 / (area * energy)


def thin_box(width, height, thickness):
    """Return the shear coefficient of a thin box with width and height between wall centres.

    Shear flow grows from the middle of a flange to the corner and on to the middle of the web.
    """
    node, weight = np.polynomial.legendre.leggauss(8)
    s, ds = (node + 1) / 2, weight / 2
    area = 2 * thickness * (width + height)
    second_moment = thickness * (height**3 / 6 + width * height**2 / 2)
    flange = thickness * height / 2 * s * width / 2
    along = s * height / 2
    web = thickness * (height / 2 * width / 2 + along * (height - along) / 2)
    energy = 4 * (ds @ flange**2 * width / 2 + ds @ web**2 * height / 2) / thickness
    return second_moment**2 / (area * energy)


class TestShearCoefficients:
    def test_solid_sections(self):
        # Jourawski's parabola: the mean square of 3/2 (1 - y^2) is 6/5.
        assert Rectangle(width=0.02, height=0.05).shear_coefficient == pytest.approx(5 / 6)
        assert Circle(diameter=0.04).shear_coefficient == pytest.approx(6 / 7)
        assert annulus(1e-6) == pytest.approx(6 / 7, rel=1e-6)

    @pytest.mark.parametrize("part", [0.01, 0.1, 0.25, 0.4, 0.49])
    def test_tubes_have_the_energy_of_saint_venants_stresses(self, part):
        tube = Tube(outer_diameter=2.0, thickness=2.0 * part)
        assert tube.shear_coefficient == pytest.approx(annulus(1.0 - 2.0 * part), rel=1e-12)

    def test_thin_and_thick_tubes(self):
        thin, thick = (Tube(outer_diameter=1.0, thickness=t) for t in (1e-6, 0.4999999))
        assert thin.shear_coefficient == pytest.approx(1 / 2, rel=1e-5)
        assert thick.shear_coefficient == pytest.approx(6 / 7, rel=1e-6)

    @pytest.mark.parametrize(("width", "height"), [(0.1, 0.1), (0.05, 0.2), (0.3, 0.1)])
    def test_boxes_have_the_energy_of_their_shear_flow(self, width, height):
        t = 0.002
        box = Box(width=width + t, height=height + t, thickness=t)
        assert box.shear_coefficient == pytest.approx(thin_box(width, height, t), rel=1e-12)

    def test_square_box(self):
        square = Box(width=0.1, height=0.1, thickness=0.001)
        assert square.shear_coefficient == pytest.approx(5 / 12, rel=1e-12)


def test_shear_modulus():
    assert Material(density=1, youngs_modulus=5.2).shear_modulus == pytest.approx(2.0)
    free = Material(density=1, youngs_modulus=5.0, poissons_ratio=0.25)
    assert free.shear_modulus == pytest.approx(2.0)
    assert (MATERIALS["steel"].poissons_ratio, MATERIALS["aluminium"].poissons_ratio) == (0.3, 0.33)


class TestBeam:
    def test_of_constants(self):
        link = Link(**CONSTANTS, element="timoshenko", shear_rigidity=40)
        assert link.beam() == SectionTable(
            x=[0, 2],
            flexural_rigidity=[3, 3],
            mass_per_length=[0.5, 0.5],
            rotary_inertia_per_length=[0, 0],
            shear_rigidity=[40, 40],
        )

    def test_of_material_and_section(self):
        """A solid rectangle of Poisson's ratio 0.3: kGA = E A/3.12, with rotary inertia."""
        section = Rectangle(width=0.02, height=0.05)
        link = Link(length=1, material="steel", section=section, element="timoshenko")
        beam = link.beam()
        assert beam.shear_rigidity == pytest.approx((210e9 * section.area / 3.12,) * 2)
        assert beam.rotary_inertia_per_length == (7850 * section.second_moment,) * 2
        assert link.replace(element="euler_bernoulli").beam().shear_rigidity is None

    def test_of_a_table(self):
        link = Link(length=2, table=SHEARED, element="timoshenko")
        assert link.beam().shear_rigidity == (40.0, 20.0)

    def test_euler_bernoulli_is_the_default(self):
        assert Link(**CONSTANTS).element == "euler_bernoulli"
        assert Link(**CONSTANTS).beam().shear_rigidity is None

    def test_rigid_link_needs_no_shear_rigidity(self):
        rigid = Link(**CONSTANTS, element="timoshenko", flexible=False)
        assert rigid.beam().shear_rigidity is None
        table = Link(length=2, table=TABLE, element="timoshenko", flexible=False)
        assert table.beam().shear_rigidity is None


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        (
            {**CONSTANTS, "element": "timoshenko"},
            [f"shear_rigidity is missing. {GIVE}"],
        ),
        (
            {**CONSTANTS, "shear_rigidity": 40},
            [f"shear_rigidity {EULER}. {SET}"],
        ),
        (
            {"length": 2, "table": TABLE, "element": "timoshenko"},
            [f"table.shear_rigidity is missing. {GIVE}"],
        ),
        (
            {"length": 2, "table": SHEARED},
            [f"table.shear_rigidity {EULER}. {SET}"],
        ),
        (
            {"length": 2, "table": SHEARED, "element": "timoshenko", "shear_rigidity": 1},
            [f"shear_rigidity cannot be combined with table. {WAYS}"],
        ),
        (
            {
                "length": 2,
                "material": "steel",
                "section": {"kind": "circle", "diameter": 0.1},
                "shear_rigidity": 1,
            },
            [(f"shear_rigidity cannot be combined with material and section. {WAYS}")],
        ),
        (
            {"length": 2, "table": {**TABLE, "shear_rigidity": [1]}, "element": "timoshenko"},
            [("table.shear_rigidity must have length 2, one value for each point of x, got 1.")],
        ),
        (
            {**CONSTANTS, "element": 3},
            [
                (
                    "element must be one of 'euler_bernoulli', 'timoshenko', got 3. "
                    "`elements` is their number."
                )
            ],
        ),
        (
            {**CONSTANTS, "element": "timoshenko", "shear_rigidity": -1},
            ["shear_rigidity must be greater than 0, got -1."],
        ),
    ],
)
def test_wrong_links_are_rejected_with_every_reason(values, problems):
    assert problems_of(**values) == problems


def test_empty_link_lists_its_missing_keys_first():
    (problem,) = problems_of(length=1, element="timoshenko")
    assert problem.startswith("mass_per_length is missing")


def test_schema_has_the_choice_and_the_limits():
    definitions = json_schema("arm")["$defs"]
    link = definitions["Link"]["properties"]
    assert link["element"]["enum"] == ["euler_bernoulli", "timoshenko"]
    assert link["element"]["default"] == "euler_bernoulli"
    ratio = definitions["Material"]["properties"]["poissons_ratio"]
    assert (ratio["exclusiveMinimum"], ratio["maximum"], ratio["default"]) == (-1, 0.5, 0.3)
    assert "shear_rigidity" in definitions["SectionTable"]["properties"]
