"""Build the documentation site: ``python docs/site [FOLDER] [--run PAGES]``.

Warnings are errors. Every build starts from nothing, so that no page shows results of older code.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

from live import build
from pages import ROOT, assemble
from sphinx.cmd.build import build_main


def main(folder: Path, run: str) -> int:
    """Build the site into a folder, and return the exit status of Sphinx."""
    # The kernels of live pages take minutes; they are compiled beside the pages.
    command = [sys.executable, "-c", "from live import build; build.kernels()"]
    kernels = subprocess.Popen(command, cwd=Path(__file__).resolve().parent)
    shutil.rmtree(folder, ignore_errors=True)
    sources = folder / "sources"
    sources.mkdir(parents=True)
    assemble(sources, run)
    settings = ["-c", str(Path(__file__).resolve().parent), "-d", str(folder / "doctrees")]
    strict = ["--fail-on-warning", "--quiet", "--jobs", "2"]
    html = folder / "html"
    status = build_main(["-b", "html", *settings, *strict, str(sources), str(html)])
    kernels.wait()
    if status == 0:
        build.write(html / "_static" / "live")
        print(f"open {html / 'index.html'}")
    return status


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "out" / "site")
    parser.add_argument("--run", default="*", help="pattern of the pages whose code is run")
    given = parser.parse_args()
    raise SystemExit(main(given.folder.resolve(), given.run))
