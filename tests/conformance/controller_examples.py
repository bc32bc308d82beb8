"""Every controller of the registry for an arm of two joints, in Python and as drives of a file."""

import flexarm as fa

SAMPLE_TIME = 0.004


def two_links():
    """Return the arm of two joints for which every controller here is designed."""
    links = [
        fa.Link(
            length=0.8,
            flexural_rigidity=30.0,
            mass_per_length=0.5,
            elements=1,
            gauges=[fa.Gauge(station=0.1, distance=0.005)],
        ),
        fa.Link(length=0.6, flexural_rigidity=20.0, mass_per_length=0.4, elements=1),
    ]
    return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.05), fa.Joint(hub_inertia=0.03)])


def joint_pd():
    return fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=SAMPLE_TIME)


def kalman_filter():
    instruments = [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument("strain", noise=1e-6)]
    return fa.ExtendedKalmanFilter(two_links(), instruments, sample_time=SAMPLE_TIME)


#: Torques that keep the links of ``two_links`` within the linear theory for any motion.
LIMIT = [2.0, 0.6]
#: Constructors of each controller of the registry for an arm of two joints.
EXAMPLES = {
    "admittance": lambda: fa.Admittance(two_links(), frequency=1.5, sample_time=SAMPLE_TIME),
    "hybrid_force": lambda: fa.HybridForce(two_links(), frequency=1.5, sample_time=SAMPLE_TIME),
    "impedance": lambda: fa.Impedance(two_links(), posture_frequency=1.5, sample_time=SAMPLE_TIME),
    "adaptive": lambda: fa.Adaptive(two_links(), 2.0, [0.8, 0.2], 0.003, sample_time=SAMPLE_TIME),
    "disturbance_observer": lambda: fa.DisturbanceObserver(two_links(), joint_pd(), 0.2),
    "estimator": lambda: fa.EstimatorController(kalman_filter(), joint_pd()),
    "rbf_adaptive": lambda: fa.RBFAdaptive(
        two_links(), 8.0, [0.8, 0.3], 0.001, -1.0, 1.0, sample_time=SAMPLE_TIME
    ),
    "sliding_mode": lambda: fa.SlidingMode(
        two_links(),
        2.0,
        0.5,
        {"link_2.mass": 0.02},
        reaching=[0.1, 0.02],
        damping=[0.5, 0.1],
        sample_time=SAMPLE_TIME,
    ),
    "composite": lambda: fa.Composite(
        two_links(), [0.4, 0.1], torque_limit=LIMIT, sample_time=SAMPLE_TIME
    ),
    "computed_torque": lambda: fa.ComputedTorque(two_links(), 0.3, 0.5, sample_time=SAMPLE_TIME),
    "joint_pd": joint_pd,
    "lqg": lambda: fa.LQG(
        two_links(), [0.4, 0.1], integral=True, torque_limit=LIMIT, sample_time=SAMPLE_TIME
    ),
    "mpc": lambda: fa.MPC(
        two_links(), [0.4, 0.1], torque_limit=LIMIT, horizon=10, sample_time=SAMPLE_TIME
    ),
    "joint_pid": lambda: fa.JointPID(
        [8.0, 3.0], [0.8, 0.3], [2.0, 1.0], arm=two_links(), sag=True, sample_time=SAMPLE_TIME
    ),
    "strain_feedback": lambda: fa.StrainFeedback(
        [8.0, 3.0], [0.8, 0.3], [[100.0], [0.0]], [[0.1], [0.0]], sample_time=SAMPLE_TIME
    ),
}

_BOUNDS = {"torque_limit": LIMIT, "posture": [0.4, 0.1]}
_PD = {"kind": "joint_pd", "proportional": [8.0, 3.0], "derivative": [0.8, 0.3]}
_READ = [{"signal": "joint_angle", "noise": 1e-4}, {"signal": "strain", "noise": 1e-6}]
#: The same as drives of a scenario; those without ``sample_time`` take it from the inner one.
DRIVES = {
    "admittance": {"frequency": 1.5},
    "hybrid_force": {"frequency": 1.5},
    "impedance": {"posture_frequency": 1.5},
    "adaptive": {"bandwidth": 2.0, "damping": [0.8, 0.2], "adaptation": 0.003},
    "disturbance_observer": {"inner": {**_PD, "sample_time": SAMPLE_TIME}, "cutoff": 0.2},
    "estimator": {
        "inner": {**_PD, "sample_time": SAMPLE_TIME},
        "estimator": {"instruments": _READ},
    },
    "rbf_adaptive": {
        "bandwidth": 8.0,
        "damping": [0.8, 0.3],
        "adaptation": 0.001,
        "lower": -1.0,
        "upper": 1.0,
    },
    "sliding_mode": {
        "bandwidth": 2.0,
        "boundary_layer": 0.5,
        "uncertainty": {"link_2.mass": 0.02},
        "reaching": [0.1, 0.02],
        "damping": [0.5, 0.1],
    },
    "composite": _BOUNDS,
    "computed_torque": {"frequency_hz": 0.3, "damping_ratio": 0.5},
    "joint_pd": {k: v for k, v in _PD.items() if k != "kind"},
    "lqg": {**_BOUNDS, "integral": True},
    "mpc": {**_BOUNDS, "horizon": 10},
    "joint_pid": {**_PD, "integral": [2.0, 1.0], "gravity": "sag"},
    "strain_feedback": {**_PD, "strain": [100.0, 50.0], "strain_rate": [0.1, 0.0]},
}
