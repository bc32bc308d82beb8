"""Links: three ways to describe one, its beam, and wrong values."""

import numpy as np
import pytest
from pydantic import ValidationError

from flexarm.base.errors import InputError, ModelError
from flexarm.model import (
    ArmSpec,
    Circle,
    Gauge,
    Link,
    Material,
    ModalDamping,
    RayleighDamping,
    SectionTable,
)

FRACTION = "A ratio is a fraction: 0.01 is one per cent of critical damping."
WAYS = (
    "A link is described by flexural_rigidity and mass_per_length, by material and section, "
    "or by table."
)
RIGID = "Only a rigid link (flexible: false)"
CONSTANTS = {"length": 2.0, "flexural_rigidity": 3.0, "mass_per_length": 0.5}
TABLE = {"x": [0, 2], "flexural_rigidity": [3, 1], "mass_per_length": [0.5, 0.2]}
THREE_POINTS = {
    "x": [0, 1.5, 2],
    "flexural_rigidity": [3, 2, 1],
    "mass_per_length": [0.5, 0.3, 0.2],
}


def problems_of(make, **values):
    """Return the lines of the error, without the name of the record."""
    with pytest.raises(ModelError) as caught:
        make(**values)
    return [line.removeprefix(f"{make.__name__}: ") for line in str(caught.value).splitlines()]


def test_beam_of_constants():
    beam = Link(**CONSTANTS).beam()
    assert beam == SectionTable(
        x=[0, 2],
        flexural_rigidity=[3, 3],
        mass_per_length=[0.5, 0.5],
        rotary_inertia_per_length=[0, 0],
    )
    beam = Link(**CONSTANTS, rotary_inertia_per_length=1e-4).beam()
    assert beam.rotary_inertia_per_length == (1e-4, 1e-4)


def test_beam_of_material_and_section():
    section = Circle(diameter=0.1)
    link = Link(length=1, material={"density": 2.0, "youngs_modulus": 5.0}, section=section)
    beam = link.beam()
    assert link.material == Material(density=2, youngs_modulus=5)
    assert beam.flexural_rigidity == (5 * section.second_moment,) * 2
    assert beam.mass_per_length == (2 * section.area,) * 2
    assert beam.rotary_inertia_per_length == (2 * section.second_moment,) * 2
    off = link.replace(rotary_inertia=False).beam()
    assert off.rotary_inertia_per_length == (0.0, 0.0)


def test_beam_of_a_table_ends_at_the_length():
    third = {**TABLE, "x": [0, 0.1 + 0.2]}  # 0.30000000000000004
    beam = Link(length=0.3, table=third).beam()
    assert beam.x == (0.0, 0.3)
    assert beam.rotary_inertia_per_length == (0.0, 0.0)
    with_column = Link(length=2, table={**TABLE, "rotary_inertia_per_length": [1, 2]})
    assert with_column.beam().rotary_inertia_per_length == (1.0, 2.0)
    off = with_column.replace(rotary_inertia=False)
    assert off.beam().rotary_inertia_per_length == (0.0, 0.0)


def test_rigid_link_needs_no_stiffness():
    rigid = Link(length=2, mass_per_length=0.5, flexible=False, modes=3)
    assert rigid.beam().flexural_rigidity is None
    assert rigid.coordinates == 0
    column = {"x": [0, 2], "mass_per_length": [1, 1]}
    assert Link(length=2, table=column, flexible=False).beam().flexural_rigidity is None
    assert Link(**CONSTANTS).replace(flexible=False).beam().flexural_rigidity == (3.0, 3.0)


def test_coordinates():
    assert Link(**CONSTANTS).coordinates == 8
    assert Link(**CONSTANTS, elements=3, modes=2).coordinates == 2
    assert Link(**CONSTANTS, elements=256, modes=512).coordinates == 512


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        ({"length": 1}, [f"mass_per_length is missing. {WAYS}"]),
        (
            {"length": 1, "flexural_rigidity": 1},
            [f"mass_per_length is missing. {WAYS}"],
        ),
        (
            {"length": 1, "mass_per_length": 1},
            [f"flexural_rigidity is missing. {RIGID} does not need it."],
        ),
        (
            {"length": 1, "material": "steel"},
            ["section is required with material."],
        ),
        (
            {"length": 1, "section": {"kind": "circle", "diameter": 0.1}},
            ["material is required with section."],
        ),
        (
            {**CONSTANTS, "table": TABLE, "rotary_inertia_per_length": 0},
            [
                f"flexural_rigidity cannot be combined with table. {WAYS}",
                f"mass_per_length cannot be combined with table. {WAYS}",
                (f"rotary_inertia_per_length cannot be combined with table. {WAYS}"),
            ],
        ),
        (
            {"length": 2, "table": {"x": [0, 2], "mass_per_length": [1, 0]}},
            [
                f"table.flexural_rigidity is missing. {RIGID} does not need it.",
                (
                    f"table.mass_per_length[1] must be greater than 0, got 0. {RIGID} may be "
                    "massless."
                ),
            ],
        ),
        (
            {"length": 2.5, "table": THREE_POINTS},
            [
                (
                    "table.x must end at 2.5 (the length of the link), got 2. A table covers "
                    "the link from root to tip."
                )
            ],
        ),
        (
            {**CONSTANTS, "mass_per_length": 0.0},
            [f"mass_per_length must be greater than 0, got 0. {RIGID} may be massless."],
        ),
        (
            {**CONSTANTS, "rotary_inertia": True},
            [("rotary_inertia requires rotary_inertia_per_length.")],
        ),
        (
            {"length": 2, "table": TABLE, "rotary_inertia": True},
            [("rotary_inertia requires rotary_inertia_per_length.")],
        ),
        (
            {**CONSTANTS, "elements": 3, "modes": 7},
            [
                (
                    "modes must be at most 6 (twice the number of elements of a segment), got 7. "
                    "Use more elements, or fewer modes."
                )
            ],
        ),
        (
            {**CONSTANTS, "elements": 100_000},
            [
                (
                    "elements must be at most 256, got 100000. The modal basis of a link is "
                    "dense: more elements increase memory and rounding errors and do not "
                    "improve the accuracy."
                )
            ],
        ),
        (
            {**CONSTANTS, "modes": 1, "damping": {"kind": "modal", "ratio": [0.1, 0.2]}},
            [
                (
                    "damping.ratio must have length at most 1 (the number of modes of the link), "
                    "got 2."
                )
            ],
        ),
        (
            {**CONSTANTS, "gauges": [Gauge(station=2, distance=0), Gauge(station=2.1, distance=0)]},
            ["gauges[1].station must be at most 2 (the length of the link), got 2.1."],
        ),
        ({**CONSTANTS, "damping": {"ratio": 0.1}}, ["damping.kind is missing."]),
        (
            {**CONSTANTS, "damping": {"kind": "modal", "ratio": 2}},
            [f"damping.ratio must be at most 1, got 2. {FRACTION}"],
        ),
        (
            {**CONSTANTS, "damping": {"kind": "raleigh"}},
            [
                (
                    "damping.kind must be one of 'modal', 'rayleigh', got 'raleigh'. "
                    "Did you mean 'rayleigh'?"
                )
            ],
        ),
        (
            {**CONSTANTS, "damping": 0.01},
            ["damping must be a mapping of keys to values, got 0.01."],
        ),
    ],
)
def test_wrong_links_are_rejected_with_every_reason(values, problems):
    assert problems_of(Link, **values) == problems


def test_problems_between_values_are_reported_with_those_of_single_values():
    values = {
        "length": -1,
        "EI": 3,
        "mas_per_length": 1,
        "elements": 2.5,
        "modes": 0,
        "flexible": "no",
        "gauges": [{"station": -1}],
    }
    assert problems_of(Link, **values) == [
        "length must be greater than 0, got -1.",
        "elements must be a whole number, got 2.5.",
        "modes must be at least 1, got 0.",
        "flexible must be true or false, got 'no'.",
        "gauges[0].station must be at least 0, got -1.",
        "gauges[0].distance is missing.",
        "EI is not a known key. Did you mean 'flexural_rigidity'?",
        "mas_per_length is not a known key. Did you mean 'mass_per_length'?",
        f"mass_per_length is missing. {WAYS}",
    ]


@pytest.mark.parametrize("value", [True, "1", None, [1.0], 1j, float("nan"), -np.inf, 10**400])
def test_only_finite_real_numbers_are_accepted(value):
    (problem,) = problems_of(Link, **{**CONSTANTS, "length": value})
    assert problem.startswith(("length must be a number", "length must be a finite number"))


@pytest.mark.parametrize("value", [np.float32(2), np.int8(2), np.array(2.0), 2])
def test_numpy_scalars_are_stored_as_plain_numbers(value):
    link = Link(**{**CONSTANTS, "length": value, "elements": np.int64(3), "flexible": np.True_})
    assert (link.length, link.elements, link.flexible) == (2.0, 3, True)
    assert (type(link.length), type(link.elements), type(link.flexible)) == (float, int, bool)


def test_links_take_keyword_arguments_and_are_frozen():
    with pytest.raises(TypeError, match=r"Link takes its values by name: Link\(name=value\)"):
        Link(1.0)
    with pytest.raises(ValidationError, match="frozen"):
        Link(**CONSTANTS).length = 3.0


def test_errors_are_model_errors_and_value_errors():
    with pytest.raises(ValueError, match="length"):
        Link(length=-1)
    with pytest.raises(InputError) as caught:
        Link(**{**CONSTANTS, "length": -1})
    (problem,) = caught.value.problems
    assert (problem.where, problem.name) == ("Link", "length")
    assert (problem.rule, problem.value) == ("be greater than 0", "-1")
    assert caught.value.__suppress_context__  # pydantic's own error would only repeat it


def test_replace_checks_again():
    link = Link(**CONSTANTS)
    assert link.replace(length=3).length == 3.0
    assert link.replace(length=3).model_fields_set == link.model_fields_set
    assert problems_of(link.replace, length=0) == ["Link: length must be greater than 0, got 0."]


def test_lists_and_tuples_are_equal():
    one = Link(**CONSTANTS, gauges=[Gauge(station=1, distance=1)])
    other = Link(**CONSTANTS, gauges=({"station": 1, "distance": 1},))
    assert one == other
    assert one.gauges == (Gauge(station=1, distance=1),)


def test_repr_shows_the_given_values():
    assert repr(Link(**CONSTANTS)) == (
        "Link(length=2.0, flexural_rigidity=3.0, mass_per_length=0.5)"
    )


def test_last_ratio_is_repeated_for_higher_modes():
    assert ModalDamping(ratio=0.1).ratios(3) == (0.1, 0.1, 0.1)
    assert ModalDamping(ratio=[0.1, 0.2]).ratios(4) == (0.1, 0.2, 0.2, 0.2)
    assert ModalDamping(ratio=np.array([0.1, 0.2])).ratios(1) == (0.1,)
    assert problems_of(ModalDamping, ratio=[]) == [
        "ratio is empty: give the ratio of at least the lowest mode."
    ]
    assert RayleighDamping(stiffness_coefficient=1).mass_coefficient == 0.0


def test_link_may_be_a_mapping_inside_an_arm():
    assert ArmSpec(links=[CONSTANTS]).links == (Link(**CONSTANTS),)
