"""Size, times and instructions of exported C code: the tables of "Accuracy".

Run it in the root of the repository: ``python docs/performance/measure_c_code.py``. It needs gcc,
make, arm-none-eabi-gcc and qemu-system-arm; the board is that of ``tests/bridges/cortex_m7``.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import flexarm as fa

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from bridges.test_c_on_cortex import FLAGS, run_on_cortex_m7  # noqa: E402

#: Rows of the table of functions.
SHOWN = ("tip", "forward_dynamics", "step", "step_jacobian", "controller")
INSTRUMENTS = [fa.Instrument("joint_angle", noise=1e-4), fa.Instrument("strain", noise=1e-6)]


def arm(links: int, modes: int, theory: str) -> fa.Arm:
    link = {"length": 1.0, "flexural_rigidity": 105.0, "mass_per_length": 0.6}
    gauge = fa.Gauge(station=0.1, distance=0.005)
    return fa.Arm(
        links=[fa.Link(**link, elements=4, modes=modes, gauges=[gauge]) for _ in range(links)],
        payload=fa.Payload(mass=0.5),
        gravity=(0.0, -9.81),
        theory=theory,
    )


ARMS = {
    "1 link, 2 modes": arm(1, 2, "linear"),
    "2 links, 2 modes": arm(2, 2, "linear"),
    "2 links, 4 modes, second order": arm(2, 4, "second_order"),
    "3 links, 2 modes": arm(3, 2, "linear"),
}


def times(printed: str) -> dict[str, tuple[str, str]]:
    """Least and largest time of each function, ns."""
    found = re.findall(r"^(\w+) +(\d+) +\d+ +(\d+) ns$", printed, flags=re.MULTILINE)
    return {name: (least, largest) for name, least, largest in found}


def output(*command: object) -> str:
    return subprocess.run(
        list(map(str, command)), check=True, capture_output=True, text=True
    ).stdout


def code_size(folder: Path) -> tuple[int, int]:
    """Bytes of code and constants for a Cortex-M7, and the largest stack of a function."""
    flags = [flag for flag in FLAGS if flag.startswith(("-std", "-O", "-m"))]
    place = folder / "cortex.o"
    source = folder / "arm.c"
    output("arm-none-eabi-gcc", *flags, "-fstack-usage", "-c", source, "-o", place)
    text = int(output("arm-none-eabi-size", place).splitlines()[1].split()[0])
    usage = place.with_suffix(".su").read_text().splitlines()
    return text, max(int(line.split("\t")[1]) for line in usage)


def main() -> None:
    for name, one in ARMS.items():
        with tempfile.TemporaryDirectory() as written:
            folder = Path(written)
            posture = [0.3] * one.n_joints
            fa.export_c(one, folder, controller=fa.LQG(one, posture, sample_time=0.001))
            header = (folder / "arm.h").read_text()
            operations = dict(re.findall(r"(\d+) operations.*?void arm_(\w+)", header, re.S))
            operations = {function: count for count, function in operations.items()}
            size, stack = code_size(folder)
            print(f"\n{name}: {size} bytes, stack {stack} bytes, dof {one.dof}")
            print(re.search(r"#define ARM_LARGEST_STEP (\S+)", header)[1], "s largest step")
            here = times(output("make", "-C", folder, "times"))
            there = times(run_on_cortex_m7(folder, "arm"))
            for function in SHOWN:
                count = operations.get(function.replace("controller", "controller_update"), "")
                print(function, count, *here[function], *there[function], sep=" | ")
            observer = fa.ExtendedKalmanFilter(one, INSTRUMENTS, payload_deviation=0.02)
            fa.export_c(one, folder, observer=observer)
            more, stack = code_size(folder)
            fa.export_c(one, folder)
            more -= code_size(folder)[0]
            fa.export_c(one, folder, observer=observer)
            steps = observer._step.steps
            print(f"observer: {more} bytes more, stack {stack} bytes, {steps} steps in a sample")
            here = times(output("make", "-C", folder, "times"))
            there = times(run_on_cortex_m7(folder, "arm"))
            print("observer", *here["observer"], *there["observer"], sep=" | ")


if __name__ == "__main__":
    main()
