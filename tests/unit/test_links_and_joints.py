"""`arm.links` and `arm.joints`: sequences, which still convert to the counts that they were."""

import copy
import pickle
import warnings
from collections.abc import Sequence

import numpy as np
import pytest

import flexarm as fa

RIGID = fa.Link(length=1.0, mass_per_length=1.0, flexible=False)
LINKS = [RIGID, RIGID.replace(length=0.5), RIGID.replace(length=0.25)]
JOINTS = [fa.Joint(), fa.Joint(fixed=True), fa.Joint(damping=0.1)]
ARM = fa.Arm(links=LINKS, joints=JOINTS)


def test_items_are_those_of_files_and_messages():
    assert (len(ARM.links), len(ARM.joints)) == (3, 3)
    assert (ARM.n_links, ARM.n_joints) == (3, 2)
    assert [*ARM.links] == LINKS
    assert ARM.links[1].length == 0.5
    assert ARM.links[-1] is ARM.spec.links[2]
    assert ARM.joints[1:] == (JOINTS[1], JOINTS[2])
    assert [*reversed(ARM.joints)] == JOINTS[::-1]
    assert isinstance(ARM.links, Sequence)
    assert JOINTS[2] in ARM.joints
    assert ARM.joints.index(JOINTS[1]) == ARM.joints.count(JOINTS[2]) == 1
    with pytest.raises(IndexError):
        ARM.links[3]


def test_items_describe_other_arms():
    assert fa.Arm(links=ARM.links, joints=ARM.joints).spec == ARM.spec
    longer = fa.Arm(links=[*ARM.links, RIGID])
    assert (longer.links == ARM.links, longer.links != ARM.links) == (False, True)
    for twin in (copy.deepcopy(ARM.links), pickle.loads(pickle.dumps(ARM.links))):
        assert twin == ARM.links == ARM.spec.links
        assert hash(twin) == hash(ARM.links)
    assert repr(ARM.joints) == repr(ARM.spec.joints)


def test_items_are_not_assigned():
    with pytest.raises(TypeError, match=r"arm cannot be changed; use flexarm\.Arm\(links="):
        ARM.links[0] = RIGID
    with pytest.raises(TypeError, match="cannot be changed"):
        ARM.joints.pop(0)


#: Uses of the former number of joints, 2, and their results.
FORMER = {
    "zeros": (lambda n: np.zeros(n), [0.0, 0.0]),
    "full": (lambda n: np.full(n, 0.3), [0.3, 0.3]),
    "rows": (lambda n: np.zeros((1, n)), [[0.0, 0.0]]),
    "eye": (lambda n: np.eye(n), [[1.0, 0.0], [0.0, 1.0]]),
    "arange": (lambda n: np.arange(n), [0, 1]),
    "linspace": (lambda n: np.linspace(0.0, 1.0, n), [0.0, 1.0]),
    "reshape": (lambda n: np.arange(4).reshape(-1, n), [[0, 1], [2, 3]]),
    "random": (lambda n: np.random.default_rng(1).normal(size=n).shape, [2]),
    "array": (lambda n: np.array([1.0, 2.0]) * n, [2.0, 4.0]),
    "slice": (lambda n: [5, 6, 7][:n], [5, 6]),
    "index": (lambda n: [5, 6, 7][n], 7),
    "range": (lambda n: list(range(n)), [0, 1]),
    "list": (lambda n: [0.0] * n, [0.0, 0.0]),
    "sum": (lambda n: [n + 1, 1 + n, n - 1, 3 - n, 2 * n, n / 4, 5 // n, n**3], None),
    "order": (lambda n: [n < 3, n <= 1, n > 1, n >= 3, n == 2, n != 2], None),
    "conversions": (lambda n: [int(n), float(n)], [2, 2.0]),
}


@pytest.mark.parametrize("name", FORMER)
def test_former_number_works_and_warns(name):
    function, expected = FORMER[name]
    expected = function(2) if expected is None else expected
    text = r"arm\.joints as a number is deprecated .* 0\.3; use arm\.n_joints, or len\("
    with pytest.warns(DeprecationWarning, match=text):
        value = function(ARM.joints)
    assert np.asarray(value).dtype != object
    np.testing.assert_array_equal(value, expected)


def test_former_number_of_links_warns_at_its_line():
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        assert np.zeros(ARM.links).shape == (3,)
    assert [warning.filename for warning in record] == [__file__]
    assert "use arm.n_links" in str(record[0].message)


def test_sequences_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len([*zip(ARM.links, ARM.joints, strict=True)]) == 3
        assert f"{ARM.links}" == str(ARM.spec.links)
        assert ARM.joints == ARM.spec.joints
        assert ARM.joints != [1, 2]


def test_sequences_of_links_are_joined_to_lists():
    link = fa.Link(length=0.3, flexural_rigidity=1.0, mass_per_length=1.0)
    arm = fa.Arm(links=[link, link])
    longer = fa.Arm(links=arm.links + [link])  # noqa: RUF005
    assert len(longer.links) == 3
    assert [link] + arm.links == [link, link, link] == arm.links + (link,)  # noqa: RUF005
