"""The folder of the user in which machine code is kept, private and named by the sources."""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from platformdirs import user_cache_dir

#: Packages whose sources determine the machine code, and the file that determines its kernels.
_SOURCE_FOLDERS, _FEATURES = ("kernels", "integrate"), "cli/features.py"
_PACKAGE = Path(__file__).resolve().parents[2]
_UNUSED_CACHE_SECONDS = 60 * 24 * 3600


@functools.cache
def sources() -> str:
    """Return a hash of all sources of kernels, and of the calls for which a library has code."""
    digest = hashlib.sha256()
    kernels = (sorted((_PACKAGE / folder).rglob("*.py")) for folder in _SOURCE_FOLDERS)
    for path in (*chain.from_iterable(kernels), _PACKAGE / _FEATURES):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def cache_folder() -> Path | None:
    """Return the folder for these sources, created if missing; None if no folder is private.

    It is in the folder that the environment variable ``FLEXARM_CACHE`` names, by default the user's
    cache folder, or, if that is not writable, in a folder of the temporary
    directory that belongs to this user and that nobody else can open.
    """
    name = f"kernels-{sources()}"
    for root in _roots():
        folder = root / name
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_private(folder):
                continue
            with tempfile.TemporaryFile(dir=folder):
                pass
            _forget_unused(root, keep=folder)
        except OSError:
            continue
        return folder
    return None


def _roots() -> Iterator[Path]:
    home = Path(os.environ.get("FLEXARM_CACHE") or user_cache_dir("flexarm"))
    if home.is_absolute():  # the path of a user without a home directory starts with "~"
        yield home
    try:
        shared = Path(tempfile.gettempdir()) / f"flexarm-{user()}"
        shared.mkdir(mode=0o700, exist_ok=True)
        # Any user can create a folder with this name, so its owner and mode are checked.
        if _is_private(shared, others=0o077):
            yield shared
    except OSError:
        return


def user() -> int:
    """Return the number of the user; 0 where users have none."""
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _is_private(folder: Path, others: int = 0o022) -> bool:
    """Return whether a path is a folder of this user, without the permissions ``others``.

    A link to such a folder does not count.
    """
    if not hasattr(os, "geteuid"):
        return True  # on Windows, the folders of a user are closed to others by default
    status = os.lstat(folder)
    ours = stat.S_ISDIR(status.st_mode) and status.st_uid == user()
    return ours and not status.st_mode & others


def _forget_unused(root: Path, keep: Path) -> None:
    """Remove the machine code of sources that have not been used for two months."""
    (keep / ".used").touch()
    for old in root.glob("kernels-*"):
        stamp = old / ".used"
        if old != keep and stamp.exists():
            age = time.time() - stamp.stat().st_mtime
            if age > _UNUSED_CACHE_SECONDS:
                shutil.rmtree(old, ignore_errors=True)
