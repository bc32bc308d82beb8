"""A copy of a controller, by `deepcopy` or pickle, gives the same answers as the original."""

import copy
import pickle

import numpy as np
import pytest
from controller_examples import EXAMPLES, two_links

import flexarm as fa
from flexarm.control.laws import CONTROLLERS

#: The motion is fast and links bend far, which is not the subject of these tests.
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


@pytest.mark.sampled("joint_pd", "lqg")
@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_copy_gives_the_same_torques(name, arm):
    """Studies pass controllers to other processes; a controller used twice has two states."""
    copies_answer_alike(EXAMPLES[name](), arm)


@pytest.mark.sampled("LQG")
@pytest.mark.parametrize("kind", [fa.LQG, fa.MPC, fa.Composite])
def test_a_copy_follows_the_posture_in_the_same_way(kind, arm):
    angles = [[0.2, 0.5, 0.9], [-0.5, 0.0, 0.5]]
    copies_answer_alike(kind(arm, [0.5, 0.0], schedule=angles, torque_limit=50.0), arm)


def in_loop(controller, plant, reference, ticks):
    """Step the plant with a controller and return its torques (samples, joints)."""
    torques = []
    for _ in range(ticks):
        torques.append(controller.update(plant.time, plant.measurement, reference))
        plant.step(torques[-1])
    return np.array(torques)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_copy_made_during_a_run_continues_in_the_same_way(name, arm):
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
    """A motion that accepts scalar times only, and none after its end."""

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


@pytest.mark.sampled("0.0")
@pytest.mark.parametrize("preview", [0.0, 0.1])
def test_a_reference_of_scalar_times_gives_the_same_torques(preview, arm):
    """Over 500 samples, 200 of them after its end, so that buffers are filled many times."""
    path = motion(arm)
    found = []
    for reference in (path, Plain(path)):
        controller = fa.LQG(arm, [0.5, 0.0], preview=preview)
        plant = fa.Plant(arm, controller.sample_time, warn=False)
        plant.reset(arm.rest([0.2, -0.4]))
        found.append(in_loop(controller, plant, reference, 500))
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9)


def test_a_new_reference_takes_effect_immediately_without_preview(arm):
    controller = fa.LQG(arm, [0.5, 0.0], preview=0.0)
    plant = fa.Plant(arm, controller.sample_time, warn=False)
    plant.reset(arm.rest([0.2, -0.4]))
    in_loop(controller, plant, motion(arm), 10)
    nearby = fa.joint_motion(arm, [0.25, -0.4], [0.9, 0.5], 0.3)
    before = copy.deepcopy(controller).update(plant.time, plant.measurement, motion(arm))
    after = controller.update(plant.time, plant.measurement, nearby)
    assert np.max(np.abs(after - before)) > 1e-3
