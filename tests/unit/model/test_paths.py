"""Numbers of a record by their path in a file."""

import pytest

import flexarm as fa
from flexarm.model.paths import number_at, number_paths, with_number


@pytest.fixture
def spec():
    return fa.Arm(
        links=[
            {"length": 0.5, "flexural_rigidity": 3.0, "mass_per_length": 1.0},
            {"length": 0.6, "material": "steel", "section": fa.Circle(diameter=0.01)},
        ],
        joints=[{"friction": {"coulomb": 0.1}}, {}],
    ).spec


def test_every_path_reads_and_writes_its_number(spec):
    paths = list(number_paths(spec))
    assert len(paths) == len(set(paths))
    assert {"links[1].section.diameter", "joints[0].friction.coulomb", "gravity[1]"} <= set(paths)
    for path in paths:
        changed = with_number(spec, path, 7.0, checked=False)
        assert number_at("path", changed, path) == 7.0
        others = [other for other in paths if other != path]
        for other in others:
            before = number_at("path", spec, other)
            assert number_at("path", changed, other) == before


def test_checked_copy_validates_values(spec):
    assert with_number(spec, "payload.mass", 2.0).payload.mass == 2.0
    with pytest.raises(fa.ModelError, match="length"):
        with_number(spec, "links[0].length", -1.0)
