"""Simulation: an arm, a drive, a duration; a labelled dataset."""

from flexarm.simulate.channels import CHANNELS, Channel
from flexarm.simulate.prescribed import PrescribedAngle
from flexarm.simulate.run import simulate
from flexarm.simulate.scenario import Prepared, prepare, run_scenario
from flexarm.simulate.torque_history import TorqueHistory, sampled_torque

__all__ = [
    "CHANNELS",
    "Channel",
    "Prepared",
    "PrescribedAngle",
    "TorqueHistory",
    "prepare",
    "run_scenario",
    "sampled_torque",
    "simulate",
]
