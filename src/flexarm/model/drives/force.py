"""Controllers of the tip position and the contact force, for motions that press on a surface."""

from __future__ import annotations

from typing import Annotated, Any

from flexarm.model.drives.base import ControllerParameters, SampleTime
from flexarm.model.quantities import Count, NonNegative, Positive, Typed

#: Numbers that the controller derives from its arm if they are None.
_OfArm = Annotated[Any, Typed(NonNegative | None)]
_PositiveOfArm = Annotated[Any, Typed(Positive | None)]


class HybridForceParameters(ControllerParameters):
    """Hybrid control: position along a surface, force normal to it.

    Defaults are relative to the arm: to the rate w, its lowest angular frequency, straight with
    locked joints, but at most 0.0064 rad in a sample time; to its reach L; and to the force F at
    the reach that accelerates the straight rigid arm about its first joint by w^2 / 4.
    """

    name = "hybrid_force"
    frequency: _PositiveOfArm = None
    """Natural frequency of the error along the surface (rad/s); by default 1.25 w."""
    damping_ratio: NonNegative = 1.0
    """Damping ratio of that error."""
    path_integral: _OfArm = None
    """Integral gain of that error; it compensates unmodelled friction within about its inverse
    (1/s); by default 0.32 w."""
    force_integral: _OfArm = None
    """Integral gain of the force error: the bandwidth of the force control, which should be below
    the lowest frequency of the arm in contact (1/s); by default 1.6 w."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    normal_damping: _OfArm = None
    """Force per speed of the tip normal to the surface (N s/m); by default 16 F / (L w)."""
    approach_speed: _PositiveOfArm = None
    """Speed of approach without contact (m/s); by default 0.0066 L w."""
    touch_force: _OfArm = None
    """Measured force below which there is no contact (N); by default a tenth of the requested
    force."""
    sample_time: SampleTime = 0.001


class AdaptiveForceParameters(HybridForceParameters):
    """Hybrid control that adapts to the stiffness, position and friction of the surface."""

    name = "adaptive_force"
    adaptation: _OfArm = None
    """Adaptation gain for stiffness and slope of the surface: the integral gain of the force error
    if force rate and speed have their nominal values (1/s); by default 0.32 w."""
    friction_adaptation: _OfArm = None
    """Rate at which the friction of the surface is estimated at ``nominal_force`` (1/s); by default
    0.16 w."""
    nominal_force: _PositiveOfArm = None
    """Typical force on the surface, and typical change of the force in a time of 2 pi / w (N); by
    default F / 4."""
    nominal_speed: _PositiveOfArm = None
    """Typical speed along the surface, at which the tip certainly slides (m/s); by default
    0.0066 L w."""
    release_time: _OfArm = None
    """Time without a measured force after which the contact counts as lost (s); by default
    0.32 / w."""
    sample_time: SampleTime = 0.001


class NeuralForceParameters(AdaptiveForceParameters):
    """Adaptive force control with a network that learns a surface of unknown shape."""

    name = "neural_force"
    learning: _OfArm = None
    """Adaptation gain of the weights (1/s); by default 1.9 w."""
    features: Count = 40
    """Number of random features of the network."""
    feature_length: _PositiveOfArm = None
    """Distance along the surface over which its shape varies (m); by default 0.04 L."""
    leakage: NonNegative = 0.0
    """Decay rate of the weights (1/s)."""
    e_modification: NonNegative = 0.0
    """Decay rate of the weights per force error (1/(N s))."""
    seed: Count = 1
    """Seed of the random features."""
    sample_time: SampleTime = 0.001


class ImpedanceParameters(ControllerParameters):
    """Impedance control: the tip acts as a spring and a damper towards its path.

    Defaults are relative to the rate w, reach L and force F of the arm, as for `hybrid_force`.
    """

    name = "impedance"
    tangent_stiffness: _OfArm = None
    """Force per distance along the surface (N/m); by default 7.6 F / L."""
    tangent_damping: _OfArm = None
    """Force per speed along the surface (N s/m); by default 6.4 F / (L w)."""
    normal_stiffness: _OfArm = None
    """Force per distance normal to the surface (N/m); by default 2.5 F / L."""
    normal_damping: _OfArm = None
    """Force per speed normal to the surface (N s/m); by default 8 F / (L w)."""
    force_proportional: NonNegative = 0.0
    """Proportional gain of the force error."""
    force_integral: NonNegative = 0.0
    """Integral gain of the force error (1/s)."""
    posture_frequency: _OfArm = None
    """Natural frequency of the posture error of arms with more than two joints, and of all joint
    errors along a motion without force (rad/s); by default 0.8 w."""
    sample_time: SampleTime = 0.001


class AdmittanceParameters(ControllerParameters):
    """Admittance control: the measured force moves the reference of a stiff position loop.

    Defaults are relative to the rate w, reach L and force F of the arm, as for `hybrid_force`.
    """

    name = "admittance"
    damping: _PositiveOfArm = None
    """Force error per speed of the reference; the bandwidth is the stiffness of surface and arm in
    series divided by it (N s/m); by default 120 F / (L w)."""
    stiffness: NonNegative = 0.0
    """Stiffness of the spring that moves the reference back (N/m)."""
    frequency: _PositiveOfArm = None
    """Natural frequency of the position loop (rad/s); by default 1.25 w."""
    damping_ratio: NonNegative = 0.7
    """Damping ratio of the position loop."""
    most_speed: _PositiveOfArm = None
    """Largest speed of the reference relative to the motion, and so of the approach without contact
    (m/s); by default 0.0066 L w."""
    sample_time: SampleTime = 0.001
