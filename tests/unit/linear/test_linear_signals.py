"""Outputs of linear models are channels of results, with the same names, units and order."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.linear.models.signals import CHANNEL_OUTPUTS
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


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"link": "two"}, "Sensor: link must be a whole number, got 'two'"),
        ({"link": 1.5}, "Sensor: link must be a whole number"),
        ({"link": 0}, "Sensor: link must be at least 1, got 0"),
        ({"link": True}, "Sensor: link must be a whole number, got True"),
        ({"station": -0.1}, "Sensor: station must be at least 0, got -0.1"),
        ({"station": "tip"}, "Sensor: station must be a number, got 'tip'"),
        ({"station": np.nan}, "Sensor: station must be a finite number"),
    ],
)
def test_impossible_sensors_are_rejected(fields, message):
    with pytest.raises(fa.InputError, match=message):
        fa.Sensor(**{"kind": "position", "link": 1, **fields})


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (fa.Sensor("position", 3), "linearize: Sensor.link must be the number of a link, 1 to 2"),
        (
            fa.Sensor("velocity", 1, 0.7),
            r"Sensor.station must be at most 0.5 \(the length of the link\), got 0.7",
        ),
    ],
)
def test_sensor_off_the_arm_is_reported_by_its_name(sensor, message):
    with pytest.raises(fa.InputError, match=message):
        fa.linearize(ARM, outputs=sensor)


@pytest.mark.parametrize("name", ["inputs", "outputs"])
def test_arguments_that_are_not_lists_are_rejected(name):
    with pytest.raises(fa.InputError, match="inputs and outputs must be names, Loads or Sensors"):
        fa.linearize(ARM, **{name: 5})
