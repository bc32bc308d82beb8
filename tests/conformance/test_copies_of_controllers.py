"""A copy of a controller, deep or through a pickle, answers as the controller does."""

import copy
import pickle

import numpy as np
import pytest
from controller_examples import EXAMPLES, two_links

import flexarm as fa
from flexarm.controllers import CONTROLLERS

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


def in_loop(controller, plant, reference, ticks):
    """Torques (ticks, joints) that a controller gives, stepping the plant by hand."""
    torques = []
    for _ in range(ticks):
        torques.append(controller.update(plant.time, plant.measurement, reference))
        plant.step(torques[-1])
    return np.array(torques)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_copy_in_the_middle_of_a_run_goes_on_as_it_does(name, arm):
    controller, path = EXAMPLES[name](), motion(arm)
    plant = fa.Plant(arm, controller.sample_time, warn=False)
    plant.reset(arm.rest([0.2, -0.4]))
    controller.reset()
    in_loop(controller, plant, path, 40)
    other, rigid_counterpart = copy.deepcopy((controller, plant))
    np.testing.assert_array_equal(
        in_loop(other, rigid_counterpart, path, 20), in_loop(controller, plant, path, 20)
    )


class Plain:
    """A motion that answers one time after another, and none after its end."""

    def __init__(self, of):
        self._of, self.end_time = of, of.end_time

    def _asked(self, name, t):
        assert isinstance(t, float)
        assert t <= self.end_time
        return getattr(self._of, name)(t)

    def joint_angle(self, t):
        return self._asked("joint_angle", t)

    def joint_rate(self, t):
        return self._asked("joint_rate", t)

    def joint_acceleration(self, t):
        return self._asked("joint_acceleration", t)


@pytest.mark.parametrize("preview", [0.0, 0.1])
def test_a_reference_of_single_times_is_followed_alike(preview, arm):
    """Over 500 samples, 200 of them after its end: many times around the buffers."""
    path = motion(arm)
    found = []
    for reference in (path, Plain(path)):
        controller = fa.LQG(arm, [0.5, 0.0], preview=preview)
        plant = fa.Plant(arm, controller.sample_time, warn=False)
        plant.reset(arm.rest([0.2, -0.4]))
        found.append(in_loop(controller, plant, reference, 500))
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9)


def test_another_reference_is_followed_at_once_where_nothing_is_previewed(arm):
    controller = fa.LQG(arm, [0.5, 0.0], preview=0.0)
    plant = fa.Plant(arm, controller.sample_time, warn=False)
    plant.reset(arm.rest([0.2, -0.4]))
    in_loop(controller, plant, motion(arm), 10)
    nearby = fa.joint_motion(arm, [0.25, -0.4], [0.9, 0.5], 0.3)
    before = copy.deepcopy(controller).update(plant.time, plant.measurement, motion(arm))
    after = controller.update(plant.time, plant.measurement, nearby)
    assert np.max(np.abs(after - before)) > 1e-3
