"""Controllers of the tip position and the contact force, for motions that press on a surface."""

from __future__ import annotations

from flexarm.model.drives.base import ControllerParameters, SampleTime
from flexarm.model.quantities import Count, NonNegative, Positive


class HybridForceParameters(ControllerParameters):
    """Hybrid control: position along a surface, force normal to it."""

    name = "hybrid_force"
    frequency: Positive = 8.0
    """Natural frequency of the error along the surface (rad/s)."""
    damping_ratio: NonNegative = 1.0
    """Damping ratio of that error."""
    path_integral: NonNegative = 2.0
    """Integral gain of that error; it compensates unmodelled friction within about its inverse
    (1/s)."""
    force_integral: NonNegative = 10.0
    """Integral gain of the force error: the bandwidth of the force control, which should be below
    the lowest frequency of the arm in contact (1/s)."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    normal_damping: NonNegative = 20.0
    """Force per speed of the tip normal to the surface (N s/m)."""
    approach_speed: Positive = 0.1
    """Speed of approach without contact (m/s)."""
    touch_force: NonNegative = 0.2
    """Measured force below which there is no contact (N)."""
    sample_time: SampleTime = 0.001


class AdaptiveForceParameters(HybridForceParameters):
    """Hybrid control that adapts to the stiffness, position and friction of the surface."""

    name = "adaptive_force"
    adaptation: NonNegative = 2.0
    """Adaptation gain for stiffness and slope of the surface: the integral gain of the force error
    if force rate and speed have their nominal values (1/s)."""
    friction_adaptation: NonNegative = 1.0
    """Rate at which the friction of the surface is estimated at ``nominal_force`` (1/s)."""
    nominal_force: Positive = 5.0
    """Typical force on the surface, and typical change of the force in 1 s (N)."""
    nominal_speed: Positive = 0.1
    """Typical speed along the surface, at which the tip certainly slides (m/s)."""
    release_time: NonNegative = 0.05
    """Time without a measured force after which the contact counts as lost (s)."""
    sample_time: SampleTime = 0.001


class NeuralForceParameters(AdaptiveForceParameters):
    """Adaptive force control with a network that learns a surface of unknown shape."""

    name = "neural_force"
    learning: NonNegative = 12.0
    """Adaptation gain of the weights (1/s)."""
    features: Count = 40
    """Number of random features of the network."""
    feature_length: Positive = 0.1
    """Distance along the surface over which its shape varies (m)."""
    leakage: NonNegative = 0.0
    """Decay rate of the weights (1/s)."""
    e_modification: NonNegative = 0.0
    """Decay rate of the weights per force error (1/(N s))."""
    seed: Count = 1
    """Seed of the random features."""
    sample_time: SampleTime = 0.001


class ImpedanceParameters(ControllerParameters):
    """Impedance control: the tip acts as a spring and a damper towards its path."""

    name = "impedance"
    tangent_stiffness: NonNegative = 60.0
    """Force per distance along the surface (N/m)."""
    tangent_damping: NonNegative = 8.0
    """Force per speed along the surface (N s/m)."""
    normal_stiffness: NonNegative = 20.0
    """Force per distance normal to the surface (N/m)."""
    normal_damping: NonNegative = 10.0
    """Force per speed normal to the surface (N s/m)."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    force_integral: NonNegative = 0.0
    """Integral gain of the force error (1/s)."""
    posture_frequency: NonNegative = 5.0
    """Natural frequency of the posture error of arms with more than two joints, and of all joint
    errors along a motion without force (rad/s)."""
    sample_time: SampleTime = 0.001


class AdmittanceParameters(ControllerParameters):
    """Admittance control: the measured force moves the reference of a stiff position loop."""

    name = "admittance"
    damping: Positive = 150.0
    """Force error per speed of the reference; the bandwidth is the stiffness of surface and arm in
    series divided by it (N s/m)."""
    stiffness: NonNegative = 0.0
    """Stiffness of the spring that moves the reference back (N/m)."""
    frequency: Positive = 8.0
    """Natural frequency of the position loop (rad/s)."""
    damping_ratio: NonNegative = 0.7
    """Damping ratio of the position loop."""
    most_speed: Positive = 0.1
    """Largest speed of the reference relative to the motion, and so of the approach without contact
    (m/s)."""
    sample_time: SampleTime = 0.001
