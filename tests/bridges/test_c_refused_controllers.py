"""Controllers that cannot be exported to C, and the reasons."""

import numpy as np
import pytest

import flexarm as fa
from bridges.test_c_controllers import LAWS, REFUSED, OwnController, heavy
from conformance.controller_examples import EXAMPLES, two_links


def test_refusal_of_a_filter_names_the_parts_to_export(tmp_path):
    with pytest.raises(fa.InputError, match="`inner` and `estimator`"):
        fa.export_c(two_links(), tmp_path, controller=EXAMPLES["estimator"]())


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_refused_by_name_with_the_reason(name, tmp_path):
    controller, folder = EXAMPLES[name](), tmp_path / "new"
    kind = type(controller).__name__
    with pytest.raises(fa.InputError, match=rf"closed form, got {kind}\. It"):
        fa.export_c(two_links(), folder, controller=controller)
    assert not folder.exists()


@pytest.mark.thorough
def test_laws_that_symbols_cannot_follow(tmp_path):
    arm = heavy()

    class Counts(OwnController):
        def step(self, memory, readings, inputs):
            angle = readings["joint_angle"][0]
            return memory, np.full(2, sum(angle > 0.1 * k and 1.0 for k in range(9)))

    class Rounds(OwnController):
        def step(self, memory, readings, inputs):
            return memory, np.full(2, float(readings["joint_angle"][0]))

    class Updates(OwnController):
        def update(self, t, measurement, reference):
            return np.zeros(2)

    class Searches(OwnController):
        def step(self, memory, readings, inputs):
            return memory, np.linalg.solve(np.eye(2), readings["joint_angle"])

    reasons = {
        Counts: "more than 256 paths",
        Rounds: "the number of a symbol",
        Updates: "an update instead of a step",
        Searches: "symbols",
    }
    for kind, reason in reasons.items():
        with pytest.raises(fa.InputError, match=f"got {kind.__name__}.*{reason}"):
            fa.export_c(arm, tmp_path / "new", controller=kind())
    one = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=5.0, mass_per_length=0.5)])
    with pytest.raises(fa.InputError, match="1 joint"):
        fa.export_c(one, tmp_path / "new", controller=LAWS["computed_torque"]())
    assert not (tmp_path / "new").exists()
