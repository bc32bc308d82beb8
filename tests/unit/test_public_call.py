"""The boundary of public calls: the names that problems get there, and what it leaves unchanged."""

import inspect
import pickle

import numpy as np
import pytest

import flexarm as fa
from flexarm.base.errors import InputError, check_array, public_call, public_call_as
from flexarm.model.quantities import Count, Flag, Number
from flexarm.model.scenarios.scenario import RunSpec


@public_call
def scaled(factor: float, *, by: float = 2.0) -> float:
    """Return the product."""
    return by * float(check_array("factor", factor, ()))


@public_call_as("plot.scaled")
def drawn(factor):
    return check_array("factor", factor, ())


@public_call
def rounded(value: Number, digits: "Count | None" = None, *, strict: Flag = False) -> float:
    return round(value, digits)


def test_arguments_are_validated_and_converted_by_their_types():
    assert rounded(np.float64(2.345), digits=np.int64(1)) == 2.3
    assert rounded(2.7, None) == 3.0
    for call, text in (
        (lambda: rounded("2"), "value must be a number, got '2'."),
        (lambda: rounded(2.0, 0), "digits must be a whole number from 1 to 1000000, got 0."),
        (lambda: rounded(2.0, digits=1.5), "digits must be a whole number"),
        (lambda: rounded(2.0, strict=1), "strict must be True or False, got 1."),
    ):
        with pytest.raises(InputError, match=rf"^rounded: {text}"):
            call()


def test_files_and_functions_have_the_same_rule_of_a_tolerance():
    arm = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
    for call in (lambda: fa.simulate(arm, 1.0, rtol=5), lambda: RunSpec(duration=1.0, rtol=5)):
        with pytest.raises(InputError, match=r"rtol must be less than 1, got 5\."):
            call()


class Base:
    @public_call
    def __init__(self, size=1.0):
        check_array("size", size, ())

    @public_call
    def tip(self, q):
        return check_array("q", q, (2,))

    @public_call
    def __call__(self, t):
        return check_array("t", t, ())

    @classmethod
    @public_call
    def made(cls, size):
        check_array("size", size, ())
        return cls(size)


class Derived(Base):
    pass


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: scaled("no"), "scaled"),
        (lambda: drawn("no"), "plot.scaled"),
        (lambda: Base("no"), "Base"),
        (lambda: Derived("no"), "Derived"),
        (lambda: Base().tip("no"), "Base.tip"),
        (lambda: Derived().tip("no"), "Derived.tip"),
        (lambda: Derived.tip(Derived(), "no"), "Derived.tip"),
        (lambda: Derived()("no"), "Derived"),
        (lambda: Derived.made("no"), "Derived.made"),
    ],
)
def test_problem_gets_the_name_of_the_call(call, where):
    with pytest.raises(InputError) as caught:
        call()
    (problem,) = caught.value.problems
    assert problem.where == where
    assert caught.value.args == caught.value.problems


def test_link_of_an_arm_is_named_by_its_index():
    table = {"x": [0.0, 0.5 - 1e-9, 0.5, 1.0], "flexural_rigidity": [1.0, 1.0, 1e30, 1e30]}
    table["mass_per_length"] = [1.0, 1.0, 1e-30, 1e-30]
    links = [fa.Link(length=1.0, mass_per_length=1.0, flexible=False)]
    links.append(fa.Link(length=1.0, table=table, elements=4))
    with pytest.raises(InputError, match=r"^arm\.links\[1\]: the stiffness is not positive"):
        fa.Arm(links=links)


def test_error_keeps_its_class_its_traceback_and_its_cause():
    with pytest.raises(fa.ModelError, match=r"^Link: length must be") as caught:
        fa.Link(length=-1.0)
    assert caught.value.__cause__ is None
    with pytest.raises(InputError) as caught:
        scaled("no")
    names = [entry.name for entry in caught.traceback]
    assert names[-1] == "check_array"
    assert names.count("scaled") == 1
    assert caught.value.__context__ is None


def test_function_keeps_its_signature_its_documentation_and_pickles():
    assert str(inspect.signature(fa.simulate)).startswith("(arm: 'Arm', duration: 'float'")
    assert list(inspect.signature(scaled).parameters) == ["factor", "by"]
    assert scaled.__doc__ == "Return the product."
    assert (scaled.__name__, scaled.__module__) == ("scaled", __name__)
    assert pickle.loads(pickle.dumps(fa.simulate)) is fa.simulate
    assert scaled(2.0, by=3.0) == 6.0
