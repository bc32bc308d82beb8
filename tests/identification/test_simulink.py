"""Records from files of Simulink: scopes, structures, the blocks To File and To Workspace."""

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import flexarm as fa

TIMES = np.arange(50) / 100.0
ANGLE = 10.0 * np.sin(8.0 * TIMES)  # degrees
FORCE = np.cos(5.0 * TIMES)


def scope(signals):
    return {"time": TIMES[:, None], "signals": signals, "blockName": "bench/Scope"}


def signals_of(*columns):
    """Return a structure array as Simulink writes it."""
    fields = [("values", object), ("dimensions", object), ("label", object)]
    rows = np.zeros(len(columns), dtype=fields)
    for k, column in enumerate(columns):
        rows[k] = column[:, None], 1, f"signal {k}"
    return rows


SIMULINK = {
    "several signals": (
        {"S": scope(signals_of(ANGLE, FORCE))},
        ("S.signals[0].values", "S.signals[1].values"),
        None,
    ),
    "one signal": (
        {"S": scope({"values": np.stack([ANGLE, FORCE], axis=1), "label": ""})},
        ("S.signals.values[0]", "S.signals.values[1]"),
        None,
    ),
    "signals of matrices": (
        {"S": scope({"values": np.stack([ANGLE, FORCE])[:, None, :], "label": ""})},
        ("S.signals.values[0]", "S.signals.values[1]"),
        None,
    ),
    "To File": ({"ans": np.stack([TIMES, ANGLE, FORCE])}, ("ans[1]", "ans[2]"), "ans[0]"),
    "To Workspace": (
        {"tout": TIMES[:, None], "yout": np.stack([ANGLE, FORCE], axis=1)},
        ("yout[0]", "yout[1]"),
        None,
    ),
}


@pytest.mark.parametrize("form", SIMULINK)
def test_forms_of_simulink(form, tmp_path):
    content, (angle, force), time = SIMULINK[form]
    path = tmp_path / "bench.mat"
    savemat(path, content)
    channels = {"joint_angle_1": {"column": angle, "unit": "deg"}, "torque_1": force}
    record = fa.read_record(path, channels, time=time)
    np.testing.assert_allclose(record.data["joint_angle"][:, 0], np.deg2rad(ANGLE), atol=1e-12)
    np.testing.assert_allclose(record.data["torque"][:, 0], FORCE, atol=1e-12)


def test_signals_of_a_scope_in_version_7_3(tmp_path):
    """Lists of structures are references there."""
    path = tmp_path / "bench.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group, hidden = file.create_group("S"), file.create_group("#refs#")
        group["time"] = TIMES[None, :]
        fields = group.create_group("signals").create_dataset("values", (2, 1), h5py.ref_dtype)
        for k, values in enumerate((ANGLE, FORCE)):
            hidden[f"{k}"] = values[None, :]
            fields[k, 0] = hidden[f"{k}"].ref
    channels = {"tip_x": "S.signals[0].values", "torque_1": "S.signals[1].values"}
    record = fa.read_record(path, channels)
    np.testing.assert_allclose(record.data["tip"][:, 0], ANGLE, atol=1e-12)
    np.testing.assert_allclose(record.data["torque"][:, 0], FORCE, atol=1e-12)
