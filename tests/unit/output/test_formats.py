"""Every format of ``FORMATS`` obeys the rules of ``Format``."""

import csv
import gc
import os

import h5py
import numpy as np
import pytest
import xarray as xr

import flexarm as fa
from flexarm.base.errors import InputError
from flexarm.cases.results import FORMATS, read_result, write_result
from flexarm.simulation.run.channels import CHANNELS


@pytest.fixture(scope="module")
def result():
    gauge = fa.Gauge(station=0.1, distance=0.002)
    link = fa.Link(
        length=0.5, flexural_rigidity=3.0, mass_per_length=0.4, elements=2, gauges=[gauge]
    )
    arm = fa.Arm(links=[link, link], gravity=(0.0, -9.81))
    return fa.simulate(arm, 0.05, rate=200.0, stations=3)


@pytest.mark.parametrize("suffix", FORMATS)
def test_written_file_is_complete_and_without_others(suffix, result, tmp_path):
    write_result(result, tmp_path / f"run{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"run{suffix}"]
    assert (tmp_path / f"run{suffix}").stat().st_size > 1000


@pytest.mark.parametrize("suffix", FORMATS)
def test_older_file_is_replaced(suffix, result, tmp_path):
    path = tmp_path / f"run{suffix}"
    path.write_text("older")
    write_result(result, path)
    assert not path.read_bytes().startswith(b"older")


@pytest.mark.parametrize("suffix", FORMATS)
def test_suffix_may_be_in_capitals(suffix, result, tmp_path):
    write_result(result, tmp_path / f"run{suffix.upper()}")
    assert (tmp_path / f"run{suffix.upper()}").exists()


@pytest.mark.parametrize("suffix", [name for name, form in FORMATS.items() if form.read])
def test_read_result_equals_the_written_one(suffix, result, tmp_path):
    path = tmp_path / f"run{suffix}"
    write_result(result, path)
    xr.testing.assert_identical(read_result(path), result)


def test_table_has_a_row_for_each_time_and_a_unit_for_each_column(result, tmp_path):
    write_result(result, tmp_path / "run.csv")
    with open(tmp_path / "run.csv", newline="") as stream:
        head, *rows = csv.reader(stream)
    assert len(rows) == result.sizes["time"]
    assert head[:3] == ["time [s]", "joint_angle_1 [rad]", "joint_angle_2 [rad]"]
    assert {"tip_x [m]", "tip_velocity_y [m/s]", "kinetic_energy [J]", "strain_2 [1]"} <= set(head)
    assert {"axial_force_1_1 [N]", "bending_moment_2_3 [N m]"} <= set(head)
    assert {"q_joint_1 [rad]", "q_link_2_mode_4 [m kg^0.5]"} <= set(head)
    assert all(name.endswith("]") and name.count("[") == 1 for name in head)
    units = {channel.name: channel.unit for channel in CHANNELS.values()}
    for name in head[1:]:
        column, unit = name[:-1].split(" [")
        channel = max((known for known in units if column.startswith(known)), key=len)
        assert unit in units[channel]


def test_numbers_of_the_table_are_exact_to_the_bit(result, tmp_path):
    write_result(result, tmp_path / "run.csv")
    with open(tmp_path / "run.csv", newline="") as stream:
        head, *rows = csv.reader(stream)
    table = dict(zip(head, np.array(rows, dtype=np.float64).T, strict=True))
    assert np.array_equal(table["time [s]"], result["time"])
    assert np.array_equal(table["tip_y [m]"], result["tip"].sel(axis="y"))
    assert np.array_equal(table["joint_rate_2 [rad/s]"], result["joint_rate"].sel(joint=2))
    moment = result["bending_moment"].sel(link=2, station=0.5)
    assert np.array_equal(table["bending_moment_2_2 [N m]"], moment)
    mode = result["q"].sel(coordinate="link_2_mode_3")
    assert np.array_equal(table["q_link_2_mode_3 [m kg^0.5]"], mode)


def test_unknown_suffix_is_rejected_with_the_known_ones(result, tmp_path):
    with pytest.raises(
        InputError, match=r"path must end in \.nc or \.csv, got .*run\.cvs"
    ) as reported:
        write_result(result, tmp_path / "run.cvs")
    assert "run.csv" in reported.value.problems[0].hint
    assert not list(tmp_path.iterdir())


DAMAGE = {
    "a bit": lambda content, at: content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :],
    "a sector": lambda content, at: content[:at] + bytes(512) + content[at + 512 :],
    "the rest": lambda content, at: content[:at],
}


@pytest.mark.sampled("a bit")
@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damage_anywhere_in_a_file_is_rejected(damage, result, tmp_path):
    path = tmp_path / "run.nc"
    write_result(result, path)
    content = path.read_bytes()
    for at in np.linspace(0, len(content) - 513, 40, dtype=int).tolist():
        damaged = damage(content, at)
        path.write_bytes(damaged)
        if damaged != content:
            with pytest.raises(InputError, match="is not an intact NetCDF file"):
                read_result(path)


@pytest.mark.sampled("KeyError")
@pytest.mark.parametrize("error", [KeyError, RuntimeError, UnicodeError, MemoryError, IndexError])
def test_errors_of_damaged_files_without_a_digest_are_explained(
    error, result, tmp_path, monkeypatch
):
    """The error is simulated, because HDF5 does not return for minutes from some damaged files."""
    path = tmp_path / "run.nc"
    path.write_bytes(result.to_netcdf(engine="h5netcdf"))
    xr.testing.assert_identical(read_result(path), result)

    def damaged(*_, **__):
        raise error("found by the reader")

    monkeypatch.setattr(xr, "load_dataset", damaged)
    with pytest.raises(
        InputError, match=f"not an intact NetCDF file: {error.__name__}: .?found by the reader"
    ):
        read_result(path)


def test_damaged_digest_does_not_disable_the_check(result, tmp_path):
    path = tmp_path / "run.nc"
    write_result(result, path)
    content = path.read_bytes()
    path.write_bytes(content[:-60] + bytes(60))
    with pytest.raises(InputError, match="is not an intact NetCDF file: the file is damaged"):
        read_result(path)


def test_other_programs_read_written_files(result, tmp_path):
    write_result(result, tmp_path / "run.nc")
    found = xr.load_dataset(tmp_path / "run.nc", engine="h5netcdf")
    assert found.attrs.pop("digest").startswith("SHA-256")
    xr.testing.assert_identical(found, result)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_pipe_is_not_a_result(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    with pytest.raises(InputError, match="not an ordinary file"):
        read_result(tmp_path / "pipe.nc")


@pytest.mark.parametrize("text", [b"", b"no such format", b"\x89HDF\r\n\x1a\n broken"])
def test_objects_that_are_not_results_are_rejected(text, tmp_path):
    path = tmp_path / "run.nc"
    path.write_bytes(text)
    with pytest.raises(InputError, match="is not an intact NetCDF file"):
        read_result(path)


def test_missing_file_is_rejected(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_result(tmp_path / "run.nc")


def test_lossy_format_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"must be a \.nc file"):
        read_result(tmp_path / "run.csv")


def test_file_of_another_program_is_rejected(tmp_path):
    xr.Dataset({"a": 1.0}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="was not written by flexarm"):
        read_result(tmp_path / "other.nc")


def test_readings_of_instruments_are_kept_in_netcdf_and_omitted_from_tables(tmp_path):
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    hardware = fa.Hardware([fa.Instrument("joint_angle", noise=1e-3, rate_cutoff=30.0)])
    result = fa.simulate(
        arm, 0.1, controller=fa.JointPD(3.0, 0.1, 0.01), hardware=hardware, initial=[0.2]
    )
    write_result(result, tmp_path / "run.nc")
    xr.testing.assert_identical(read_result(tmp_path / "run.nc"), result)
    write_result(result, tmp_path / "run.csv")
    with open(tmp_path / "run.csv", newline="") as stream:
        rows = list(csv.reader(stream))
    assert len(rows) == 102
    assert "torque_command_1 [N m]" in rows[0]
    assert not any("measured" in name for name in rows[0])


@pytest.mark.thorough
def test_damaged_attributes_give_a_message_only(result, tmp_path, monkeypatch):
    """Without a traceback of h5netcdf, whose incomplete file raises again when it is deleted."""
    path = tmp_path / "run.nc"
    path.write_bytes(result.to_netcdf(engine="h5netcdf"))

    def damaged(*_):
        raise RuntimeError("unable to read the attribute")

    monkeypatch.setattr(h5py.AttributeManager, "get", damaged)
    with pytest.raises(InputError, match="unable to read the attribute"):
        read_result(path)
    gc.collect()
