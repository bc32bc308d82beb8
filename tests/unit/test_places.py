"""Paths of output files: checked before the computation, written completely or not at all."""

import errno
import os
import signal
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

import flexarm.base.writing.replace_file as replace_module
from flexarm.base.errors import InputError
from flexarm.base.writing.places import check_folder, check_place, write_text, write_whole
from flexarm.base.writing.replace_file import replace_file
from flexarm.cases.results import write_figure

SUFFIXES = (".nc", ".csv")


def refused(path):
    with pytest.raises(InputError) as reported:
        check_place("--out", path, SUFFIXES)
    (problem,) = reported.value.problems
    assert problem.name == "--out"
    return problem


def test_missing_folders_are_created_without_a_file(tmp_path):
    place = tmp_path / "a" / "b" / "run.nc"
    assert check_place("--out", place, SUFFIXES) == place
    assert place.parent.is_dir()
    assert not list(place.parent.iterdir())


@pytest.mark.parametrize("name", ["run", "run.", "run.txt", ".nc", "nc"])
def test_other_suffixes_are_rejected(name, tmp_path):
    assert refused(tmp_path / name).rule == "end in .nc or .csv"


def test_folder_in_place_of_the_file_is_rejected(tmp_path):
    (tmp_path / "run.nc").mkdir()
    assert "folder" in refused(tmp_path / "run.nc").value


def test_file_in_place_of_a_folder_is_rejected(tmp_path):
    (tmp_path / "file").write_text("")
    problem = refused(tmp_path / "file" / "run.nc")
    assert problem.rule == "be in a writable folder"


def test_path_with_a_null_character_is_rejected():
    refused("a\0.nc")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_pipe_is_rejected(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    assert refused(tmp_path / "pipe.nc").rule == "be an ordinary file"


@contextmanager
def as_nobody():
    """Change from root, which may write everywhere, to another user for a while."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no users on this system")
def test_folder_without_permission_is_rejected():
    # Not below pytest's own folder, which other users cannot enter.
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o555)
        with as_nobody():
            assert "Permission denied" in refused(Path(folder, "run.nc")).hint
        os.chmod(folder, 0o700)


def test_file_is_not_a_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="--out must be a writable folder"):
        check_folder("--out", tmp_path / "file")


def full_disk():
    """Yield the first part of a file, then fail as on a full disk."""
    yield b"half"
    raise OSError(errno.ENOSPC, "No space left on device")


def test_failed_write_keeps_the_older_file(tmp_path):
    path = tmp_path / "run.nc"
    path.write_text("older")
    with pytest.raises(InputError, match=r"No space left on device\. The older file"):
        write_whole(path, full_disk())
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_any_failure_leaves_no_partial_file(tmp_path):
    def interrupted():
        yield b"half"
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(tmp_path / "run.nc", interrupted())
    assert not list(tmp_path.iterdir())


def test_two_writers_of_one_file_do_not_interfere(tmp_path):
    path = tmp_path / "run.csv"

    def another_writes_in_the_meantime():
        yield b"first "
        write_text("second", path)
        assert path.read_text() == "second"
        yield b"writer"

    write_whole(path, another_writes_in_the_meantime())
    assert path.read_text() == "first writer"
    assert list(tmp_path.iterdir()) == [path]


KILLED = """
import os, signal, sys
from flexarm.base.writing.replace_file import replace_file
def parts():
    yield b"half"
    os.kill(os.getpid(), signal.SIGKILL)
replace_file(sys.argv[1], parts())
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal on this system")
def test_next_write_removes_files_of_a_killed_process(tmp_path):
    path, other = tmp_path / "run.csv", tmp_path / "other.csv"
    path.write_text("older")
    for target in (path, other):
        subprocess.run([sys.executable, "-c", KILLED, target], check=False)
    assert path.read_text() == "older"
    assert len(list(tmp_path.glob(".*.tmp"))) == 2
    write_text("newer", path)
    assert path.read_text() == "newer"
    assert len(list(tmp_path.glob(".*.tmp"))) == 1  # of the other file


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links on this system")
def test_target_of_a_link_is_written(tmp_path):
    (tmp_path / "real.txt").write_text("older")
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    write_text("newer", tmp_path / "link.txt")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "newer"


def test_permissions_of_the_older_file_are_kept(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("older")
    path.chmod(0o640)
    write_text("newer", path)
    assert path.stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX permissions")
def test_private_file_is_private_while_it_is_written(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("older")
    path.chmod(0o600)

    def parts():
        (beside,) = tmp_path.glob(".*.tmp")
        assert beside.stat().st_mode & 0o777 == 0o600
        yield b"newer"

    write_whole(path, parts())
    assert path.read_text() == "newer"


def test_unopened_temporary_file_is_not_tracked(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        replace_file(tmp_path / "missing" / "run.csv", [b"content"])
    assert not replace_module._unfinished


FOREIGN = """
import sys
from flexarm.base.writing.replace_file import replace_file
replace_file(sys.argv[1], [b"newer"])
"""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_pipes_and_links_with_the_name_of_a_temporary_file_are_kept(tmp_path):
    path, other = tmp_path / "run.csv", tmp_path / "other"
    other.write_text("of somebody else")
    prefix = replace_module._prefix(path)
    os.mkfifo(tmp_path / f"{prefix}pipe.tmp")
    (tmp_path / f"{prefix}link.tmp").symlink_to(other)
    # In a separate process, because opening the pipe would wait for its writer for ever.
    subprocess.run([sys.executable, "-c", FOREIGN, path], check=True, timeout=600)
    assert path.read_text() == "newer"
    assert other.read_text() == "of somebody else"
    assert len(list(tmp_path.glob(".*.tmp"))) == 2


class Picture:
    """Records the arguments of `savefig`."""

    def savefig(self, file, /, *, format):
        file.write(format.encode())


@pytest.mark.parametrize("suffix", ["png", "PDF", "svg"])
def test_figure_is_saved_in_the_format_of_its_suffix(suffix, tmp_path):
    write_figure(Picture(), tmp_path / f"a.{suffix}")
    assert (tmp_path / f"a.{suffix}").read_text() == suffix.lower()


def test_figure_in_an_unknown_format_is_rejected(tmp_path):
    with pytest.raises(InputError, match=r"must end in \.png, \.pdf or \.svg"):
        write_figure(Picture(), tmp_path / "a.jpg")
