"""Draw the frames, signs and parts that the pages name: ``python docs/images/drawings.py``."""

# ruff: noqa: RUF005 (sums of arrays)
from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
_FOLDER = Path(__file__).resolve().parent
_STYLE = """text{font:15px system-ui,sans-serif;fill:#262626}.m{font:italic 18px Georgia,serif}
path{fill:none;stroke:#262626;stroke-width:1.4;stroke-linecap:round;stroke-linejoin:round}
.paper{fill:#fff}.link{stroke:#0072b2;stroke-width:4}.rigid{stroke-width:4}.thin{stroke:#8c8c8c;stroke-width:1}
.dash{stroke:#8c8c8c;stroke-dasharray:6 4}
.force{stroke:#d55e00;stroke-width:2}.angle{stroke:#009e73;stroke-width:1.6}
.torque{stroke:#b04f86;stroke-width:2}.solid{fill:#d9d9d9;stroke:none}.joint{fill:#fff}.load{fill:#e69f00;stroke:none}
.body{fill:#bfbfbf;stroke:none}.c-force{fill:#d55e00}.c-angle{fill:#00805d}.c-torque{fill:#b04f86}.c-thin{fill:#6d6d6d}
.c-link{fill:#0072b2}.mid{text-anchor:middle}.end{text-anchor:end}
@media(prefers-color-scheme:dark){.paper,.joint{fill:#14181d}text{fill:#e6e9ed}path{stroke:#dfe3e8}
.link{stroke:#56b4e9}.thin,.dash{stroke:#8b939c}.force{stroke:#f07d2e}.angle{stroke:#2fc79b}.torque{stroke:#dd8ab9}
.solid{fill:#3a4048;stroke:none}.body{fill:#5b636d;stroke:none}.load{stroke:none}.c-force{fill:#f07d2e}
.c-angle{fill:#2fc79b}.c-torque{fill:#dd8ab9}.c-thin{fill:#a4abb3}.c-link{fill:#56b4e9}}"""


class Drawing:
    """An SVG picture. Points are in pixels, y up, from the lower left corner."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.parts: list[str] = []

    def _d(self, points: ArrayLike) -> str:
        places = (f"{x:.1f} {self.height - y:.1f}" for x, y in np.asarray(points, dtype=float))
        return "M" + "L".join(places)

    def line(self, points: ArrayLike, look: str = "") -> None:
        """Draw a line through points."""
        self.parts.append(f'<path class="{look}" d="{self._d(points)}"/>')

    def area(self, points: ArrayLike, look: str) -> None:
        """Fill a polygon."""
        self.parts.append(f'<path class="{look}" d="{self._d(points)}Z"/>')

    def arrow(self, start: ArrayLike, end: ArrayLike, look: str = "") -> None:
        """Draw a straight arrow."""
        self.curve_arrow(np.array([start, end], dtype=float), look)

    def curve_arrow(self, points: FloatArray, look: str = "") -> None:
        """Draw a line with a head at its end."""
        step = points[-1] - points[-2]
        along = step / np.linalg.norm(step)
        across = np.array([-along[1], along[0]])
        back = points[-1] - 10.0 * along
        self.line(points, look)
        self.line([back + 4.5 * across, points[-1], back - 4.5 * across], look)

    def arc(self, center: ArrayLike, radius: float, start: float, end: float, look: str) -> None:
        """Draw an arc with a head, from an angle to another one (degrees)."""
        self.curve_arrow(circle(center, radius, start, end), look)

    def between(self, start: ArrayLike, end: ArrayLike, look: str = "thin") -> None:
        """Draw an arrow with two heads."""
        self.arrow(start, end, look)
        self.arrow(end, start, look)

    def dot(self, point: ArrayLike, look: str = "joint", radius: float = 6.0) -> None:
        """Draw a disk."""
        self.area(circle(point, radius, 0.0, 360.0), look)

    def ground(self, point: ArrayLike) -> None:
        """Draw a foot below a joint."""
        x, y = np.asarray(point, dtype=float)
        self.area([(x, y), (x - 12, y - 18), (x + 12, y - 18)], "body")
        self.line([(x - 18, y - 18), (x + 18, y - 18)])

    def text(self, point: ArrayLike, words: str, look: str = "") -> None:
        """Write words; ``$v_L$`` is a symbol with an index."""
        x, y = np.asarray(point, dtype=float)
        content = ""
        for place, part in enumerate(words.split("$")):
            if place % 2:
                lower = r'<tspan dy="5" font-size="12">\1</tspan><tspan dy="-5">&#8203;</tspan>'
                part = f'<tspan class="m">{re.sub(r"_(.)", lower, part)}</tspan>'
            content += part
        where = f'x="{x:.1f}" y="{self.height - y:.1f}"'
        self.parts.append(f'<text class="{look}" {where} xml:space="preserve">{content}</text>')

    def svg(self) -> str:
        """Return the text of the file."""
        size = f'width="{self.width}" height="{self.height}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {self.width} '
        paper = f'<rect class="paper" {size} rx="6"/>'
        content = "\n".join(self.parts)
        return f'{head}{self.height}"><style>{_STYLE}</style>{paper}\n{content}</svg>\n'


def circle(center: ArrayLike, radius: float, start: float, end: float) -> FloatArray:
    """Return points of an arc (degrees)."""
    angle = np.radians(np.linspace(start, end, 49))
    return np.asarray(center, dtype=float) + radius * np.stack([np.cos(angle), np.sin(angle)], 1)


def unit(angle: float) -> FloatArray:
    """Return the direction at an angle (degrees)."""
    return np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])


def bent(root: ArrayLike, angle: float, length: float, slope: float) -> tuple[FloatArray, float]:
    """Return points of a link and the angle of its tip tangent; the bending grows to ``slope``."""
    share = np.linspace(0.0, 1.0, 41)
    turned = angle + slope * (2.0 * share - share**2)
    steps = np.stack([np.cos(np.radians(turned)), np.sin(np.radians(turned))], 1)
    middle = 0.5 * (steps[1:] + steps[:-1]) * length / 40
    return np.asarray(root, dtype=float) + np.vstack([[0, 0], np.cumsum(middle, 0)]), angle + slope


def frames() -> Drawing:
    """World and body axes, joint angles, tip tangent."""
    draw = Drawing(640, 340)
    base = np.array([70.0, 50.0])
    first, tangent = bent(base, 40.0, 260.0, -24.0)
    elbow = first[-1]
    second, _ = bent(elbow, tangent + 46.0, 180.0, -18.0)
    draw.arrow(base, base + [190, 0])
    draw.arrow(base, base + [0, 190])
    draw.text(base + [196, -6], "$x$ world")
    draw.text(base + [-12, 202], "$y$")
    draw.line([base, base + 215 * unit(40.0)], "dash")
    draw.text(base + 215 * unit(40.0) + [-110, 14], "root tangent, body $x_1$", "c-thin")
    draw.line([elbow, elbow + 150 * unit(tangent)], "dash")
    draw.text(elbow + 150 * unit(tangent) + [6, -6], "tip tangent of link 1", "c-thin")
    draw.line([elbow, elbow + 150 * unit(tangent + 46.0)], "dash")
    draw.text(elbow + 150 * unit(tangent + 46.0) + [-66, 8], "body $x_2$", "c-thin")
    draw.line([elbow, elbow + [120, 0]], "thin")
    draw.arc(base, 90, 0, 40, "angle")
    draw.text(base + 98 * unit(8.0), "$θ_1$ = $ψ_1$", "c-angle")
    draw.arc(elbow, 74, tangent, tangent + 46.0, "angle")
    draw.text(elbow + 84 * unit(tangent + 20.0), "$θ_2$", "c-angle")
    draw.arc(elbow, 44, 0, tangent + 46.0, "angle")
    draw.text(elbow + [30, -22], "$ψ_2$", "c-angle")
    draw.line(first, "link")
    draw.line(second, "link")
    draw.ground(base)
    for joint in (base, elbow):
        draw.dot(joint)
    draw.dot(second[-1], "load", 10.0)
    draw.text(second[-1] + [16, -6], "payload at the tip")
    draw.text(first[30] + [6, -24], "link 1", "c-link")
    draw.text(second[24] + [12, -10], "link 2", "c-link")
    return draw


def deflection() -> Drawing:
    """Deflection, slope and shortening of a link."""
    draw = Drawing(640, 260)
    root = np.array([70.0, 66.0])
    link, slope = bent(root, 0.0, 460.0, 31.0)
    tip, end = link[-1], root + [460, 0]
    draw.arrow(root, root + [530, 0])
    draw.arrow(root, root + [0, 140])
    draw.text(root + [514, -22], "$x$")
    draw.text(root + [-24, 140], "$y$")
    draw.line(link, "link")
    draw.line([root + [0, 0], end], "dash")
    middle = link[22]
    foot = np.array([middle[0], root[1]])
    draw.between(foot, middle - [0, 3], "force")
    draw.text(middle + [-46, -54], "$v$($x$)", "c-force")
    draw.dot(middle, "load", 4.0)
    draw.line([(tip[0], root[1]), tip], "thin")
    draw.text(tip + [8, -70], "$v_L$", "c-force")
    draw.line([end - [0, 14], end + [0, 14]])
    draw.between((tip[0], root[1] - 16), (end[0], root[1] - 16), "torque")
    draw.text((0.5 * (tip[0] + end[0]) - 16, root[1] - 42), "−$u_L$", "c-torque")
    draw.between(root - [0, 30], (foot[0], root[1] - 30))
    draw.text(0.5 * (root + foot) + [-10, -50], "$x$ + $u$", "c-thin")
    draw.line([tip, tip + [90, 0]], "dash")
    draw.line([tip, tip + 90 * unit(slope)], "dash")
    draw.arc(tip, 62, 0, slope, "angle")
    draw.text(tip + 70 * unit(14.0), "$φ_L$", "c-angle")
    draw.text(end + [-4, 20], "$L$")
    draw.line([root - [0, 26], root + [0, 26]], "rigid")
    draw.text(root + [30, 160], "The root is clamped in the body axes: $v$ = $v$′ = 0.", "c-thin")
    return draw


def signs() -> Drawing:
    """Positive torque, strain and bending."""
    draw = Drawing(640, 250)
    base = np.array([40.0, 70.0])
    first, tangent = bent(base, 14.0, 170.0, -10.0)
    elbow = first[-1]
    second, _ = bent(elbow, tangent + 42.0, 120.0, 0.0)
    draw.line(first, "link")
    draw.line(second, "link")
    draw.dot(elbow)
    draw.arc(elbow, 42, -40, 80, "torque")
    draw.arc(elbow, 42, 250, 130, "torque")
    draw.text(elbow + [46, -16], "$τ_2$ on link 2", "c-torque")
    draw.text(elbow + [-96, 52], "−$τ_2$ on link 1", "c-torque")
    draw.text((40, 20), "A positive torque increases $θ_2$.")
    top = np.array([370.0, 110.0])
    link, _ = bent(top, 0.0, 220.0, 34.0)
    normal = np.stack([-np.gradient(link[:, 1]), np.gradient(link[:, 0])], 1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    draw.area(np.vstack([link + 16 * normal, (link - 16 * normal)[::-1]]), "solid")
    draw.line(link, "dash")
    draw.line([top - [0, 30], top + [0, 30]], "rigid")
    gauge = (link + 16 * normal)[6:12]
    draw.line(gauge, "force rigid")
    draw.text(gauge[2] + [-30, 22], "gauge", "c-force")
    draw.between(link[20], (link + 16 * normal)[20], "thin")
    draw.text((link + 16 * normal)[20] + [-6, 8], "$d$", "c-thin")
    draw.text((352, 50), "$v$″ &gt; 0: the side of +$y$ is compressed,")
    draw.text((352, 24), "strain = −$d$ $v$″")
    return draw


def loads() -> Drawing:
    """Loads on a link."""
    draw = Drawing(640, 300)
    base = np.array([60.0, 70.0])
    link, _ = bent(base, 32.0, 460.0, -18.0)
    draw.line([base, base + 130 * unit(32.0)], "dash")
    draw.line(link, "link")
    draw.ground(base)
    draw.dot(base)
    draw.arrow(link[13], link[13] - [0, 62], "force")
    draw.text(link[13] + [8, -56], "Load(force=...), fixed in the world", "c-force")
    for k in range(17, 28, 2):
        draw.arrow(link[k] + [0, 54], link[k] + [0, 6], "force")
    draw.line([link[17] + [0, 54], link[27] + [0, 54]], "force")
    draw.text(link[18] + [-50, 84], "spread=(a, b), N/m", "c-force")
    across = unit(32.0 + 90.0)
    draw.arrow(link[33], link[33] + 70 * across, "force")
    draw.text(link[33] + 70 * across + [4, 6], 'frame="link": a follower', "c-force")
    draw.arc(link[6], 26, -50, 210, "torque")
    draw.text(link[6] + [-60, 36], "moment", "c-torque")
    draw.arrow(link[-1], link[-1] + [62, -30], "force")
    draw.text(link[-1] + [4, -56], "tip_force", "c-force")
    draw.arrow((560, 120), (560, 60))
    draw.text((534, 132), "gravity")
    draw.between(base - 24 * across, link[13] - 24 * across)
    draw.text(base + 70 * unit(32.0) - 50 * across, "station", "c-thin")
    return draw


def contact() -> Drawing:
    """Gap, normal and forces of a contact."""
    draw = Drawing(640, 260)
    x = np.linspace(30.0, 610.0, 90)
    y = 70.0 + 18.0 * np.sin(x / 75.0)
    ground = np.stack([x, y], 1)
    draw.area(np.vstack([ground, [(610, 20), (30, 20)]]), "solid")
    draw.line(ground)
    draw.text((40, 28), "solid side: to the right of the direction of the curve", "c-thin")

    def normal(k: int) -> FloatArray:
        step = ground[k + 1] - ground[k - 1]
        return np.array([-step[1], step[0]]) / np.linalg.norm(step)

    k = 28
    tip = ground[k] + 66 * normal(k)
    link, _ = bent(tip, 140.0, 150.0, 20.0)
    draw.line(link, "link")
    draw.between(ground[k], tip, "angle")
    draw.text(ground[k] + 30 * normal(k) + [8, -4], "gap $g$", "c-angle")
    draw.dot(tip, "load", 7.0)
    draw.arrow(ground[12], ground[12] + 52 * normal(12))
    draw.text(ground[12] + 58 * normal(12) + [-10, 4], "$n$")
    k = 66
    tip = ground[k] - 8 * normal(k)
    link, _ = bent(tip, 130.0, 150.0, 26.0)
    draw.line(link, "link")
    draw.dot(tip, "load", 7.0)
    draw.arrow(tip, tip + 100 * normal(k), "force")
    draw.text(tip + 100 * normal(k) + [8, 0], "normal force on the arm", "c-force")
    along = np.array([normal(k)[1], -normal(k)[0]])
    draw.arrow(tip, tip - 70 * along, "torque")
    draw.text(tip - 70 * along + [-60, 12], "friction", "c-torque")
    draw.arrow(tip + 20 * along, tip + 76 * along, "thin")
    draw.text(tip + 64 * along + [-24, 22], "sliding", "c-thin")
    return draw


def mechanism() -> Drawing:
    """A base that moves, and closures."""
    draw = Drawing(640, 330)
    base = np.array([130.0, 236.0])
    tilt = 12.0
    corners = [(-50, -18), (50, -18), (50, 18), (-50, 18)]
    turn = np.array([unit(tilt), unit(tilt + 90.0)])
    draw.area([base + np.array(c) @ turn for c in corners], "body")
    draw.arrow((30, 190), (230, 190), "thin")
    draw.arrow((30, 190), (30, 310), "thin")
    draw.line(circle(base, 84, 0, tilt), "angle")
    draw.text(base + [92, 4], "angle", "c-angle")
    draw.line([base, base + [90, 0]], "thin")
    draw.line([base, base + 90 * unit(tilt)], "thin")
    draw.between((30, base[1]), base, "angle")
    draw.text((60, base[1] + 6), "x", "c-angle")
    draw.between((base[0], 190), base, "angle")
    draw.text((base[0] + 6, 204), "y", "c-angle")
    mount = base + np.array([34.0, 18.0]) @ turn
    link, _ = bent(mount, 50.0, 90.0, -20.0)
    draw.line(link, "link")
    draw.dot(mount)
    draw.text((30, 166), 'Base(free=("x", "y", "angle"))')

    def panel(left: float, bottom: float, words: str) -> FloatArray:
        draw.text((left, bottom), words)
        return np.array([left, bottom])

    at = panel(350.0, 166.0, 'kind="pin": positions equal')
    first, _ = bent(at + [10, 40], 48.0, 100.0, -20.0)
    second, _ = bent(first[-1], -62.0, 98.0, 14.0)
    draw.line(first, "link")
    draw.line(second, "link")
    draw.dot(first[-1])
    at = panel(30.0, 18.0, 'kind="weld": and angles')
    first, tangent = bent(at + [10, 40], 40.0, 100.0, -40.0)
    second, _ = bent(first[-1], tangent, 100.0, -40.0)
    draw.line(first, "link")
    draw.line(second, "link")
    draw.area(first[-1] + np.array([(-8, -8), (8, -8), (8, 8), (-8, 8)]), "load")
    at = panel(276.0, 18.0, 'kind="line"')
    draw.line([at + [0, 44], at + [130, 84]], "thin")
    link, _ = bent(at + [64, 64], 100.0, 62.0, 20.0)
    draw.line(link, "link")
    draw.dot(at + [64, 64])
    draw.arrow(at + [64, 64], at + [64, 64] + 44 * unit(107.0 - 180.0), "force")
    draw.text(at + [84, 28], "force on it", "c-force")
    at = panel(480.0, 18.0, 'kind="curve"')
    draw.line(circle(at + [60, 44], 44, 0, 180), "thin")
    point = at + [60, 44] + 44 * unit(60.0)
    link, _ = bent(point, 70.0, 62.0, 30.0)
    draw.line(link, "link")
    draw.dot(point)
    return draw


DRAWINGS: Sequence[Callable[[], Drawing]] = (frames, deflection, signs, loads, contact, mechanism)


def main() -> None:
    """Write all drawings beside this file."""
    for draw in DRAWINGS:
        (_FOLDER / f"{draw.__name__}.svg").write_text(draw().svg(), encoding="utf-8")


if __name__ == "__main__":
    main()
