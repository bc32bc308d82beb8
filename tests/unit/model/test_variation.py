"""Plants that differ from their arm by factors."""

import numpy as np
import pytest

import flexarm as fa


def arm(**options):
    links = [
        fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=0.5, elements=2),
        fa.Link(
            length=0.5,
            material="aluminium",
            section=fa.Box(width=0.03, height=0.02, thickness=0.002),
        ),
    ]
    options = {"payload": fa.Payload(mass=0.2, inertia=0.01), **options}
    return fa.Arm(links=links, **options)


def test_default_factors_change_nothing():
    assert fa.varied(arm()).spec == arm().spec


def test_payload():
    changed = fa.varied(arm(), payload_factor=3.0).spec.payload
    assert changed.mass == pytest.approx(0.6)
    assert changed.inertia == pytest.approx(0.03)
    assert fa.varied(arm(), payload_factor=0.0).spec.payload.mass == 0.0
    given = fa.varied(arm(), payload_mass=0.7).spec.payload
    assert (given.mass, given.inertia) == (0.7, 0.01)


@pytest.mark.parametrize("elements", [1, 4])
def test_rigidity_of_any_kind_of_link(elements):
    """A clamped link's frequencies rise with the root of its rigidity, for every description."""
    first = arm()
    table = fa.SectionTable(x=[0.0, 0.5], flexural_rigidity=[4.0, 2.0], mass_per_length=[0.5, 0.3])
    links = [link.replace(elements=elements) for link in first.spec.links]
    links.append(fa.Link(length=0.5, table=table, elements=elements))
    first = fa.Arm(links=links)
    changed = fa.varied(first, flexural_rigidity_factor=0.6)
    w2, before = changed.assembly.constants.w2, first.assembly.constants.w2
    np.testing.assert_allclose(w2, 0.6 * before, rtol=1e-9)
    one = fa.varied(first, flexural_rigidity_factor=[1.0, 0.5, 2.0]).assembly.constants.w2
    np.testing.assert_allclose(one, np.array([[1.0], [0.5], [2.0]]) * before, rtol=1e-9)


def test_mass_of_any_kind_of_link():
    first = arm()
    changed = fa.varied(first, mass_factor=1.5)
    for name in ("mass", "first_moment_x", "inertia"):
        before = getattr(first.assembly.constants, name)
        np.testing.assert_allclose(getattr(changed.assembly.constants, name), 1.5 * before)


def test_friction():
    rubs = fa.Friction(coulomb=0.3)
    both = fa.varied(arm(), friction=rubs)
    assert [joint.friction for joint in both.spec.joints] == [rubs, rubs]
    second = fa.varied(arm(), friction=[None, rubs])
    assert [joint.friction for joint in second.spec.joints] == [None, rubs]
    fixed = fa.varied(arm(joints=[fa.Joint(), fa.Joint(fixed=True)]), friction=rubs)
    assert fixed.spec.joints[1].friction is None


def test_all_problems_are_reported():
    with pytest.raises(fa.InputError) as caught:
        fa.varied(
            arm(),
            payload_factor=-1.0,
            flexural_rigidity_factor=[1.0, 2.0, 3.0],
            mass_factor=0.0,
            friction="rust",
        )
    names = {problem.name for problem in caught.value.problems}
    assert names == {"payload_factor", "flexural_rigidity_factor", "mass_factor", "friction"}
    with pytest.raises(fa.InputError, match="payload_mass"):
        fa.varied(arm(payload=fa.Payload()), payload_factor=2.0)
    with pytest.raises(fa.InputError, match="cannot be combined"):
        fa.varied(arm(), payload_factor=2.0, payload_mass=1.0)
    with pytest.raises(fa.InputError, match="number"):
        fa.varied(arm(), flexural_rigidity_factor=float("nan"))


def test_overflowing_squares_of_masses_are_accepted():
    heavy = fa.varied(
        fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)]), mass_factor=1e200
    )
    inverse = heavy.assembly.constants.inverse_inertia[0]
    assert inverse == pytest.approx(12e-200, rel=1e-12)  # 1 / (m L^2 / 12)
