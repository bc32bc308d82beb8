"""``flexarm compare``: a study from its file to its table; every fault is reported at once."""

import csv

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.main import app
from flexarm.model import StudySpec, file_text, locate_study

STUDY = """\
flexarm: 1
arm:
  links:
    - {length: 0.8, flexural_rigidity: 40.0, mass_per_length: 0.5, elements: 1}
    - {length: 0.6, flexural_rigidity: 25.0, mass_per_length: 0.4, elements: 1}
  joints: [{hub_inertia: 0.05}, {hub_inertia: 0.03}]
  payload: {mass: 0.1}
motions:
  there: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.4}
  back: {kind: joint, start: [0.5, 0.0], end: [0.2, -0.4], duration: 0.4}
drives:
  torque alone: {kind: rigid_inverse_dynamics}
  PD:
    kind: joint_pd
    proportional: [20, 8]
    derivative: [2, 0.8]
    feedforward: rigid_inverse_dynamics
plants:
  as believed: {}
  heavy: {payload_factor: 2.0, flexural_rigidity_factor: [0.7, 1.0]}
hardware:
  instruments: [{signal: joint_angle, resolution: 0.0001, rate_cutoff: 80}]
run: {duration: 0.6, rate: 200, settling: 0.05}
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    return path


def call(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def test_numbers_equal_those_of_single_runs(path):
    table = fa.run_study(path)
    assert table.controller.values.tolist() == ["torque alone", "PD"]
    arm = fa.load_arm(path)
    back = fa.joint_motion(arm, [0.5, 0.0], [0.2, -0.4], 0.4)
    heavy = fa.varied(arm, payload_factor=2.0, flexural_rigidity_factor=[0.7, 1.0])
    feedforward = fa.rigid_torque(arm, back)
    instrument = fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=80.0)
    by_hand = fa.compare(
        arm,
        {"PD": fa.JointPD([20.0, 8.0], [2.0, 0.8], feedforward=feedforward)},
        0.6,
        {"back": back},
        {"heavy": heavy},
        hardware=fa.Hardware([instrument]),
        settling=0.05,
        rate=200.0,
    )
    one = {"controller": "PD", "plant": "heavy", "reference": "back"}
    for name in ("tip_error_rms", "residual_vibration", "torque_peak", "joint_error_rms"):
        assert table[name].sel(one).item() == pytest.approx(by_hand[name].item(), rel=1e-9)
    # Without a controller nothing is computed between samples.
    assert np.isnan(table.controller_time.sel(controller="torque alone")).all()


@pytest.mark.thorough
def test_load_on_one_plant_equals_that_of_compare(path):
    """The loads are added to one on all plants; then the same without these."""
    pushed = "  pushed: {loads: [{link: 2, force: [0.0, -8.0]}, {link: 1, moment: 0.5}]}\n"
    everywhere = "loads: [{link: 1, force: [1.0, 0.0], station: 0.4}]\n"
    path.write_text(STUDY.replace("hardware:", pushed + everywhere + "hardware:"))
    table = fa.run_study(path)
    arm = fa.load_arm(path)
    there = fa.joint_motion(arm, [0.2, -0.4], [0.5, 0.0], 0.4)
    controller = fa.JointPD([20.0, 8.0], [2.0, 0.8], feedforward=fa.rigid_torque(arm, there))
    by_hand = fa.compare(
        arm,
        {"PD": controller},
        0.6,
        {"there": there},
        {
            "as believed": arm,
            "pushed": (arm, [fa.Load(2, (0.0, -8.0)), fa.Load(1, moment=0.5)]),
        },
        hardware=fa.Hardware([fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=80.0)]),
        settling=0.05,
        rate=200.0,
        loads=[fa.Load(1, (1.0, 0.0), station=0.4)],
    )
    errors = []
    for plant in ("as believed", "pushed"):
        one = {"controller": "PD", "plant": plant, "reference": "there"}
        for name in ("tip_error_rms", "joint_error_rms", "torque_peak"):
            assert table[name].sel(one).item() == pytest.approx(
                by_hand[name].sel(one).item(), rel=1e-9
            )
        errors.append(table.joint_error_rms.sel(one).item())
    assert errors[1] > 1.02 * errors[0]  # the same arms without it would differ by nothing


@pytest.mark.thorough
def test_table_figure_and_files(path, tmp_path):
    result = call("compare", path, "--out", tmp_path / "t.csv", "--plot", tmp_path / "t.png")
    assert result.exit_code == 0, result.output
    assert "Along there" in result.output
    assert "torque alone" in result.output
    with open(tmp_path / "t.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 8
    assert {row["plant"] for row in rows} == {"as believed", "heavy"}
    # The printed row of the same run has lengths in mm and four digits; the last cell is a time.
    one = {"controller": "PD", "plant": "as believed", "reference": "there"}
    row = next(row for row in rows if one.items() <= row.items())
    printed = next(line for line in result.output.splitlines() if line.split()[:1] == ["PD"])
    metrics = {"tip_error_rms": 1e3, "tip_error_peak": 1e3, "residual_vibration": 1e3}
    expected = [float(row[name]) * unit for name, unit in {**metrics, "torque_rms": 1.0}.items()]
    found = [float(cell) for cell in printed.split()[-5:-1]]
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    assert (tmp_path / "t.png").stat().st_size > 10_000
    assert call("compare", path, "--out", tmp_path / "t.nc").exit_code == 0
    with xr.open_dataset(tmp_path / "t.nc", engine="h5netcdf") as kept:
        assert kept.tip_error_rms.sizes == {"controller": 2, "plant": 2, "reference": 2}


def test_check_counts_the_runs_of_a_study(path):
    result = call("check", path)
    assert result.exit_code == 0, result.output
    assert "8 of 0.6 s" in result.output


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("kind: joint_pd", "kind: joint_p", "study.yaml:14: drives.PD.kind"),
        ("[20, 8]", "[20, 8, 3]", "study.yaml:15: drives.PD.proportional must have length 2"),
        ("[0.7, 1.0]", "[0.7]", "plants.heavy.flexural_rigidity_factor must be a number"),
        ("payload: {mass: 0.1}", "", "plants.heavy.payload_factor is not supported for an arm"),
        ("settling: 0.05", "setting: 0.05", "run.setting is not a known key"),
        (
            "settling: 0.05",
            "settling: 0.6",
            "run.settling must be less than the duration of 0.6 s, got 0.6",
        ),
        (
            "settling: 0.05",
            "settling: 0.3",
            (
                "study.yaml:23: run.settling must be less than the 0.2 s of the run after "
                "the end of 'there', got 0.3"
            ),
        ),
        ("start: [0.5, 0.0]", "start: [0.5]", "motions.back.start must have length 2"),
        (
            "as believed: {}",
            "as believed: {loads: [{link: 3, force: [0, 1]}]}",
            "study.yaml:19: plants.as believed.loads[0].link must be the number of a link, 1 to 2",
        ),
        (
            "as believed: {}",
            "as believed: {loads: [{link: 1, force: [0, 1], station: 0.9}]}",
            "plants.as believed.loads[0].station must be at most 0.8 (the length of the link)",
        ),
        ("as believed: {}", "as believed: 3", "plants.as believed must be a mapping"),
        ("drives:", "controllers:", "drives"),
        ("[2, 0.8]", "[2, -0.8]", "drives.PD.derivative[1] must be at least 0"),
        (
            ", rate_cutoff: 80",
            "",
            (
                "study.yaml:22: hardware.instruments has no instrument for joint_rate, which "
                "joint_pd reads; it measures joint_angle."
            ),
        ),
        (
            "kind: joint_pd",
            "kind: strain_feedback\n    strain: 1",
            ("study.yaml:2: arm has no gauges, but strain_feedback reads strain."),
        ),
        ("there: {kind: joint, ", "there: {kind: pressed, ", "motions.there.path is missing"),
    ],
)
def test_faults_are_reported_with_their_line(path, old, new, words):
    assert old in STUDY
    path.write_text(STUDY.replace(old, new, 1))
    result = call("compare", path)
    assert result.exit_code == 2
    assert words in result.stderr.replace("\n", "")
    assert "Traceback" not in result.output


def test_two_problems_at_once(path):
    text = STUDY.replace("[20, 8]", "[20, 8, 3]").replace("payload: {mass: 0.1}", "")
    path.write_text(text)
    with pytest.raises(fa.InputError) as caught:
        locate_study(path)
    assert len(caught.value.problems) == 2


def test_unreachable_motion_is_reported_with_its_name(path):
    line = "there: {kind: line, start: [1.0, 0.2], end: [3.0, 0.0], duration: 0.4}"
    path.write_text(STUDY.replace(STUDY.splitlines()[8].strip(), line))
    with pytest.raises(fa.InputError, match=r"study.yaml:9: motions.there"):
        fa.run_study(path)


def test_failed_run_is_reported_and_the_table_is_printed(path):
    path.write_text(STUDY.replace("[20, 8]", "[9000, 8000]"))
    result = call("compare", path)
    assert result.exit_code == 0
    assert "status" in result.stdout
    assert "stopped" in result.stdout
    assert "PD on heavy along back: stopped at t =" in result.stderr.replace("\n", " ")


def test_study_can_be_used_from_python(path):
    study, _ = locate_study(path)
    assert isinstance(study, StudySpec)
    assert study.scenario("PD", "back").drive.kind == "joint_pd"


PRESSING = """\
flexarm: 1
arm:
  links:
    - {length: 1.4142, flexural_rigidity: 105.0, mass_per_length: 0.61732, elements: 1}
    - {length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.61732, elements: 1}
  joints: [{hub_inertia: 0.1}, {mass: 0.5, hub_inertia: 0.02, housing_inertia: 0.02}]
motions:
  wipe:
    kind: pressed
    path: {kind: line, start: [1.5, 0.5], end: [1.5, 0.55], duration: 0.3}
    force: 3.0
  free: {kind: line, start: [1.4, 0.5], end: [1.4, 0.55], duration: 0.2, shaping: {method: zv}}
drives:
  hybrid: {kind: hybrid_force}
contacts:
  - {surface: {kind: wall, point: [1.5, 0.0], normal: [-1, 0]}, stiffness: 1.0e+4, damping: 0.5}
run: {duration: 0.4, rate: 200}
"""


@pytest.mark.thorough
def test_force_errors_are_reported_only_for_motions_with_contact(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(PRESSING)
    result = call("compare", path, "--out", tmp_path / "t.csv")
    assert result.exit_code == 0, result.output
    pressing, free = result.output.split("Along free")
    assert "error of the tip, of the force" in pressing
    assert "peak N" in pressing
    assert "after mm" not in pressing
    assert "peak N" not in free
    assert "N m" in free
    with open(tmp_path / "t.csv", newline="") as stream:
        rows = {row["reference"]: row for row in csv.DictReader(stream)}
    # 3 N are requested; the tip starts at rest on the wall and bounces at first.
    assert 0.0 < float(rows["wipe"]["force_error_rms"]) < float(rows["wipe"]["force_error_peak"])
    assert float(rows["wipe"]["force_error_peak"]) <= 6.0
    assert rows["free"]["force_error_rms"] == rows["free"]["force_error_peak"] == ""


@pytest.mark.thorough
def test_check_names_pressing_and_shaped_motions(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text(PRESSING)
    study, _ = locate_study(path)
    for motion, words in (("wipe", "in 0.3 s, within reach, pressing"), ("free", "with shaping")):
        path.write_text(file_text(study.scenario("hybrid", motion)), encoding="utf-8")
        result = call("check", path)
        assert result.exit_code == 0, result.output
        assert words in " ".join(result.output.split())


def test_every_drive_is_checked_with_every_motion(tmp_path):
    """Feedforward of the rigid arm cannot press, and only one of the motions requires a force."""
    path = tmp_path / "study.yaml"
    moving = "  there: {kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.4}\n"
    torque = "  torque alone: {kind: rigid_inverse_dynamics}\n"
    text = PRESSING.replace("motions:\n", f"motions:\n{moving}")
    path.write_text(text.replace("drives:\n", f"drives:\n{torque}"))
    outcome = call("check", path)
    assert outcome.exit_code == 2
    assert "drives.torque alone.kind rigid_inverse_dynamics is not supported" in outcome.stderr
    line = 1 + path.read_text().splitlines().index(torque.rstrip())
    assert f"study.yaml:{line}: " in outcome.stderr


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("kind: wall,", "kind: plane,", "kind"),
        ("damping: 0.5}", "dampin: 0.5}", "dampin"),
        ("run: {", "loads: [{lnk: 1, force: [0, 1]}]\nrun: {", "lnk"),
        ("run: {", "hardware: {instrument: []}\nrun: {", "instrument"),
    ],
)
def test_faults_of_common_settings_are_reported(tmp_path, old, new, words):
    path = tmp_path / "study.yaml"
    path.write_text(PRESSING.replace(old, new))
    outcome = call("check", path)
    assert outcome.exit_code == 2, outcome.output
    assert words in outcome.stderr
    assert "Traceback" not in outcome.output + outcome.stderr


@pytest.mark.thorough
def test_inconsistent_estimator_is_reported_by_run_and_compare(tmp_path):
    """Its force or payload is four times the value of the filter's model."""
    arm = STUDY[: STUDY.index("motions:")]
    motion = "{kind: joint, start: [0.2, -0.4], end: [0.5, 0.0], duration: 0.3}"
    drive = (
        "{kind: estimator, estimator: {torque_noise: 0.001}, "
        "inner: {kind: joint_pd, proportional: [20, 8], derivative: [2, 0.8]}}"
    )
    rest = "hardware:\n  instruments: [{signal: joint_angle, noise: 0.0001}]\n"
    rest += "run: {duration: 0.4, rate: 200}\n"
    files = {
        "run": f"motion: {motion}\ndrive: {drive}\n"
        "loads: [{link: 2, station: 0.6, force: [0.0, 5.0]}]\n",
        "compare": f"motions: {{there: {motion}}}\ndrives: {{estimated: {drive}}}\n"
        "plants: {heavy: {payload_factor: 4.0}}\n",
    }
    for command, text in files.items():
        path = tmp_path / f"{command}.yaml"
        path.write_text(arm + text + rest)
        result = call(command, path)
        assert result.exit_code == 0, result.stderr
        assert result.stderr.count("the estimator is inconsistent") == 1


def test_instrument_that_the_hardware_of_a_plant_lacks_is_an_error_before_the_runs(path):
    own = "heavy: {hardware: {instruments: [{signal: joint_angle}]}, "
    path.write_text(STUDY.replace("heavy: {", own))
    outcome = call("compare", path)
    assert outcome.exit_code == 2
    assert outcome.stdout == ""
    words = "study.yaml:20: plants.heavy.hardware.instruments has no instrument for joint_rate, "
    assert words + "which joint_pd reads" in outcome.stderr
    assert outcome.stderr.count("joint_rate, which") == 1
