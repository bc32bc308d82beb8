"""Outputs of linear models are channels of results, with the same names, units and order."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.linear.models.state_space import CHANNEL_OUTPUTS
from flexarm.simulation.run.channels import CHANNELS

LINK = fa.Link(
    length=0.5,
    flexural_rigidity=3.0,
    mass_per_length=0.4,
    elements=1,
    gauges=[fa.Gauge(station=0.1, distance=0.002)],
)
ARM = fa.Arm(links=[LINK, LINK], gravity=(0.0, -9.81))


# The soft links hang down far, which does not affect the comparison.
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.parametrize("name", CHANNEL_OUTPUTS)
def test_output_equals_the_channel_of_its_name(name):
    by, unit = CHANNEL_OUTPUTS[name]
    assert CHANNELS[name].unit == unit
    assert CHANNELS[name].dims[:1] == ((by,) if by else ())
    touched = [fa.Contact(fa.Wall((0.0, 0.5), (0.1, 1.0)), 10.0)]
    rest = fa.equilibrium(ARM, [0.3, 0.2], contacts=touched)
    shown = fa.linearize(ARM, rest, outputs=name).output
    run = fa.simulate(ARM, 0.01, initial=rest.q, torque=lambda t: rest.torque, contacts=touched)
    np.testing.assert_allclose(shown, np.ravel(run[name].values[0]), rtol=1e-12, atol=1e-15)


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # bent by more than 10 %
def test_citation_names_the_methods():
    model = fa.linearize(ARM)
    assert "SquireTrapp1998" in fa.citation(model)
    assert f"version = {{{fa.__version__}}}" in fa.citation(model)
    tracks = fa.track_modes(ARM, [[0.0, 0.1]], count=1)
    assert "AllemangBrown1982" in fa.citation(tracks)
    with pytest.raises(fa.InputError, match="be a result of simulate"):
        fa.citation(ARM)
