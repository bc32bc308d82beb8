"""Every number that a kernel reads or writes is a column of the correct array."""

import ast
from pathlib import Path

import numpy as np

import flexarm
from flexarm.kernels import columns
from flexarm.kernels.layout import ArmConstants, Columns, empty_constants

PACKAGE = Path(flexarm.__file__).parent
SOURCES = sorted([*PACKAGE.glob("kernels/**/*.py"), *PACKAGE.glob("integrate/**/*.py")])
#: Arrays with named columns: the axis of the columns, and the constant with their number.
CONSTANTS = {
    "arm": (0, "ARM_COLUMNS"),
    "body": (1, "BODY_COLUMNS"),
    "mode": (2, "MODE_COLUMNS"),
    "shortening": (3, "SHORTENING_COLUMNS"),
    "closure": (1, "CLOSURE_COLUMNS"),
}
WORK = {
    "body": (1, "WORK_BODY_COLUMNS"),
    "mode": (2, "WORK_MODE_COLUMNS"),
    "closure": (1, "CLOSURE_WORK_COLUMNS"),
    "column": (2, "COLUMN_COLUMNS"),
}
#: Names of records in kernels.
RECORDS = dict.fromkeys(("c", "k", "constants", "softened", "part"), CONSTANTS) | {"work": WORK}


def names_by_array():
    """Return the column names of each array, from the file that declares them."""
    found = {}
    for node in ast.parse(Path(columns.__file__).read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
            names = [name.id for name in node.targets[0].elts]
            found[node.value.args[0].id] = names
    return found


def columns_read(source):
    """Return pairs of a column and the constant with the array's number of columns, for a file's
    kernels."""
    for node in ast.walk(ast.parse(source)):
        if not (isinstance(node, ast.Subscript) and isinstance(node.value, ast.Attribute)):
            continue
        record = node.value.value
        record = record.attr if isinstance(record, ast.Attribute) else getattr(record, "id", "")
        array = node.value.attr
        if array not in RECORDS.get(record, ()):
            continue
        axis, count = RECORDS[record][array]
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        assert len(places) == axis + 1, ast.unparse(node)
        first = places[axis].left if isinstance(places[axis], ast.BinOp) else places[axis]
        yield ast.unparse(first), count


def misplaced(source):
    """Return the columns that a file reads from an array that does not have them."""
    names = names_by_array()
    return [found for found in columns_read(source) if found[0] not in names[found[1]]]


def test_every_column_is_read_from_its_array():
    for path in SOURCES:
        assert not misplaced(path.read_text()), path


def test_column_of_another_array_is_found():
    assert misplaced("x = c.body[i, TIP_X]") == [("TIP_X", "BODY_COLUMNS")]
    assert misplaced("x = system.work.body[i, MASS]") == [("MASS", "WORK_BODY_COLUMNS")]
    assert not misplaced("x = work.body[i, TIP_X] * c.mode[i, j, S]")
    everything = [found for path in SOURCES for found in columns_read(path.read_text())]
    assert {count for _, count in everything} == {
        count for _, count in [*CONSTANTS.values(), *WORK.values()]
    }


def test_column_names_are_unique():
    names = [name for group in names_by_array().values() for name in group]
    assert len(names) == len(set(names))


def test_every_constant_has_one_view():
    """Python code reads constants by name; each name is a separate column, except of runs."""
    of_runs = [columns.SLIDING, columns.HELD_TORQUE, columns.SLIP_TIME]  # kernels alone use them
    views = {name: v for name, v in vars(ArmConstants).items() if isinstance(v, Columns)}
    constants = empty_constants(2, 3, 3, 3)
    assert constants.parent.tolist() == [-1.0, 0.0]  # of a serial arm
    constants.parent[:] = 0.0
    for name in views:
        view = getattr(constants, name)
        assert np.all(view == 0.0), name
        view[...] = 1.0
    assert np.all(constants.body[:, of_runs] == 0.0)
    assert np.all(np.delete(constants.body, of_runs, axis=1) == 1.0)
    assert np.all(constants.mode == 1.0)
    assert np.all(constants.shortening == 1.0)
    assert constants.arm.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    assert not constants.has_joint_laws
    assert not constants.has_bristles
    constants.arm[columns.HAS_JOINT_LAWS] = 1.0
    assert constants.has_joint_laws
    assert not constants.has_bristles
    constants.arm[columns.HAS_BRISTLES] = 1.0
    assert constants.has_bristles
