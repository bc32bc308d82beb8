"""The model layer imports no numerics, so that commands that only check a file are fast."""

import subprocess
import sys


def test_model_imports_neither_numpy_nor_higher_layers():
    code = (
        "import importlib.util, sys, types\n"
        "package = types.ModuleType('flexarm')  # the layer alone, not what the package offers\n"
        "package.__path__ = importlib.util.find_spec('flexarm').submodule_search_locations\n"
        "sys.modules['flexarm'] = package\n"
        "import flexarm.model\n"
        "heavy = {'numpy', 'scipy', 'numba', 'xarray', 'matplotlib'} & set(sys.modules)\n"
        "ours = {m.split('.')[1] for m in sys.modules if m.startswith('flexarm.')}\n"
        "print(sorted(heavy), sorted(ours))"
    )
    reported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert reported.stdout.split() == ["[]", "['base',", "'model']"]
