"""Table and figure of the page "Controllers compared".

python docs/performance/measure_force.py [FIGURE.png]
"""

import sys

import numpy as np

import flexarm as fa
from flexarm.view.plot.style import FLEXIBLE, RIGID, Sheet, legend_above, styled

DURATION, START, END = 6.0, 2.0, 5.0


def lab(rigidity=1.0, payload=0.1):
    """Two slender links, hubs, a payload at the tip."""
    rod = {"flexural_rigidity": 105.0 * rigidity, "mass_per_length": 0.61732}
    return fa.Arm(
        links=[
            fa.Link(length=1.4142, elements=2, **rod),
            fa.Link(length=1.0, elements=1, **rod),
        ],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
        payload=fa.Payload(mass=payload),
    )


def wall(stiffness=1e4, friction=0.2, away=0.0):
    """Return a wall at x = 1.5 m, or ``away`` m behind it."""
    surface = fa.Wall(point=(1.5 + away, 0.0), normal=(-1.0, 0.0))
    return fa.Contact(surface, stiffness=stiffness, damping=0.5, friction=friction)


def rise(u):
    """From 0 to 1 as u does, smoothly."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def force(t):
    """2 N to touch down, 5 N, then 5 +- 2 N while the tip slides."""
    wave = np.sin(np.pi * (t - START)) * rise((t - START) / 0.5)
    return 2.0 + 3.0 * rise(t - 0.8) + 2.0 * wave


ARM = lab()
LINE = fa.line_motion(ARM, (1.5, 0.5), (1.5, 0.8), END - START, start_time=START)
PRESSED = fa.pressed_motion(ARM, LINE, force, (-1.0, 0.0), duration=DURATION, friction=0.2)
#: At rest, 10 mm before where the wall is believed to be.
BEFORE = ARM.rest(fa.line_motion(ARM, (1.49, 0.5), (1.49, 0.8), 1.0).joint_angle(0.0))
HARDWARE = fa.Hardware(
    instruments=[
        fa.Instrument("joint_angle", resolution=2 * np.pi / 2**17, rate_cutoff=100.0),
        fa.Instrument("contact_force", noise=0.05, delay=0.002),
    ],
    seed=1,
)
CASES = {
    "as believed": {},
    "payload doubled": {"plant": lab(payload=0.2)},
    "links 30 % softer": {"plant": lab(rigidity=0.7)},
    "wall 2 mm nearer": {"contacts": [wall(away=-0.002)]},
    "wall 2 mm farther": {"contacts": [wall(away=0.002)]},
    "wall three times as stiff": {"contacts": [wall(stiffness=3e4)]},
    "wall a third as stiff": {"contacts": [wall(stiffness=1e4 / 3)]},
    "no friction": {"contacts": [wall(friction=0.0)]},
    "friction 0.4": {"contacts": [wall(friction=0.4)]},
    "all at their worst": {
        "plant": lab(0.7, 0.2),
        "contacts": [wall(1e4 / 3, 0.4, 0.002)],
    },
    "encoders, noise, delay": {"hardware": HARDWARE},
}
CONTROLLERS = {
    "HybridForce": fa.HybridForce(ARM),
    "Impedance": fa.Impedance(ARM),
    "Impedance, force measured": fa.Impedance(ARM, force_integral=10.0),
    "Admittance": fa.Admittance(ARM),
}


def run(controller, **options):
    """Touch down, press, slide."""
    given = {"contacts": [wall()], "initial": BEFORE, **options}
    return fa.simulate(ARM, DURATION, controller=controller, reference=PRESSED, **given)


def errors(result):
    """While sliding: force error, RMS in % of 5 N, and largest distance along the wall, mm."""
    now = result.sel(time=slice(START, END))
    missed = -now.contact_force.values[:, 0, 0] - PRESSED.contact_force(now.time.values)
    beside = now.tip.values[:, 1] - PRESSED.tip(now.time.values)[:, 1]
    return 100.0 * np.sqrt(np.mean(missed**2)) / 5.0, 1e3 * abs(beside).max()


def figure(path):
    """Draw force and path of the nominal run."""
    result = run(CONTROLLERS["HybridForce"])
    time, pressed = result.time.values, -result.contact_force.values[:, 0, 0]
    drawing = Sheet(7.0, 2.9, layout="constrained")
    with styled():
        left, right = drawing.subplots(1, 2, width_ratios=[1.7, 1])
        left.plot(time, pressed, **FLEXIBLE)
        left.plot(time, PRESSED.contact_force(time), **RIGID)
        left.axvspan(START, END, color="0.95", zorder=-1)
        left.text((START + END) / 2, 0.2, "slides", ha="center", color="0.4")
        left.set(title="Force on the wall", xlabel="time [s]", ylabel="force [N]")
        left.set_ylim(0, 1.1 * pressed.max())
        tip, wanted = result.tip.values, PRESSED.tip(time)
        right.plot(time, tip[:, 1], **FLEXIBLE)
        right.plot(time, wanted[:, 1], **RIGID)
        right.set(title="Tip along the wall", xlabel="time [s]", ylabel="y [m]")
        legend_above(left, left.get_lines(), ["simulation", "reference"])
        for axes in (left, right):
            axes.set_xlim(0, DURATION)
    drawing.savefig(path, dpi=160, format="png")


def main():
    """Print the table; draw the figure if it is requested."""
    print("| the arm and the wall | " + " | ".join(CONTROLLERS) + " |")
    print("| --- |" + " --- |" * len(CONTROLLERS))
    for case, options in CASES.items():
        cells = []
        for controller in CONTROLLERS.values():
            try:
                off, beside = errors(run(controller, **options))
                cells.append(f"{off:.1f} %, {beside:.0f} mm")
            except fa.SimulationError:
                cells.append("stopped")
        print(f"| {case} | " + " | ".join(cells) + " |", flush=True)
    if len(sys.argv) > 1:
        figure(sys.argv[1])


if __name__ == "__main__":
    main()
