"""Inject faults and count what they leave: the numbers of docs/reliability.md.

    python docs/measure_faults.py

Needs a POSIX system. Machine code goes into a temporary folder, not into the user's cache.
"""

import os
import random
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

FOLDER = tempfile.TemporaryDirectory()
HERE = Path(FOLDER.name)

import flexarm as fa  # noqa: E402
from flexarm.cli.failures import end_orderly_when_terminated  # noqa: E402
from flexarm.kernels.compilation import cache, code_cache  # noqa: E402
from flexarm.plot.signals import signals_figure  # noqa: E402

RANDOM = random.Random(1)


def main() -> None:
    """Print a line for each kind of fault."""
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=0.5)])
    result = fa.simulate(arm, 0.1, rate=200.0)
    figure, model = signals_figure(result), fa.linearize(arm)
    separation = fa.linearize_along(arm, fa.joint_motion(arm, [0.0], [0.5], 1.0), rate=100.0)
    writers = {
        "full.nc": lambda path: fa.write_result(result, path),
        "full.csv": lambda path: fa.write_result(result, path),
        "full.png": lambda path: write_figure(figure, path),
        "full.mat": lambda path: fa.save_linear(model, path),
        "full.json": lambda path: fa.save_linear(model, path),
        "full.yaml": lambda path: fa.save_arm(arm, path),
        "full.npz": lambda path: separation.save(path),
    }
    report("disk full while writing", full_disk(writers))
    report("SIGKILL while writing", killed(result, signal.SIGKILL))
    report("SIGTERM while writing", killed(result, signal.SIGTERM))
    report("damaged result", damaged_results(result))
    report("damaged cache file", damaged_cache())
    report("exchanged cache files", exchanged_cache())
    report("standard output that cannot be written", unwritable_output())
    report("foreign datagrams", foreign_datagrams())
    report("Ctrl-C while compiling", interrupted_compilation())


def report(fault: str, outcomes: Counter[str]) -> None:
    """Print the outcomes of one kind of fault."""
    print(f"{fault}: {sum(outcomes.values())} injected")
    for outcome, count in outcomes.most_common():
        print(f"    {count} {outcome}")


def write_figure(figure: object, path: Path) -> None:
    """Write a figure with its type out of the way."""
    from flexarm.output import write_figure

    write_figure(figure, path)


def full_disk(writers: dict) -> Counter[str]:
    """Write every format where files cannot grow beyond some length, 100 lengths each."""
    outcomes: Counter[str] = Counter()
    for name, write in writers.items():
        path = HERE / name
        write(path)
        older, length = path.read_bytes(), path.stat().st_size
        for limit in sorted(RANDOM.randrange(length) for _ in range(100)):
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            try:
                write(path)
                outcome = "no error"
            except fa.InputError:
                outcome = "InputError"
            finally:
                infinite = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
                resource.setrlimit(resource.RLIMIT_FSIZE, infinite)
            intact = "older file intact" if path.read_bytes() == older else "older file CHANGED"
            left = "nothing left" if not list(HERE.glob(".*.tmp")) else "temporary file LEFT"
            outcomes[f"{outcome}, {intact}, {left}"] += 1
    return outcomes


def in_another_process(work: object) -> int:
    """Call a function in a forked process; return its number."""
    process = os.fork()
    if process:
        return process
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        work()
    except KeyboardInterrupt:
        os._exit(130)
    except SystemExit as leave:
        os._exit(leave.code)
    except BaseException:
        os._exit(99)
    os._exit(0)


def killed(result: object, by: int) -> Counter[str]:
    """End a process that writes one file again and again, 60 times; then write it once more."""
    outcomes: Counter[str] = Counter()
    path = HERE / "killed.nc"

    def keep_writing() -> None:
        end_orderly_when_terminated()
        while True:
            fa.write_result(result, path)

    for _ in range(60):
        process = in_another_process(keep_writing)
        time.sleep(0.02 + 0.1 * RANDOM.random())
        os.kill(process, by)
        status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        left = len(list(HERE.glob(".*.tmp")))
        whole = "whole file" if not path.exists() or same(path, result) else "HALF A FILE"
        fa.write_result(result, path)
        after = len(list(HERE.glob(".*.tmp")))
        outcomes[f"exit {status}, {whole}, {left} temporary, {after} after the next write"] += 1
    return outcomes


def same(path: Path, result: object) -> bool:
    """Whether a file holds a result."""
    try:
        return bool(fa.read_result(path).identical(result))
    except fa.InputError:
        return False


def damaged(content: bytes) -> bytes:
    """Return another content: some bits flipped, a block overwritten, or the end missing."""
    while (changed := _changed(content)) == content:
        pass
    return changed


def _changed(content: bytes) -> bytes:
    at = RANDOM.randrange(len(content))
    match RANDOM.randrange(3):
        case 0:
            changed = bytearray(content)
            for _ in range(RANDOM.choice([1, 1, 10])):
                changed[RANDOM.randrange(len(content))] ^= 1 << RANDOM.randrange(8)
            return bytes(changed)
        case 1:
            block = RANDOM.randbytes(RANDOM.choice([1, 64, 512]))
            return content[:at] + block + content[at + len(block) :]
        case _:
            return content[:at]


def damaged_results(result: object) -> Counter[str]:
    """Read 3000 damaged files."""
    outcomes: Counter[str] = Counter()
    path = HERE / "damaged.nc"
    fa.write_result(result, path)
    content = path.read_bytes()
    for _ in range(3000):
        path.write_bytes(damaged(content))
        try:
            right = fa.read_result(path).identical(result)
            outcomes["read, and right" if right else "WRONG NUMBERS"] += 1
        except fa.InputError:
            outcomes["InputError"] += 1
    return outcomes


def kernel(scale: float) -> object:
    """Return a kernel that takes a second or two to compile, in a file of its own."""
    import importlib.util

    source = HERE / f"kernel_{scale:g}.py"
    # Every line keeps or shrinks rounding errors, so all correct compilations agree.
    lines = "\n".join(f"    y = np.sin(y + {scale}) + x[{k} % x.size]" for k in range(150))
    head = "import numpy as np\nfrom flexarm.kernels.compilation.cache import compiled\n@compiled\n"
    source.write_text(f"{head}def work(x):\n    y = 0.0\n{lines}\n    return y\n")
    spec = importlib.util.spec_from_file_location(source.stem, source)
    module = importlib.util.module_from_spec(spec)
    sys.modules[source.stem] = module
    spec.loader.exec_module(module)
    return module.work


def damaged_cache() -> Counter[str]:
    """Load 3000 damaged files of machine code; a wrong one would crash."""
    import numpy as np

    cache.CACHE_DIRECTORY = HERE
    outcomes: Counter[str] = Counter()
    work = kernel(1.5)
    work(np.ones(3))
    (signature,) = work.signatures
    (path,) = HERE.glob("kernel_1.5.work-*.code")
    content = path.read_bytes()
    kept = code_cache.CodeCache(work.py_func, HERE)
    for _ in range(3000):
        path.write_bytes(damaged(content))
        loaded = kept.load_overload(signature, work.targetctx)
        outcomes["LOADED" if loaded is not None else "discarded"] += 1
    return outcomes


def exchanged_cache() -> Counter[str]:
    """Put the file of each of five equal-looking kernels in place of each other one."""
    import importlib

    source = HERE / "alike.py"
    head = "from flexarm.kernels.compilation.cache import compiled\n"
    one = "@compiled\ndef work{0}(x):\n    return {0}.0 * x\n"
    source.write_text(head + "".join(one.format(k) for k in range(1, 6)))
    sys.path.insert(0, str(HERE))
    kernels = [getattr(importlib.import_module("alike"), f"work{k}") for k in range(1, 6)]
    for work in kernels:
        work(1.5)
    paths = [next(HERE.glob(f"alike.{work.py_func.__name__}-*.code")) for work in kernels]
    contents = [path.read_bytes() for path in paths]
    outcomes: Counter[str] = Counter()
    for work, path in zip(kernels, paths, strict=True):
        kept = code_cache.CodeCache(work.py_func, HERE, True)
        for other in contents:
            if other != contents[paths.index(path)]:
                path.write_bytes(other)
                loaded = kept.load_overload(work.signatures[0], work.targetctx)
                outcomes["LOADED" if loaded is not None else "discarded"] += 1
    return outcomes


def unwritable_output() -> Counter[str]:
    """Print the help of every command, and more, to a full disk and to a closed pipe."""
    import typer.main

    from flexarm.cli.main import app, main

    arm = HERE / "arm.yaml"
    fa.save_arm(fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)]), arm)
    cases, waiting = [["--version"], ["schema"], ["check", arm], ["modes", arm]], []
    waiting.append(([], typer.main.get_command(app)))
    while waiting:
        words, command = waiting.pop()
        cases.append([*words, "--help"])
        waiting += [([*words, n], c) for n, c in getattr(command, "commands", {}).items()]
    errors = HERE / "errors"
    outcomes: Counter[str] = Counter()
    for case in cases:
        for kind in ("full", "closed"):

            def command(case: list = case, kind: str = kind) -> None:
                reading, writing = os.pipe()
                os.close(reading)
                full = os.open("/dev/full", os.O_WRONLY)
                os.dup2(writing if kind == "closed" else full, 1)
                os.dup2(os.open(errors, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), 2)
                sys.argv = ["flexarm", *map(str, case)]
                main()

            process = in_another_process(command)
            status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            text = errors.read_text()
            told = text.count("standard output could not be written")
            trace = "TRACEBACK" if "Traceback" in text else "no traceback"
            outcomes[f"exit {status}, {told} message, {trace}"] += 1
    return outcomes


def foreign_datagrams() -> Counter[str]:
    """Run a loop over UDP 50 times while another program sends datagrams to the controller."""
    import socket
    import threading

    import numpy as np

    arm = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
    motion = fa.joint_motion(arm, [0.0], [0.5], 0.05)
    law = {"proportional": [8.0], "derivative": [3.0], "sample_time": 0.001}
    wanted = fa.simulate(arm, 0.03, controller=fa.JointPD(**law), reference=motion, rate=1000.0)
    names = ("reference_angle", "reference_rate", "reference_acceleration")
    sizes = dict.fromkeys(("joint_angle", "joint_rate", *names), 1)
    outcomes: Counter[str] = Counter()
    for _ in range(50):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            at = f"127.0.0.1:{probe.getsockname()[1]}"
        over = threading.Event()

        def disturb(at: str = at, over: threading.Event = over) -> None:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
                while not over.wait(0.0005):
                    number = RANDOM.choice([-2.0, -1.0, 0.0, 1.0, 7.0])
                    row = np.array([RANDOM.random(), number, 0.0, *np.ones(RANDOM.randrange(9))])
                    data = RANDOM.choice([row.tobytes(), RANDOM.randbytes(RANDOM.randrange(99))])
                    one.sendto(data, (at.split(":")[0], int(at.split(":")[1])))

        options = {"readings": sizes, "timeout": 30.0}
        law_of_the_run = threading.Thread(
            target=fa.realtime, args=(at, fa.JointPD(**law)), kwargs=options
        )
        threads = [law_of_the_run, threading.Thread(target=disturb)]
        for thread in threads:
            thread.start()
        run = fa.realtime(fa.Plant(arm, 0.001), at, 0.03, motion, clock=False, timeout=30.0)
        law_of_the_run.join()
        over.set()
        threads[1].join()
        same = np.allclose(run.torque, wanted.torque, rtol=0.0, atol=1e-12)
        outcomes["as simulated" if same else "WRONG"] += 1
    return outcomes


def interrupted_compilation() -> Counter[str]:
    """Interrupt a compilation at 20 moments; compile again with the cache that is left."""
    import numpy as np

    outcomes: Counter[str] = Counter()
    # A shell that starts this script in the background lets it ignore the signal.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for k in range(20):
        work = kernel(2.0 + k)
        expected = work.py_func(np.ones(3))
        process = in_another_process(lambda work=work: work(np.ones(3)))
        time.sleep(2.5 * RANDOM.random())
        os.kill(process, signal.SIGINT)
        first = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        left = len(list(HERE.glob(".*.tmp")))
        again = work(np.ones(3))
        right = "right" if np.isclose(again, expected, rtol=1e-9) else "WRONG"
        outcomes[f"exit {first}, {left} temporary, then {right}"] += 1
    return outcomes


if __name__ == "__main__":
    main()
