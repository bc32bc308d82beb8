"""Mode shapes, lines of frequencies and responses are drawn as they were computed."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.plot.response import response_figure
from flexarm.plot.vibration import modes_figure, tracks_figure

# Links bend further here than their theory holds for, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

LINK = fa.Link(
    length=0.5,
    flexural_rigidity=3.0,
    mass_per_length=0.4,
    elements=2,
    damping={"kind": "modal", "ratio": 0.01},
)
ARM = fa.Arm(links=[LINK, LINK], theory="second_order")


def test_shapes():
    found = fa.modes(ARM, [0.2, 0.5])
    figure = modes_figure(found, 4)
    assert len(figure.axes) == 4
    title = figure.axes[0].get_title(loc="left")
    assert title == f"1: {found.frequency_hz[0]:.4g} Hz, {100 * found.damping_ratio[0]:.2g} %"
    rest, curve = (line.get_xydata() for line in figure.axes[1].get_lines()[:2])
    np.testing.assert_allclose(rest, ARM.shape(found.q)[0])
    away = np.linalg.norm(found.curves(amplitude=0.12)[1] - ARM.shape(found.q), axis=-1)
    np.testing.assert_allclose(np.linalg.norm(curve - rest, axis=1), away[0], atol=1e-12)
    free = modes_figure(fa.modes(ARM, joints="free"), 2)
    assert free.axes[0].get_title(loc="left") == "1: does not vibrate"


def test_lines():
    tracks = fa.campbell(ARM, np.linspace(0.0, 60.0, 5), count=2)
    above, below = tracks_figure(tracks).axes
    np.testing.assert_array_equal(above.get_lines()[0].get_ydata(), tracks.frequency_hz[:, 0])
    np.testing.assert_array_equal(
        below.get_lines()[1].get_ydata(), 100 * tracks.damping_ratio[:, 1]
    )
    assert above.get_xlabel() == "spin [rad/s]"
    once = above.get_lines()[2]  # once in each turn
    np.testing.assert_allclose(once.get_ydata(), tracks.parameter / (2 * np.pi))


def test_responses():
    model = fa.linearize(ARM, fa.equilibrium(ARM, [0.2, 0.5]), outputs=["tip", "joint_angle"])
    omega = np.array([1.0, 30.0])
    figure = response_figure(model, omega)
    gain = figure.axes[1].get_lines()[0].get_ydata()
    system = model.to_control()
    expected = [abs(system["tip[y]", "torque[1]"](1j * w)) for w in omega]
    assert gain == pytest.approx(expected, rel=1e-9)
    assert figure.axes[1].get_ylabel() == "tip[y] [m]"
    assert len(response_figure(model).axes) == 4
