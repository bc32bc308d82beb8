"""The sample of `make mutants`; the mutants themselves take an hour."""

import signal
import sys
from collections import Counter
from pathlib import Path

import pytest
from mutants.areas import AREAS
from mutants.equivalent import EQUIVALENT
from mutants.groups import ROOT, Group
from mutants.sample import Mutant, mutants_at, sample


@pytest.fixture(scope="module")
def chosen() -> list[Mutant]:
    return sample()


@pytest.mark.thorough
def test_sample_has_its_size_and_every_area(chosen: list[Mutant]) -> None:
    counts = Counter(mutant.area for mutant in chosen)
    assert counts == {name: area.mutants for name, area in AREAS.items()}
    assert counts.total() >= 150


@pytest.mark.thorough
def test_sample_has_one_mutant_per_line_and_each_changes_the_program(chosen: list[Mutant]) -> None:
    assert len({(mutant.file, mutant.line) for mutant in chosen}) == len(chosen)
    for mutant in chosen:
        code = (ROOT / mutant.file).read_text(encoding="utf-8")
        changed = mutant.applied(code)
        compile(changed, mutant.file, "exec")
        assert code.splitlines()[: mutant.line - 1] == changed.splitlines()[: mutant.line - 1]
        assert changed != code


@pytest.mark.thorough
def test_sample_is_reproducible(chosen: list[Mutant]) -> None:
    area = "command line"
    assert sample([area]) == [mutant for mutant in chosen if mutant.area == area]


@pytest.mark.thorough
def test_mutant_of_the_sample_is_found_by_its_place(chosen: list[Mutant]) -> None:
    assert chosen[0] in mutants_at(f"{chosen[0].file}:{chosen[0].line}")


@pytest.mark.thorough
def test_order_depends_neither_on_folders_nor_on_line_numbers(chosen: list[Mutant]) -> None:
    moved = Mutant(
        **{**vars(chosen[0]), "file": f"src/other/{Path(chosen[0].file).name}", "line": 1}
    )
    assert moved.rank == chosen[0].rank


def test_tests_of_every_group_exist() -> None:
    for area in AREAS.values():
        for group in area.groups:
            for name in group.tests:
                file, _, test = name.partition("::")
                text = (ROOT / "tests" / file).read_text(encoding="utf-8")
                assert not test or f"def {test}(" in text, name


def test_every_source_belongs_to_a_group_with_files() -> None:
    for area in AREAS.values():
        assert {group for _, group in area.files()} == set(area.groups)


def test_lines_of_equivalent_mutants_exist() -> None:
    """If a line no longer exists, its reason must leave the list."""
    texts = {
        path.name: path.read_text("utf-8") for area in AREAS.values() for path, _ in area.files()
    }
    for name, changes in EQUIVALENT.items():
        lines = [line.strip() for line in texts[name].splitlines()]
        for before, _ in changes:
            assert before in lines, f"{name}: {before}"


@pytest.mark.skipif(sys.platform == "win32", reason="make mutants requires signals of POSIX")
@pytest.mark.parametrize(
    ("line", "limit", "waiting", "end"),
    [
        ("pass", 60.0, 10.0, ""),
        ("while True: pass", 1.0, 60.0, "SIGXCPU"),
        ("import time; time.sleep(1000)", 60.0, 0.05, "SIGKILL"),
    ],
)
def test_endless_loop_and_waiting_differ(
    line: str,
    limit: float,
    waiting: float,
    end: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A limit on processor time does not depend on what else the machine does."""
    from mutants import __main__ as command

    (tmp_path / "tests" / "messages").mkdir(parents=True)
    (tmp_path / "tests" / "test_line.py").write_text(f"def test():\n    {line}\n")
    monkeypatch.setattr(command, "_WAITING", waiting)
    found, _, seconds = command.run_tests(Group((), ("test_line.py",)), tmp_path, limit)
    assert found == (-getattr(signal, end) if end else 0)
    assert seconds > 0.0
