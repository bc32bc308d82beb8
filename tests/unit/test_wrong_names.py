"""Misspelt arguments and attributes: errors that suggest the right name."""

import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.5)
ARM = fa.Arm(links=[LINK], joints=[fa.Joint(hub_inertia=0.05)])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: fa.simulate(ARM, 1.0, integrater="rk4", ratee=100.0),
            (
                "simulate: integrater is not an argument. Did you mean 'integrator'?\n"
                "simulate: ratee is not an argument. Did you mean 'rate'?"
            ),
        ),
        (lambda: ARM.tip(qq=[0.0]), "Arm.tip: qq is not an argument. Did you mean 'q'?"),
        (
            lambda: fa.JointPD(kp=1.0, derivative=1.0),
            "JointPD: kp is not an argument. Did you mean 'proportional'?",
        ),
        (
            lambda: fa.LQG(ARM, postur=[0.0]),
            "LQG: postur is not an argument. Did you mean 'posture'?",
        ),
        (
            lambda: fa.Arm([LINK]),
            "Arm: links must be given by name. Use Arm(links=[...], joints=[...]).",
        ),
    ],
)
def test_unknown_arguments(call, message):
    with pytest.raises(fa.ArgumentError) as error:
        call()
    assert str(error.value) == message
    assert isinstance(error.value, TypeError)  # what Python raises for such calls


def test_arms_are_named_as_users_write_them():
    with pytest.raises(
        fa.ModelError, match=r"^Arm: link is not a known key\. Did you mean 'links'"
    ):
        fa.Arm(links=[LINK], link=[LINK])


@pytest.mark.parametrize(
    ("module", "name", "right"),
    [(fa, "simulte", "simulate"), (fa, "JointPd", "JointPD"), (fa.plot, "histroy", "history")],
)
def test_unknown_attributes_of_modules(module, name, right):
    with pytest.raises(AttributeError, match=rf"Did you mean '{right}'\?$"):
        getattr(module, name)
    with pytest.raises(AttributeError) as error:
        module.__path_of_another_library__  # noqa: B018
    assert "Did you mean" not in str(error.value)


def test_initial_rates_of_joints_name_the_conversion():
    with pytest.raises(fa.InputError, match=r"initial_rate must have shape .*Arm\.rest\("):
        fa.simulate(ARM, 0.1, initial_rate=[3.0])
    result = fa.simulate(ARM, 0.01, initial_rate=ARM.rest([3.0]))
    assert result.joint_rate.values[0, 0] == 3.0
