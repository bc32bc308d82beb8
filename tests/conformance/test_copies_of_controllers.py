"""A copy of a controller, deep or through a pickle, answers as the controller does."""

import copy
import pickle

import numpy as np
import pytest
from controller_examples import EXAMPLES, two_links

import flexarm as fa
from flexarm.control import CONTROLLERS

#: The motion is violent and links bend far: nothing that is looked at here.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")


@pytest.fixture
def arm():
    return two_links()


def motion(arm):
    return fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3)


def copies_answer_alike(controller, arm):
    run = {"reference": motion(arm), "initial": arm.rest([0.2, -0.4]), "progress": False}
    first = fa.simulate(arm, 0.1, controller=controller, **run).torque.values
    for copied in (copy.deepcopy(controller), pickle.loads(pickle.dumps(controller))):
        again = fa.simulate(arm, 0.1, controller=copied, **run).torque.values
        np.testing.assert_array_equal(again, first)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_copy_answers_as_it_does(name, arm):
    """Studies hand controllers to other processes; what is used twice keeps its own state."""
    copies_answer_alike(EXAMPLES[name](), arm)


@pytest.mark.parametrize("kind", [fa.LQG, fa.MPC, fa.Composite])
def test_a_copy_follows_the_posture_as_it_does(kind, arm):
    angles = [[0.2, 0.5, 0.9], [-0.5, 0.0, 0.5]]
    copies_answer_alike(kind(arm, [0.5, 0.0], schedule=angles, torque_limit=50.0), arm)
