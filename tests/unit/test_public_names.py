"""Public names load lazily, and no folder or module has the name of one."""

import subprocess
import sys
from pathlib import Path

import pytest

import flexarm as fa


def test_no_module_of_the_package_has_a_public_name() -> None:
    """Importing the module would put it in the place of the function."""
    modules = {path.stem for path in Path(fa.__file__).parent.iterdir()}
    assert not modules & set(fa.__all__)


def test_package_loads_nothing_before_it_is_used() -> None:
    program = "import sys, flexarm; print(*(m for m in sys.modules if m.startswith('flexarm')))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert loaded.stdout.split() == ["flexarm"]


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="simulat"):
        fa.simulat  # noqa: B018
    assert fa.simulate is fa.simulate
    assert "__version__" not in fa.__all__
