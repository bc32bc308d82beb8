"""Table and figure of the page "Controllers compared".

python docs/performance/measure_adaptive_force.py [FIGURE.png]
"""

import sys
import warnings

import numpy as np

import flexarm as fa
from flexarm.motion.timing import TimingLaw
from flexarm.view.plot.style import FLEXIBLE, RIGID, Sheet, legend_above, styled

warnings.simplefilter("ignore", fa.FlexarmWarning)  # soft links bend far on some surfaces
#: Times (s) of one cycle: approach, press, slide, release, lift, return.
TIMES = (0.6, 0.6, 2.0, 0.6, 0.6, 1.2)
_, PRESSED, SLIDE, RELEASE, FREE, CYCLE = np.cumsum(TIMES).tolist()
APPROACHED, CYCLES = TIMES[0], 2
#: When the payload changes: in the middle of the second stroke.
STEP = CYCLE + 2.2


def lab(rigidity=1.0, payload=0.1):
    """Return two slender links with a damping ratio of 1 %, hubs, and a payload."""
    rod = {"flexural_rigidity": 105.0 * rigidity, "mass_per_length": 0.61732}
    rod["damping"] = fa.ModalDamping(ratio=0.01)
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
        payload=fa.Payload(mass=payload),
    )


def wall(stiffness=1e4, friction=0.2, away=0.0, tilt=0.0):
    """Return a wall at x = 1.5 m, or ``away`` m behind it, turned by ``tilt`` degrees."""
    angle = np.radians(tilt)
    surface = fa.Wall((1.5 + away, 0.5), (-np.cos(angle), -np.sin(angle)))
    return fa.Contact(surface, stiffness=stiffness, damping=0.5, friction=friction)


def wave(height=0.006, length=0.3):
    """Return a surface with waves along the path."""
    y = np.linspace(0.2, 1.1, 46)
    surface = fa.SurfaceTable(1.5 + height * np.sin(2 * np.pi * (y - 0.5) / length), y)
    return fa.Contact(surface, stiffness=1e4, damping=0.5, friction=0.2)


ARM = lab()


def cycles():
    """Return the motion: to the wall, 0.3 m along it, away from it and back."""
    corners = [(1.47, 0.5), (1.5, 0.5), (1.5, 0.8), (1.47, 0.8)]
    points = corners * CYCLES + corners[:1]
    ends = np.cumsum([0.0, *np.hypot(*np.diff(points, axis=0).T)])
    ends /= ends[-1]
    breaks, rows, leg = [0.0], [], 0
    for time, moves in zip(TIMES * CYCLES, (1, 0, 1, 0, 1, 1) * CYCLES, strict=True):
        u = time / (CYCLE * CYCLES)
        way = (ends[leg + 1] - ends[leg]) * moves
        rows.append((ends[leg], 0.0, 0.0, 10 * way / u**3, -15 * way / u**4, 6 * way / u**5))
        breaks.append(breaks[-1] + u)
        leg += moves
    law = TimingLaw("cycles", (*breaks[:-1], 1.0), tuple(rows))
    return fa.via_point_motion(ARM, points, CYCLE * CYCLES, profile=law, blend=0.002)


def rise(u):
    """Return 0 to 1 for u from 0 to 1, smoothly."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def force(t):
    """Return no force in free motion, and 5 +- 1 N on the wall."""
    t = t % CYCLE
    wave = np.sin(2 * np.pi * (t - PRESSED)) * rise((t - PRESSED) / 0.3) * rise((SLIDE - t) / 0.3)
    on = rise((t - APPROACHED) / (PRESSED - APPROACHED)) * rise((RELEASE - t) / (RELEASE - SLIDE))
    return 5.0 * on * (1.0 + 0.2 * wave)


PATH = cycles()
REFERENCE = fa.pressed_motion(ARM, PATH, force, (-1.0, 0.0), friction=0.2)
CASES = {
    "as believed": {},
    "links 30 % softer": {"plant": lab(rigidity=0.7)},
    "surface of 1000 N/m": {"contacts": [wall(stiffness=1e3)]},
    "surface of 300 N/m": {"contacts": [wall(stiffness=300.0)]},
    "no friction": {"contacts": [wall(friction=0.0)]},
    "friction 0.4": {"contacts": [wall(friction=0.4)]},
    "wall 3 mm farther": {"contacts": [wall(away=0.003)]},
    "wall turned by 5 degrees": {"contacts": [wall(tilt=-5.0)]},
    "waves of 6 mm": {"contacts": [wave()]},
    "payload dropped": {
        "plant": lab(payload=0.2),
        "changes": [fa.Change("payload.mass", at=STEP, to=0.1)],
    },
    "payload taken over": {
        "changes": [fa.Change("payload.mass", at=STEP, to=0.2, velocity=(0.0, 0.28))]
    },
    "payload picked up at rest": {"changes": [fa.Change("payload.mass", at=STEP, to=0.2)]},
}
CONTROLLERS = {
    "HybridForce": fa.HybridForce(ARM),
    "AdaptiveForce": fa.AdaptiveForce(ARM),
    "NeuralForce": fa.NeuralForce(ARM),
}


def run(controller, **options):
    """Simulate all cycles."""
    start = {"contacts": [wall()], "initial": ARM.rest(PATH.joint_angle(0.0))}
    return fa.simulate(
        ARM,
        CYCLE * CYCLES,
        controller=controller,
        reference=REFERENCE,
        **{**start, **options},
    )


def measures(result):
    """Return measures of the second cycle.

    Force error while sliding, RMS, and during the whole contact, RMS, both in % of 5 N; largest
    distance along the wall, mm; losses of contact between touchdown and lift-off; peak force, N.
    """
    t = result.time.values - CYCLE
    pressed = -result.contact_force.values[:, 0, 0]
    wanted = REFERENCE.contact_force(t + CYCLE)
    beside = result.tip.values[:, 1] - REFERENCE.tip(t + CYCLE)[:, 1]
    slides = (t > PRESSED + 0.4) & (t < SLIDE - 0.3)
    whole = (t > PRESSED) & (t < SLIDE)
    on = (t > APPROACHED) & (t < RELEASE) & (wanted > 0.5)
    lost = int((np.diff((pressed[on] > 0.0).astype(int)) < 0).sum())
    rms = [20.0 * np.sqrt(np.mean((pressed - wanted)[part] ** 2)) for part in (slides, whole)]
    return (*rms, 1e3 * abs(beside[slides]).max(), lost, pressed[t > 0.0].max())


def figure(path):
    """Draw the force error on a soft surface, without and with adaptation."""
    sheet = Sheet(7.0, 2.9, layout="constrained")
    with styled():
        left, right = sheet.subplots(1, 2)
        for name, style in (("HybridForce", RIGID), ("AdaptiveForce", FLEXIBLE)):
            result = run(CONTROLLERS[name], contacts=[wall(stiffness=300.0)])
            time, pressed = result.time.values, -result.contact_force.values[:, 0, 0]
            left.plot(time, pressed - REFERENCE.contact_force(time), **style)
            result = run(CONTROLLERS[name], contacts=[wall(friction=0.0)])
            beside = result.tip.values[:, 1] - REFERENCE.tip(result.time.values)[:, 1]
            right.plot(result.time.values, 1e3 * beside, **style)
        left.set(title="Surface of 300 N/m", xlabel="time [s]", ylabel="force error [N]")
        right.set(title="No friction", xlabel="time [s]", ylabel="tip along the wall [mm]")
        legend_above(right, left.get_lines(), ["HybridForce", "AdaptiveForce"])
    sheet.savefig(path, dpi=160, format="png")


def main():
    """Print the table; draw the figure if it is requested."""
    print("| the arm and the surface | " + " | ".join(CONTROLLERS) + " |")
    print("| --- |" + " --- |" * len(CONTROLLERS))
    for case, options in CASES.items():
        cells = []
        for controller in CONTROLLERS.values():
            sliding, whole, beside, lost, peak = measures(run(controller, **options))
            cells.append(f"{sliding:.1f} %, {whole:.1f} %, {beside:.0f} mm")
            print(f"{case}: {lost} losses of contact, {peak:.1f} N", file=sys.stderr)
        print(f"| {case} | " + " | ".join(cells) + " |", flush=True)
    if len(sys.argv) > 1:
        figure(sys.argv[1])


if __name__ == "__main__":
    main()
