"""Records of measurements from files: every format, units, gaps, resampling, errors."""

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.io import savemat

import flexarm as fa
from flexarm.identification.record import MEASURED, label_of
from flexarm.model.identification import UNITS

TIMES = np.arange(50) / 100.0
ANGLE = 10.0 * np.sin(8.0 * TIMES)  # degrees
FORCE = np.cos(5.0 * TIMES)
MAP = {"joint_angle_1": {"column": "log.angle", "unit": "deg"}, "torque_1": "log.torque"}


def write_csv(path: Path) -> None:
    frame = pd.DataFrame({"log.time": TIMES, "log.angle": ANGLE, "log.torque": FORCE})
    path.write_text("# a bench\n" + frame.to_csv(index=False))


def write_semicolons(path: Path) -> None:
    rows = [f"{t:.17g};{a:.17g};{f:.17g}" for t, a, f in zip(TIMES, ANGLE, FORCE, strict=True)]
    path.write_text("\n".join(["log.time;log.angle;log.torque", *rows]).replace(".", ","))
    path.write_text(path.read_text().replace("log,", "log."))


def write_mat(path: Path) -> None:
    rows = {"time": TIMES, "angle": ANGLE, "torque": FORCE}
    savemat(path, {"log": {name: values[:, None] for name, values in rows.items()}})


def write_mat_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("log")
        for name, values in (("time", TIMES), ("angle", ANGLE), ("torque", FORCE)):
            group[name] = values[None, :]  # a column of MATLAB
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(128))


def write_netcdf(path: Path) -> None:
    names = {"log.time": TIMES, "log.angle": ANGLE, "log.torque": FORCE}
    xr.Dataset({n: ("row", v) for n, v in names.items()}).to_netcdf(path, engine="h5netcdf")


def write_netcdf_3(path: Path) -> None:
    names = {"log.time": TIMES, "log.angle": ANGLE, "log.torque": FORCE}
    xr.Dataset({n: ("row", v) for n, v in names.items()}).to_netcdf(path, engine="scipy")


def write_parquet(path: Path) -> None:
    names = {"log.time": TIMES, "log.angle": ANGLE, "log.torque": FORCE}
    pd.DataFrame(names).to_parquet(path)


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (write_csv, "bench.csv"),
        (write_semicolons, "bench.csv"),
        (write_mat, "bench.mat"),
        (write_mat_73, "bench.mat"),
        (write_netcdf, "bench.nc"),
        (write_netcdf_3, "bench.nc"),
        (write_parquet, "bench.parquet"),
    ],
)
def test_every_format_gives_the_same_record(write, name, tmp_path):
    write(tmp_path / name)
    record = fa.read_record(tmp_path / name, MAP, time="log.time")
    assert record.rate == pytest.approx(100.0)
    # 17 digits of text, and one product with the unit.
    np.testing.assert_allclose(record.data["joint_angle"][:, 0], np.deg2rad(ANGLE), rtol=1e-14)
    np.testing.assert_allclose(record.data["torque"][:, 0], FORCE, rtol=1e-14)
    assert record.input == "torque"
    assert [label.text for label in record.outputs] == ["joint_angle_1"]


@pytest.mark.thorough
def test_results_of_runs_are_records(tmp_path):
    link = fa.Link(
        length=1.0,
        flexural_rigidity=20.0,
        mass_per_length=0.5,
        gauges=[fa.Gauge(station=0.1, distance=1e-3)],
    )
    result = fa.simulate(fa.Arm(links=[link]), 0.1, torque=lambda t: [1.0], rate=200.0)
    for name in ("run.csv", "run.nc"):
        fa.write_result(result, tmp_path / name)
        record = fa.read_record(tmp_path / name)
        for channel in ("joint_angle", "strain", "tip", "torque"):
            found, known = record.data[channel].values, result[channel].values
            np.testing.assert_allclose(found, known, rtol=1e-12, err_msg=channel)


def test_units_in_headers_gains_and_offsets(tmp_path):
    path = tmp_path / "bench.csv"
    columns = {"t (ms)": 1e3 * TIMES, "x [mm]": ANGLE, "amp": FORCE}
    pd.DataFrame(columns).to_csv(path, index=False)
    strain = {"column": "amp", "unit": "um/m", "gain": 250.0, "offset": -30.0}
    record = fa.read_record(path, {"tip_x": "x", "strain_2": strain}, time="t", start=0.1, end=0.3)
    assert record.times[0] == 0.0
    assert record.times[-1] == pytest.approx(0.2)
    inside = slice(10, 31)
    np.testing.assert_allclose(record.data["tip"][:, 0], 1e-3 * ANGLE[inside], rtol=1e-12)
    wanted = 1e-6 * (250.0 * FORCE[inside] - 30.0)
    np.testing.assert_allclose(record.data["strain"].sel(gauge=2), wanted, rtol=1e-12)


def test_gaps_are_missing_samples_and_jitter_is_interpolated(tmp_path):
    path = tmp_path / "bench.csv"
    random = np.random.default_rng(3)
    times = np.arange(200) / 100.0 + 1e-4 * random.uniform(-1, 1, 200)
    kept = np.delete(np.arange(200), np.arange(60, 75))
    values = 3.0 * times - 1.0
    values[120] = np.nan
    columns = {"t": times[kept], "tip_x": values[kept], "tip_y": values[kept] ** 0}
    pd.DataFrame(columns).to_csv(path, index=False)
    record = fa.read_record(path, rate=100.0)
    found = record.data["tip"].values[:, 0]
    missing = np.flatnonzero(np.isnan(found))
    assert set(range(61, 74)) <= set(missing) <= {*range(59, 76), 119, 120, 121}
    good = np.isfinite(found)
    grid = times[0] + record.times
    np.testing.assert_allclose(found[good], 3.0 * grid[good] - 1.0, atol=1e-12)


def test_a_lower_rate_removes_what_it_cannot_represent(tmp_path):
    path = tmp_path / "bench.csv"
    times = np.arange(2000) / 1000.0
    slow, fast = np.sin(2 * np.pi * 3.0 * times), np.sin(2 * np.pi * 97.0 * times)
    pd.DataFrame({"t": times, "tip_x": slow + fast, "tip_y": slow}).to_csv(path, index=False)
    record = fa.read_record(path, rate=100.0)
    inner = slice(20, -20)  # the filter has no samples beyond the ends
    error = record.data["tip"].values[:, 0] - np.sin(2 * np.pi * 3.0 * record.times)
    # Without the filter 97 Hz would appear as 3 Hz with amplitude 1; a filter of fourth order at
    # 40 Hz, forward and backward, leaves (40 / 97)^8 of it.
    assert np.abs(error[inner]).max() < 2e-3


def test_all_problems_of_a_file_are_reported_together(tmp_path):
    path = tmp_path / "bench.csv"
    write_csv(path)
    channels = {
        "joint_angle_1": {"column": "log.angle", "unit": "N"},
        "joint_angel_1": "log.angle",
        "tip": "log.torque",
        "strain_1": "log.strain",
    }
    with pytest.raises(fa.InputError) as error:
        fa.read_record(path, channels, time="log.time")
    text = str(error.value)
    assert len(error.value.problems) == 4, text
    for part in (
        "must be a unit of its channel (rad, mrad, deg, rev, m, cm, mm, um)",
        "tip_x",
        "'log.strain'",
    ):
        assert part in text


@pytest.mark.parametrize(
    ("times", "text"),
    [
        (np.r_[TIMES[:20], TIMES[18:]], "must increase from sample to sample, but sample 21"),
        (TIMES[:3], "fewer than 4 samples"),
    ],
)
def test_wrong_times(times, text, tmp_path):
    path = tmp_path / "bench.csv"
    pd.DataFrame({"t": times, "tip_x": times, "tip_y": times}).to_csv(path, index=False)
    with pytest.raises(fa.InputError, match=text):
        fa.read_record(path)


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("bench.xlsx", b"", "suffixes"),
        ("bench.csv", b"", "has no lines"),
        ("bench.mat", b"MATLAB", "cannot be read"),
        ("bench.nc", b"\x89HDF\r\n\x1a\nxx", "cannot be read"),
        ("bench.parquet", b"PAR1", "cannot be read"),
    ],
)
def test_unreadable_files(name, content, text, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(fa.InputError, match=text):
        fa.read_record(tmp_path / name)
    with pytest.raises(fa.InputError, match=rf"no-{name}', which does not exist|suffixes"):
        fa.read_record(tmp_path / f"no-{name}")


def test_messages_name_the_call_and_the_argument(tmp_path):
    with pytest.raises(fa.InputError, match=r"^read_record: chanels .*channels"):
        fa.read_record(tmp_path / "bench.csv", chanels={})
    with pytest.raises(fa.InputError, match=r"^read_record: rate must be greater than 0"):
        fa.read_record(tmp_path / "bench.csv", rate=-1.0)
    data = xr.Dataset({"joint_angle": (("time", "joint"), ANGLE[:, None])}, {"time": TIMES})
    with pytest.raises(fa.InputError, match=r"^MeasuredRecord: delays"):
        fa.MeasuredRecord(data, delays={"joint_angle": -1.0})


def test_gaps_in_an_input_are_refused():
    data = xr.Dataset(
        {
            "torque": (("time", "joint"), np.where(TIMES > 0.3, np.nan, 1.0)[:, None]),
            "joint_angle": (("time", "joint"), ANGLE[:, None]),
        },
        {"time": TIMES, "joint": [1]},
    )
    with pytest.raises(fa.InputError, match=r"torque_1 is an input and has 19 missing samples"):
        fa.MeasuredRecord(data)
    assert fa.MeasuredRecord(data, input="none").input == "none"
    with pytest.raises(fa.InputError) as error:
        fa.MeasuredRecord(data, input="none", delays={"strain": 0.1}, prescribed=[2])
    assert len(error.value.problems) == 2


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "hold"])
def test_a_result_states_the_interpolation_of_its_torque(interpolation):
    samples = np.array([[0.2], [-0.1], [0.3], [0.1], [0.0]])
    given = {"rate": 100.0, "torque_interpolation": interpolation}
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=9.0, mass_per_length=0.4)])
    run = fa.simulate(arm, 0.04, torque=samples, **given)
    assert run.attrs["torque_interpolation"] == interpolation
    assert fa.MeasuredRecord(run).interpolation == interpolation
    assert fa.MeasuredRecord(run, interpolation="cubic").interpolation == "cubic"
    smooth = fa.simulate(arm, 0.04, torque=lambda t: [0.1 * t], **given)
    assert fa.MeasuredRecord(smooth).interpolation == "cubic"


@pytest.mark.parametrize("name", sorted(MEASURED))
def test_every_measured_channel_has_labels(name):
    dims = MEASURED[name].dims
    text = name if not dims else f"{name}_x" if dims == ("axis",) else f"{name}_3"
    label = label_of(text)
    assert label is not None
    assert label.text == text
    assert (label_of(name) is None) == bool(dims)


def test_text_in_a_column_is_reported(tmp_path):
    path = tmp_path / "record.csv"
    head = "time,torque_1,joint_angle_1\n"
    rows = [f"{t:.2f},0.5,{'bad' if k == 3 else 0.1 * t}" for k, t in enumerate(TIMES[:20])]
    path.write_text(head + "\n".join(rows))
    with pytest.warns(fa.FlexarmWarning, match="text in 1 of 20 cells, such as 'bad'"):
        record = fa.read_record(path)
    assert np.isnan(record.data["joint_angle"].values).sum() == 1
    path.write_text(head + "\n".join(f"{t:.2f},0.5,{t} deg" for t in TIMES[:20]))
    with pytest.raises(fa.InputError, match="'joint_angle_1', which has no numbers"):
        fa.read_record(path)


def test_units_have_their_definitions():
    """The definitions of SI, by prefix or in full."""
    defined = {"deg": np.pi / 180, "rev": 2 * np.pi, "rpm": 2 * np.pi / 60, "%": 0.01}
    defined |= {"deg/s": np.pi / 180, "rev/s": 2 * np.pi, "Nm": 1.0, "m/m": 1.0}
    defined |= {"deg/s^2": np.pi / 180, "g": 9.80665, "mg": 9.80665e-3, "N.m": 1.0}
    defined |= {"mNm": 1e-3, "mm/m": 1e-3, "um/m": 1e-6, "ustrain": 1e-6}
    prefixes = {"c": 1e-2, "m": 1e-3, "u": 1e-6, "k": 1e3}
    for unit, names in UNITS.items():
        for name, factor in names.items():
            wanted = 1.0 if name == unit else defined.get(name)
            if wanted is None:
                assert name[1:] == unit, name
                wanted = prefixes[name[0]]
            assert factor == pytest.approx(wanted, rel=1e-15), name


def test_wrong_settings_are_reported_with_the_call(tmp_path):
    path = tmp_path / "bench.csv"
    pd.DataFrame({"t": TIMES, "tip_x": TIMES}).to_csv(path, index=False)
    with pytest.raises(fa.InputError, match=r"^read_record: smoothing is not a known key"):
        fa.read_record(path, smoothing=3)
    record = fa.read_record(path)
    with pytest.raises(fa.InputError, match=r"^MeasuredRecord: smoothing is not a known key"):
        fa.MeasuredRecord(record.data, smoothing=3)


def sine(times):
    return np.sin(8.0 * times)


def rows(times, values, form="{:.17g}"):
    return "\n".join(f"{form.format(t)},{v:.17g}" for t, v in zip(times, values, strict=True))


@pytest.mark.parametrize(
    ("head", "settings"),
    [
        ("t,joint_angle_1\ns,deg\n", {}),
        ("t,joint_angle_1\n[s],(deg)\n", {}),
        ("Bench 7\nof May\nt,joint_angle_1 [deg]\n", {"skip": 2}),
        ("t [ms],joint_angle_1 [deg]\n", {"factor": 1e3}),
        ("t,joint_angle_1 [deg]\n", {"factor": 1e6, "time_unit": "us"}),
    ],
)
def test_lines_before_the_header_units_below_it_and_units_of_time(head, settings, tmp_path):
    path = tmp_path / "bench.csv"
    factor = settings.pop("factor", 1.0)
    path.write_text(head + rows(factor * TIMES, ANGLE))
    record = fa.read_record(path, **settings)
    assert record.rate == pytest.approx(100.0)
    np.testing.assert_allclose(record.data["joint_angle"][:, 0], np.deg2rad(ANGLE), rtol=1e-12)


def test_a_wrong_unit_below_the_header_is_named(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("t,joint_angle_1\ns,kN\n" + rows(TIMES, ANGLE))
    with pytest.raises(fa.InputError, match=r"must be a unit of its channel .*got 'kN'"):
        fa.read_record(path)


def test_times_of_iso_8601(tmp_path):
    path = tmp_path / "bench.csv"
    stamps = pd.Timestamp("2024-05-01T23:59:59.9Z") + pd.to_timedelta(TIMES, unit="s")
    lines = [f"{stamp.isoformat()},{v:.17g}" for stamp, v in zip(stamps, ANGLE, strict=True)]
    path.write_text("time,joint_angle_1 [deg]\n" + "\n".join(lines))
    record = fa.read_record(path)
    assert record.rate == pytest.approx(100.0)
    np.testing.assert_allclose(record.data["time"], TIMES, atol=1e-9)  # a nanosecond


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
@pytest.mark.parametrize("suffix", ["csv", "dat", "txt"])
def test_other_encodings_and_suffixes_are_read(encoding, suffix, tmp_path):
    path = tmp_path / f"bench.{suffix}"
    path.write_text("# Köln\nt,joint_angle_1 [°]\n" + rows(TIMES, ANGLE), encoding)
    for named in ({}, {"encoding": encoding}):
        record = fa.read_record(path, **named)
        np.testing.assert_allclose(record.data["joint_angle"][:, 0], np.deg2rad(ANGLE), rtol=1e-12)
    with pytest.raises(fa.InputError, match="encoding must be the name of an encoding"):
        fa.read_record(path, encoding="latin-17")
    if encoding == "utf-16":
        with pytest.raises(fa.InputError, match=r"not a text in ascii\. Try encoding='latin-1'"):
            fa.read_record(path, encoding="ascii")


def test_signs_of_units_are_read(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("t,M [N·m],e [µm/m]\n" + "\n".join(f"{t},2.0,{t}" for t in TIMES))
    record = fa.read_record(path, {"torque_1": "M", "strain_1": "e"})
    np.testing.assert_allclose(record.data["torque"], 2.0)
    np.testing.assert_allclose(record.data["strain"][:, 0], 1e-6 * TIMES, rtol=1e-12)


@pytest.mark.parametrize(
    "head",
    [
        "Bench 7, Mai\nSampling 100 Hz\n\nt,joint_angle_1\ns,deg\n",
        "Operator: A. B.\n1 channel\nt,joint_angle_1 (deg)\n",
        "2026-01-31 10:00, run 3\nt,joint_angle_1 [deg]\n",
    ],
)
def test_the_header_follows_lines_of_text(head, tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text(head + rows(TIMES, ANGLE))
    found = fa.read_record(path).data["joint_angle"][:, 0]
    np.testing.assert_allclose(found, np.deg2rad(ANGLE), rtol=1e-12)


def test_degrees_and_microstrain_without_a_unit_are_noticed(tmp_path):
    path = tmp_path / "bench.csv"
    columns = {"t": TIMES, "joint_angle_1": 40.0 * sine(TIMES), "strain_1": 90.0 * sine(TIMES)}
    pd.DataFrame(columns).to_csv(path, index=False)
    with pytest.raises(fa.InputError) as error:
        fa.read_record(path)
    for text in (
        "joint_angle_1 has no unit",
        "too large for 'rad'",
        "such as 'deg', or 'rad'",
        "such as 'um/m', or '1'",
    ):
        assert text in str(error.value)
    given = {"joint_angle_1": {"column": "joint_angle_1", "unit": "rad"}}
    assert fa.read_record(path, given).data["joint_angle"].max() > 30.0


def test_wrapped_encoders_are_unwrapped_with_a_notice(tmp_path):
    path = tmp_path / "bench.csv"
    angle = 9.0 * TIMES**2 + 2.0
    wrapped = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    wrapped[30] = np.nan
    pd.DataFrame({"t": TIMES, "joint_angle_1": wrapped}).to_csv(path, index=False)
    with pytest.warns(fa.FlexarmWarning, match="joint_angle_1 jumps by a whole turn 1 times"):
        found = fa.read_record(path, rate=150.0)
    values = found.data["joint_angle"].values[:, 0]
    good = np.isfinite(values)
    # Of linear interpolation, a second derivative of 18 over steps of 10 ms.
    np.testing.assert_allclose(values[good], (9.0 * found.times**2 + 2.0)[good], atol=3e-4)


def test_wrong_stamps_outside_the_part_do_not_matter(tmp_path):
    path = tmp_path / "bench.csv"
    times = TIMES.copy()
    times[:3], times[-2:] = -1e-3, (0.0, np.nan)
    pd.DataFrame({"t": times, "tip_x": TIMES, "tip_y": TIMES}).to_csv(path, index=False)
    with pytest.raises(fa.InputError, match="time"):
        fa.read_record(path)
    record = fa.read_record(path, start=0.1, end=0.3)
    np.testing.assert_allclose(record.data["tip"][:, 0], TIMES[10:31], atol=1e-12)


@pytest.mark.parametrize("wrong", [1e9, -1e9])
def test_a_wrong_stamp_does_not_move_the_ends_of_the_part(wrong, tmp_path):
    path = tmp_path / "bench.csv"
    times = TIMES.copy()
    times[-1] = wrong
    pd.DataFrame({"t": times, "tip_x": TIMES, "tip_y": TIMES}).to_csv(path, index=False)
    record = fa.read_record(path, start=0.1, end=0.3)
    np.testing.assert_allclose(record.data["tip"][:, 0], TIMES[10:31], atol=1e-12)


def test_a_late_stamp_leaves_no_gap_in_an_input(tmp_path):
    path = tmp_path / "bench.csv"
    times = np.delete(TIMES, [20, 21])
    columns = {"t": times, "torque_1": 3.0 * times, "joint_angle_1": times}
    pd.DataFrame(columns).to_csv(path, index=False)
    record = fa.read_record(path)
    np.testing.assert_allclose(record.data["torque"][:, 0], 3.0 * record.times, atol=1e-12)
    assert np.isnan(record.data["joint_angle"]).sum() == 2


@pytest.mark.parametrize("rate", [400.0, 3000.0])
def test_rounded_times_are_named_and_replaced(rate, tmp_path):
    """At 400 Hz the rounded intervals are 2 and 3 ms; at 3 kHz times repeat."""
    times = np.arange(200) / rate
    path = tmp_path / "bench.csv"
    path.write_text("t,joint_angle_1\n" + rows(times, sine(times), "{:.3f}"))
    with pytest.warns(fa.FlexarmWarning, match="the times are rounded to 0.001 s"):
        record = fa.read_record(path)
    # The ends are rounded, too: by half a millisecond each.
    assert record.rate == pytest.approx(rate, rel=1e-3 / times[-1])
    error = record.data["joint_angle"][:, 0] - sine(record.data["time"])
    assert np.abs(error).max() < 8.0 * 1e-3  # the slope times the rounding


def test_real_jitter_is_not_taken_for_rounding(tmp_path):
    times = TIMES + 2e-3 * np.random.default_rng(3).uniform(-1.0, 1.0, TIMES.size)
    path = tmp_path / "bench.csv"
    path.write_text("t,joint_angle_1\n" + rows(times, sine(times), "{:.6f}"))
    record = fa.read_record(path)
    error = record.data["joint_angle"][:, 0] - sine(record.data["time"] + times[0])
    assert np.nanmax(np.abs(error)) < 64.0 * 14e-3**2 / 8.0  # of linear interpolation


def test_repeated_rounded_times_with_a_gap_name_their_cause(tmp_path):
    times = np.r_[np.arange(100) / 3000.0, 5.0 + np.arange(100) / 3000.0]
    path = tmp_path / "bench.csv"
    path.write_text("t,joint_angle_1\n" + rows(times, sine(times), "{:.3f}"))
    with pytest.raises(fa.InputError, match=r"rounded to 0.001 s. Give sample_time"):
        fa.read_record(path)


def test_a_footer_of_text_is_named(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("t,joint_angle_1\n" + rows(TIMES, ANGLE) + "\nend of file,\n")
    with (
        pytest.warns(fa.FlexarmWarning, match="text in 1 of 51 cells"),
        pytest.raises(fa.InputError, match="time has no number in sample 51"),
    ):
        fa.read_record(path)


def test_jitter_and_lost_samples_do_not_change_the_rate(tmp_path):
    """The median of 500 jittered intervals is wrong by up to 1 %."""
    path, random = tmp_path / "bench.csv", np.random.default_rng(0)
    times = np.arange(500) / 100.0 + 2e-3 * random.uniform(-1.0, 1.0, 500)
    times = np.delete(times, [100, 101])
    pd.DataFrame({"t": times, "torque_1": times, "tip_x": times}).to_csv(path, index=False)
    record = fa.read_record(path)
    assert record.rate == pytest.approx(100.0, rel=1e-12)
    np.testing.assert_allclose(record.data["torque"][:, 0] - record.times, times[0], atol=1e-12)


def test_wrong_stamps_far_after_the_start(tmp_path):
    path, times = tmp_path / "bench.csv", TIMES.copy()
    times[0], times[-1] = 1e6, 0.0
    pd.DataFrame({"t": times, "tip_x": TIMES}).to_csv(path, index=False)
    record = fa.read_record(path, start=0.1, end=0.3)
    np.testing.assert_allclose(record.data["tip"][:, 0], TIMES[10:31], atol=1e-12)


def test_one_record_from_several_files(tmp_path):
    """The clock of the second file is 0.3 s late, and its rate is five times as high."""
    frame = pd.DataFrame({"time": TIMES, "torque_1": FORCE})
    frame.to_csv(tmp_path / "drive.csv", index=False)
    late = np.arange(300) / 500.0 - 0.2
    frame = pd.DataFrame({"time [ms]": 1e3 * late, "bridge [um/m]": 4.0 * late + 1.2})
    frame.to_csv(tmp_path / "strain.csv", index=False)
    column = {"column": "bridge", "file": "strain.csv", "shift": 0.3}
    channels = {"torque_1": "torque_1", "strain_1": column}
    record = fa.read_record(tmp_path / "drive.csv", channels)
    # Both files have samples from 0.1 s (the second one) to 0.49 s (the first one).
    assert (record.rate, record.duration) == pytest.approx((100.0, 0.39))
    inside = TIMES > 0.0999
    np.testing.assert_allclose(record.data["torque"][:, 0], FORCE[inside], atol=1e-12)
    # The values are 4 t in the time of the first file; the filter before the lower rate changes
    # the ends of a ramp.
    strain = record.data["strain"].values[:, 0]
    np.testing.assert_allclose(strain[5:-5], 4e-6 * TIMES[inside][5:-5], atol=2e-8)


def test_dates_of_several_files_have_one_origin(tmp_path):
    for name, column, offset in (("a.csv", "torque_1", 0), ("b.csv", "angle", 100)):
        stamps = pd.to_datetime("2024-05-03T10:00:00Z") + pd.to_timedelta(
            10 * np.arange(50) + offset, unit="ms"
        )
        values = 0.01 * np.arange(50) + 1e-3 * offset
        frame = pd.DataFrame({"timestamp": stamps.strftime("%Y-%m-%dT%H:%M:%S.%fZ")})
        frame.assign(**{column: values}).to_csv(tmp_path / name, index=False)
    channels = {"torque_1": "torque_1", "joint_angle_1": {"column": "angle", "file": "b.csv"}}
    record = fa.read_record(tmp_path / "a.csv", channels)
    angle, torque = (record.data[name].values[:, 0] for name in ("joint_angle", "torque"))
    np.testing.assert_allclose(angle, torque, atol=1e-9)
    assert torque[0] == pytest.approx(0.1)


def _with_second_file(tmp_path, times, header="time", **settings):
    pd.DataFrame({"time": TIMES, "torque_1": TIMES}).to_csv(tmp_path / "a.csv", index=False)
    frame = pd.DataFrame({header: times, "angle": TIMES})
    frame.to_csv(tmp_path / "b.csv", index=False)
    column = {"column": "angle", "file": "b.csv"} | settings.pop("column", {})
    channels = {"torque_1": "torque_1", "joint_angle_1": column}
    return fa.read_record(tmp_path / "a.csv", channels, **settings)


def test_clocks_of_several_files_that_differ_are_refused(tmp_path):
    stamps = pd.to_datetime("2024-05-03T10:00:00Z") + pd.to_timedelta(TIMES, unit="s")
    dates = stamps.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    with pytest.raises(fa.InputError, match=r"'b\.csv' and 'a\.csv' must both have dates"):
        _with_second_file(tmp_path, dates)
    with pytest.raises(fa.InputError, match=r"'b\.csv' lasts"):
        _with_second_file(tmp_path, 1e3 * TIMES)
    with pytest.raises(fa.InputError, match="sample_time cannot be the times of several files"):
        _with_second_file(tmp_path, TIMES, sample_time=0.01)
    for record in (
        _with_second_file(tmp_path, dates, column={"shift": 1e-9}),
        _with_second_file(tmp_path, 1e3 * TIMES, "time [ms]"),
        _with_second_file(tmp_path, TIMES),
    ):
        angle, torque = (record.data[name].values[:, 0] for name in ("joint_angle", "torque"))
        np.testing.assert_allclose(angle, torque, atol=1e-6)


def test_masked_samples_do_not_reach_their_neighbours(tmp_path):
    """Nor the check of units: 9999 is no strain."""
    t = np.arange(2001) / 1000.0
    strain = 1e-4 * np.sin(2.0 * np.pi * t)
    lost = (t >= 0.8) & (t <= 1.0)
    table = np.column_stack([t, np.where(lost, 9999.0, strain)])
    path = tmp_path / "record.csv"
    np.savetxt(path, table, delimiter=",", header="time,strain_1", comments="")
    record = fa.read_record(path, rate=100.0, masks={"strain_1": [(0.8, 1.0)]}).data
    read, times = record["strain"].values[:, 0], record["time"].values
    outside = (times < 0.799) | (times > 1.001)
    # The filter before the samples are thinned sees a straight line in the gap.
    np.testing.assert_allclose(
        read[outside], 1e-4 * np.sin(2.0 * np.pi * times[outside]), atol=2e-6
    )
    assert np.isnan(read[~outside]).all()


def test_masks_leave_out_parts_of_channels(tmp_path):
    path = tmp_path / "bench.csv"
    pd.DataFrame({"t": TIMES, "tip_x": TIMES, "tip_y": TIMES}).to_csv(path, index=False)
    record = fa.read_record(path, start=0.1, masks={"tip_x": [(0.2, 0.25), (0.4, 0.41)]})
    missing = np.isnan(record.data["tip"].values)
    expected = ((TIMES > 0.199) & (TIMES < 0.251)) | ((TIMES > 0.399) & (TIMES < 0.411))
    np.testing.assert_array_equal(missing[:, 0], expected[10:])
    assert not missing[:, 1].any()
    with pytest.raises(fa.InputError, match=r"masks: tip names a channel that is not read"):
        fa.read_record(path, {"joint_angle_1": "tip_x"}, masks={"tip": [(0.2, 0.25)]})
    with pytest.raises(fa.InputError, match=r"masks: tip_x must be within the record"):
        fa.read_record(path, masks={"tip_x": [(200.0, 250.0)]})  # milliseconds
    with pytest.raises(fa.InputError, match=r"masks.tip_x\[0\] must end after its start"):
        fa.read_record(path, masks={"tip_x": [(0.3, 0.2)]})


def test_a_file_without_a_header(tmp_path):
    path = tmp_path / "bench.txt"
    path.write_text(rows(TIMES, ANGLE).replace(",", " "))
    record = fa.read_record(path, {"tip_x": "column[1]"}, time="column[0]")
    np.testing.assert_allclose(record.data["tip"][:, 0], ANGLE, atol=1e-8)
