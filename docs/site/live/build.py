"""Write the files of the live pages: the kernels and, for each page, the memory of its runs.

They are scripts and not data, because a page that is opened from a disk may load scripts alone.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

import flexarm as fa
from live.images import KERNELS, Image, captured, encoded
from live.scenes import RATE, SCENES, Case, Scene
from live.webassembly import webassembly

_FOLDER = Path(__file__).resolve().parent
_ROOT = _FOLDER.parents[2]
#: Numbers and arrays that a kernel writes before it reads them, and those of drawing.
_SCRATCH = (
    "memory.new", "memory.torque", "memory.spare", "record.stages", "record.weights",
    "law.commands", "law.strains", "law.program.kept", "law.program.model.", "system.work.",
    "system.drive.loads.value", "drawn", "poses", "points", "tip",
)  # fmt: skip
#: Arrays of which fewer rows are used after a change of the sample time.
_ROWS = "law.inputs"

Images = dict[str, Image]


def write(folder: Path) -> None:
    """Write all files into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, scene in SCENES.items():
        text = json.dumps(described(scene), separators=(",", ":"))
        script = f'((globalThis.flexarm ??= {{}}).scenes ??= {{}})["{name}"] = {text};\n'
        (folder / f"{name}.js").write_text(script, encoding="utf-8")
    content = base64.b64encode(kernels()).decode()
    script = f'(globalThis.flexarm ??= {{}}).kernels = "{content}";\n'
    (folder / "kernels.js").write_text(script, encoding="utf-8")


def kernels() -> bytes:
    """Return the kernels as WebAssembly; compiled once for these sources, which takes minutes."""
    digest = hashlib.sha256(numba.__version__.encode())
    package = Path(fa.__file__).parent
    sources = [*(package / "kernels").rglob("*.py"), *(package / "integrate").rglob("*.py")]
    for path in [*sorted(sources), _FOLDER / "webassembly.py", _FOLDER / "images.py"]:
        digest.update(path.read_bytes())
    kept = _ROOT / "out" / "live" / f"kernels-{digest.hexdigest()[:16]}.wasm"
    if not kept.exists():
        calls: dict[str, tuple[Any, ...]] = {}
        for name in ("torques", "gains"):  # without and with a controller
            for image in images(SCENES[name], SCENES[name].start()).values():
                calls |= image.calls
        module = webassembly({name: (KERNELS[name], given) for name, given in calls.items()})
        kept.parent.mkdir(parents=True, exist_ok=True)
        new = kept.with_suffix(f".{os.getpid()}")  # another process may write it too
        new.write_bytes(module)
        new.replace(kept)
    return kept.read_bytes()


def cases(scene: Scene, values: Mapping[str, float]) -> Mapping[str, Case]:
    """Return the runs of a page for values of its sliders."""
    return scene.cases(**values)


def images(scene: Scene, values: Mapping[str, float]) -> Images:
    """Return the memory of the runs of a page for values of its sliders."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)  # some values are there to be bad ones
        return {
            label: captured(case.arm, scene.duration, rate=RATE, **case.arguments)
            for label, case in cases(scene, values).items()
        }


def described(scene: Scene) -> dict[str, Any]:
    """Return the data of a page."""
    start = images(scene, scene.start())
    effects = {name: _effects(scene, name, start) for name in scene.sliders}
    check(scene, start, effects)
    arms = {
        label: case.arguments.get("plant") or case.arm
        for label, case in cases(scene, scene.start()).items()
    }
    bodies = [int(body) for body in next(iter(arms.values())).assembly.link_body]
    return {
        "runs": [{"label": label, "image": encoded(image)} for label, image in start.items()],
        "sliders": [
            {
                "name": name,
                **slider._asdict(),
                "effects": [_packed(*item) for item in effects[name]],
            }
            for name, slider in scene.sliders.items()
        ],
        "traces": [
            {**trace._asdict(), "body": bodies[trace.link - 1], "limit": min(trace.limit, 1e300)}
            for trace in scene.traces
        ],
        "bodies": bodies,
        "view": scene.view,
        "duration": scene.duration,
        "rate": RATE,
        "magnify": scene.magnify,
        "speed": scene.speed,
        "turns": scene.turns,
        "button": scene.button,
    }


#: What a slider changes in a run: label of the run, name, indices, and numbers (values, indices).
Effect = tuple[str, str, NDArray[np.int32], NDArray[np.float64]]


def _effects(scene: Scene, name: str, start: Images) -> list[Effect]:
    """Return the numbers of all runs that a slider changes, for each of its values."""
    slider = scene.sliders[name]
    states = [images(scene, {**scene.start(), name: value}) for value in slider.values]
    effects = []
    for label, base in start.items():
        for place, number in _numbers(base).items():
            rows = np.array(
                [_numbers(state[label])[place].ravel()[: number.size] for state in states], object
            )
            shortest = min(map(len, rows))
            if shortest < number.size and place != _ROWS:
                raise ValueError(f"{name} changes the size of {place}")
            table = np.array([row[:shortest] for row in rows], dtype=float)
            changed = np.flatnonzero((table != number.ravel()[:shortest]).any(axis=0))
            if changed.size:
                effects.append((label, place, changed.astype(np.int32), table[:, changed]))
    return effects


def _numbers(image: Image) -> dict[str, NDArray[Any]]:
    """Return the arrays and numbers that determine a run, by their names."""
    # A law writes the torques that hold until its next sample.
    scratch = (*_SCRATCH, "system.drive.coefficients") if "sampled" in image.calls else _SCRATCH
    numbers = {**image.arrays, **image.numbers()}
    return {name: array for name, array in numbers.items() if not name.startswith(scratch)}


def check(scene: Scene, start: Images, effects: Mapping[str, list[Effect]]) -> None:
    """Check that the effects of several sliders add up.

    Raises:
        ValueError: if the memory for other values of all sliders differs from what they set.
    """
    ends = {name: len(slider.values) - 1 for name, slider in scene.sliders.items()}
    values = {name: scene.sliders[name].values[place] for name, place in ends.items()}
    wanted = images(scene, values)
    for label, image in start.items():
        numbers = {name: array.copy().ravel() for name, array in _numbers(image).items()}
        for name, place in ends.items():
            for other, target, indices, table in effects[name]:
                if other == label:
                    numbers[target][indices] = table[place]
        for name, array in _numbers(wanted[label]).items():
            if not np.array_equal(numbers[name][: array.size], array.ravel()):
                raise ValueError(f"sliders together change {name} of {label} in another way")


def _packed(
    label: str, name: str, indices: NDArray[np.int32], table: NDArray[Any]
) -> dict[str, Any]:
    pack = {"indices": indices, "values": table}
    return {
        "run": label,
        "name": name,
        **{key: base64.b64encode(array.tobytes()).decode() for key, array in pack.items()},
    }
