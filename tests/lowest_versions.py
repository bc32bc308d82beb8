"""Print the lowest versions of dependencies that pyproject.toml allows, as constraints for pip.

The tools of `dev` keep their newest versions, because only developers run them.
"""

import tomllib
from pathlib import Path

PROJECT = tomllib.loads(Path(__file__).parents[1].joinpath("pyproject.toml").read_text())["project"]


def lowest_versions():
    """Return lines such as "numpy==2.0", for the package and for the extras that tests use."""
    extras = PROJECT["optional-dependencies"]
    used = [extras[name] for name in extras if name not in ("dev", "peers", "docs")]
    wanted = [line for group in [PROJECT["dependencies"], *used] for line in group]
    return sorted(line.replace(">=", "==") for line in wanted)


if __name__ == "__main__":
    print("\n".join(lowest_versions()))
