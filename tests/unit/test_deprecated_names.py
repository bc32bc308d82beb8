"""Deprecated public names work, warn when they are used, and are removed on time."""

import warnings
from importlib.metadata import version

import pytest

import flexarm as fa


@pytest.fixture
def renamed(monkeypatch):
    """Pretend that the former name of `Payload` was `TipMass`."""
    monkeypatch.setitem(fa._RENAMED, "TipMass", ("Payload", "99.0"))


def test_old_name_is_the_new_object_and_warns_at_its_use(renamed):
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        assert fa.TipMass is fa.Payload
        assert fa.TipMass is fa.Payload  # every use warns, not only the first one
    text = "flexarm.TipMass is deprecated and will be removed in flexarm 99.0; use flexarm.Payload."
    assert [str(warning.message) for warning in record] == [text] * 2
    assert {warning.category for warning in record} == {DeprecationWarning}
    assert {warning.filename for warning in record} == {__file__}


def test_import_of_an_old_name_warns(renamed):
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        from flexarm import TipMass
    assert TipMass is fa.Payload
    assert {warning.filename for warning in record} == {__file__}


def test_old_names_are_not_listed(renamed):
    assert "TipMass" not in dir(fa)
    assert "TipMass" not in fa.__all__


def test_old_names_lead_to_public_names_and_are_removed_on_time():
    now = numbers(version("flexarm"))
    for old, (new, removal) in fa._RENAMED.items():
        assert old not in fa.__all__
        assert new in fa.__all__
        assert now < numbers(removal), f"{old} was to be removed in {removal}"


def numbers(text):
    """Return major and minor version."""
    return tuple(int(part) for part in text.split(".")[:2])


class _Former:
    """Controller of a user with the former method of its requirements."""

    sample_time = 0.01

    def reset(self):
        pass

    def update(self, t, measurement, reference):
        return [0.0]

    def needs(self, arm, reference):
        return fa.ControllerRequirements(measured=("tip",))


def test_former_method_of_a_controllers_requirements_works_and_warns():
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    with (
        pytest.warns(DeprecationWarning, match=r"_Former\.needs is deprecated"),
        pytest.raises(fa.InputError, match="has no instrument for tip, which _Former reads"),
    ):
        fa.simulate(arm, 0.1, controller=_Former())
    with pytest.warns(DeprecationWarning, match=r"use JointPD\.requirements"):
        assert fa.JointPD(1.0, 1.0).needs(arm, None) == fa.JointPD(1.0, 1.0).requirements(arm, None)


def test_names_of_the_memory_of_an_update_have_no_effect_and_warn():
    with pytest.warns(DeprecationWarning, match=r"The tuple Old\.memory is deprecated .* use step"):

        class Old(fa.Controller):
            sample_time = 0.01
            memory = ("integral",)

            def update(self, t, measurement, reference):
                return [0.0]

    assert Old().sample_time == 0.01
