"""Arms, and laws of strain damping as their steps have them, for their tests."""

import control
import numpy as np

import flexarm as fa
from controllers import Law
from flexarm.control.analysis.linear_controller import linear_controller

TICK = 1e-4


def echo():
    """Return an inner controller whose torques are the angles of its reference."""
    return Law(lambda readings, inputs: inputs["reference_angle"], TICK)


def one_link(modes=1, **changes):
    gauge = fa.Gauge(station=0.05, distance=0.005)
    link = {"length": 1.0, "flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    joint = fa.Joint(hub_inertia=5.0)
    return fa.Arm(links=[fa.Link(**link, modes=modes, gauges=[gauge])], joints=[joint], **changes)


def strain_rows(arm):
    """Return the derivative (gauges, dof) of the strains by q."""
    return fa.linearize(arm, outputs=["strain"]).C[:, : arm.dof]


def modal_law(law, **options):
    """Return the law from the modal signal y to the motion u, sampled, and the frequency, rad/s."""
    arm = one_link()
    controller = law(arm, echo(), **options)
    zero = {"joint_angle": np.zeros(1), "joint_rate": np.zeros(1), "strain": np.zeros(1)}
    found = linear_controller(controller, zero)
    mode = fa.modes(arm)
    shape = mode.shapes[0]
    strain = float((strain_rows(arm) @ shape)[0])
    driven = float(shape @ arm.mass_matrix(arm.rest([0.0]))[:, 0])
    B, D = found.B[:, 2:] * -strain, driven * found.D[:, 2:] * -strain
    sampled = control.ss(found.A, B, driven * found.C, D, TICK)
    return sampled, 2.0 * np.pi * float(mode.frequency_hz[0])


def continuous(sampled):
    """Return the continuous law whose Tustin equivalent is ``sampled``."""
    A, B, C, D = (np.asarray(part) for part in (sampled.A, sampled.B, sampled.C, sampled.D))
    one = np.eye(len(A))
    inverse = np.linalg.inv(one + A)
    slow = 2.0 / TICK * inverse @ (A - one)
    return control.ss(slow, 2.0 / TICK * inverse @ B, 2.0 * C @ inverse, D - C @ inverse @ B)


def closed_poles(law, plant):
    """Return the poles of u = law y, y = plant u, with positive feedback."""
    found = control.feedback(plant, law, sign=1).poles()
    return found[np.argsort(abs(found))]


def base_driven(omega):
    """Return the modal signal of a link whose base moves, (C.17)."""
    return control.tf([1.0, 0.0, 0.0], [1.0, 0.0, omega**2])


def two_links():
    gauge = fa.Gauge(station=0.05, distance=0.005)
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.6, "elements": 1, "gauges": [gauge]}
    joints = [fa.Joint(hub_inertia=0.2), fa.Joint(mass=0.5, hub_inertia=0.1, housing_inertia=0.02)]
    return fa.Arm(links=[fa.Link(length=1.4, **rod), fa.Link(length=1.0, **rod)], joints=joints)
