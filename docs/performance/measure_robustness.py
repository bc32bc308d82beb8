"""Table of the page "Controllers compared": controllers on arms that differ from their model.

python docs/performance/measure_robustness.py [nominal]
"""

import sys

import flexarm as fa

POSTURES = [[0.1, 0.6], [0.8, 0.9]]


def arm_of(rigidity=1.0, payload=0.1, gravity=0.0):
    """Two slender links with encoders and gauges; 1 % of modal damping."""
    rod = {"mass_per_length": 0.61732, "damping": fa.ModalDamping(ratio=0.01)}
    rod |= {"flexural_rigidity": 105.0 * rigidity}
    rod |= {"gauges": [fa.Gauge(station=0.05, distance=0.005)]}
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
        payload=fa.Payload(mass=payload),
        gravity=(0.0, -gravity),
    )


PLANTS = {
    "as designed": {},
    "gravity": {"gravity": 9.81},
    "payload x 2": {"payload": 0.2},
    "rigidity - 30 %": {"rigidity": 0.7},
    "rigidity + 30 %": {"rigidity": 1.3},
    "all": {"gravity": 9.81, "payload": 0.2, "rigidity": 0.7},
}
CONTROLLERS = {
    "LQG": (fa.LQG, {}),
    "LQG, uncertain": (fa.LQG, {"rigidity_uncertainty": 0.3}),
    "MPC": (fa.MPC, {"torque_limit": 200.0, "sample_time": 2e-3}),
    "MPC, uncertain": (
        fa.MPC,
        {"torque_limit": 200.0, "sample_time": 2e-3, "rigidity_uncertainty": 0.3},
    ),
    "Composite": (fa.Composite, {"rigidity_uncertainty": 0.0, "recovery": 0.0}),
    "Composite, uncertain": (fa.Composite, {}),
    "Loop shaping": (fa.LoopShaping, {"bandwidth": 12.0}),
    "Loop shaping, uncertain": (fa.LoopShaping, {"bandwidth": 12.0, "rigidity_uncertainty": 0.3}),
}


def growth(kind, options, change):
    """Largest real part (1/s) of the poles of the sampled loop, over the postures."""
    arm, plant = arm_of(), arm_of(**change)
    found = (fa.loop_margins(kind(arm, at, **options), plant, at) for at in POSTURES)
    return max(float(one.growth.max()) for one in found)


def main():
    """Print the table as Markdown."""
    plants = list(PLANTS)[: 1 if "nominal" in sys.argv[1:] else None]
    print(f"| | {' | '.join(plants)} |")
    print(f"| --- |{' --- |' * len(plants)}")
    for name, (kind, options) in CONTROLLERS.items():
        cells = [f"{growth(kind, options, PLANTS[plant]):.1f}" for plant in plants]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
