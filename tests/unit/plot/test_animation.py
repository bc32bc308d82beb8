"""Animations are read back: the tip is at its pixel, and the page has the numbers of the result."""

import html
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from plot_results import LINK, arm, result, rigid_result

import flexarm as fa
from flexarm.view.plot import animation as animations
from flexarm.view.plot.animation.frames import Stage
from flexarm.view.plot.palette import ORANGE, PURPLE

FPS = 25.0
#: A result of 0.2 s has frames at 0, 0.04, ..., 0.2 s.
FRAMES = 6
#: Of 255: changes by palettes of GIFs and the encoding of videos.
TOLERANCE = 40


@pytest.fixture(scope="module")
def animation():
    return fa.animate(result(), fps=FPS, width=640)


def rgb(color):
    return np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])


def pixel_of(stage, point, panel=0):
    """Return column and row of a point of the plane."""
    x, y = stage.arms[panel].transData.transform(point)
    return round(x), stage.size[1] - 1 - round(y)


def assert_tip(picture, stage, frame, panel=0):
    """Check that the payload is drawn at the tip, and not at the tip of another frame."""
    tips = result().tip.sel(time=[0.0, 0.04, 0.08, 0.12, 0.16, 0.2], method="nearest").values
    column, row = pixel_of(stage, tips[frame], panel)
    seen = picture[row, column, :3].astype(int)
    assert np.abs(seen - rgb(ORANGE)).max() < TOLERANCE, (frame, seen)
    far = tips[np.argmax(np.linalg.norm(tips - tips[frame], axis=1))]
    column, row = pixel_of(stage, far, panel)
    assert np.abs(picture[row, column, :3].astype(int) - rgb(ORANGE)).max() > TOLERANCE


def test_frames_are_at_the_requested_times(animation):
    (scene,) = animation.scenes
    np.testing.assert_allclose(scene.times, [0.0, 0.04, 0.08, 0.12, 0.16, 0.2], atol=1e-12)
    slow = fa.animate(result(), fps=FPS, speed=0.1)
    assert len(slow.scenes[0].times) == 51
    assert slow.scenes[0].times[-1] == pytest.approx(0.2)
    expected = arm().tip(result().q.values[20])[:2]
    np.testing.assert_allclose(scene.links[1, -1, -1], expected, atol=1e-12)


def test_tip_is_at_its_pixel_in_every_frame(animation):
    stage = Stage(animation.scenes, animation.width)
    width, height = stage.size
    assert width == 640
    assert height % 2 == 0
    count = 0
    for frame, picture in enumerate(stage.pictures()):
        assert picture.shape == (height, width, 4)
        assert_tip(picture, stage, frame)
        count += 1
    assert count == FRAMES


def test_torques_are_arrows_in_their_direction(animation):
    """Joint 1 has 0.4 N m, the longest arrow; joint 2 a quarter of it in the other direction."""
    arrows = animation.scenes[0].arrows[0]
    arcs = arrows[:, :25] - animation.scenes[0].joints[0][:, None]
    turned = np.unwrap(np.arctan2(arcs[..., 1], arcs[..., 0]))
    sweep = turned[:, -1] - turned[:, 0]
    assert sweep[0] == pytest.approx(1.6 * np.pi)
    assert sweep[1] == pytest.approx(-0.25 * 1.6 * np.pi)
    stage = Stage(animation.scenes, animation.width)
    picture = next(stage.pictures())
    column, row = pixel_of(stage, arrows[0, 12])
    around = picture[row - 2 : row + 3, column - 2 : column + 3, :3].astype(int)
    assert np.abs(around - rgb(PURPLE)).max(axis=-1).min() < TOLERANCE
    assert fa.animate(result(), torque=False).scenes[0].arrows is None


def test_histories_have_the_values_of_the_result(animation):
    histories = animation.scenes[0].histories
    assert [h.name for h in histories] == ["joint_angle", "link_tip_deflection", "torque"]
    assert np.array_equal(histories[2].values, result().torque)
    assert fa.animate(result(), channels=[]).scenes[0].histories == ()


def test_peaks_of_long_histories_are_kept():
    time = np.linspace(0.0, 0.2, 20_001)
    long = result().interp(time=time, kwargs={"fill_value": "extrapolate"})
    long = long.assign_attrs(result().attrs)
    long["torque"][12_345, 0] = 99.0
    (history,) = fa.animate(long, channels="torque", fps=5.0).scenes[0].histories
    assert len(history.time) < 4_000
    assert history.values.max() == 99.0


def test_rigid_counterpart_is_a_ghost():
    ghost = fa.animate(result(), rigid=True, fps=FPS).scenes[0].ghost
    rigid_counterpart = arm().rigid()
    expected = rigid_counterpart.tip(rigid_counterpart.rest(result().joint_angle.values[40]))[:2]
    np.testing.assert_allclose(ghost[2, -1, -1], expected, atol=1e-12)
    other = fa.animate(result(), rigid=rigid_result(), fps=FPS).scenes[0].ghost
    np.testing.assert_allclose(other[-1, -1, -1], rigid_result().tip[-1], atol=1e-12)


@pytest.mark.thorough
def test_results_are_drawn_side_by_side():
    both = fa.animate({"a": result(), "b": result()}, fps=FPS, width=640)
    stage = Stage(both.scenes, both.width)
    picture = next(stage.pictures())
    assert_tip(picture, stage, 0, panel=0)
    assert_tip(picture, stage, 0, panel=1)


def test_reference_and_surfaces_are_those_of_the_scenario(tmp_path):
    fa.save_arm(arm(), tmp_path / "arm.yaml")
    scenario = tmp_path / "run.yaml"
    scenario.write_text(
        "flexarm: 1\narm: arm.yaml\n"
        "motion: {kind: joint, start: [0.3, 0.6], end: [0.5, 0.8], duration: 0.1}\n"
        "contacts: [{surface: {kind: wall, point: [0, -2], normal: [0, 1]}, stiffness: 1000}]\n"
        "run: {duration: 0.1, rate: 200}\n"
    )
    (scene,) = fa.animate(fa.run_scenario(scenario), fps=10.0).scenes
    rigid_counterpart = arm().rigid()
    np.testing.assert_allclose(
        scene.reference[0][-1], rigid_counterpart.tip(rigid_counterpart.rest([0.5, 0.8]))[:2]
    )
    (solid,) = scene.solids
    np.testing.assert_allclose(solid.course[:, 1], -2.0)
    assert (solid.behind[:, 1] < -2.0).all()


@pytest.mark.parametrize(
    ("surface", "inside"),
    [
        (fa.RoundWall((2.0, 0.0), 0.5), lambda p: np.hypot(p[:, 0] - 2.0, p[:, 1]) < 0.5),
        (
            fa.RoundWall((0.0, 0.0), 2.5, inside=True),
            lambda p: np.hypot(p[:, 0], p[:, 1]) > 2.5,
        ),
        (fa.SurfaceTable([-3.0, 0.0, 3.0], [-1.5, -1.6, -1.5]), lambda p: p[:, 1] < -1.5),
    ],
)
def test_band_of_a_surface_is_on_its_solid_side(surface, inside):
    contact = fa.Contact(surface, 1e3)
    (solid,) = fa.animate(result(), contacts=[contact], fps=5.0).scenes[0].solids
    behind = solid.behind[np.abs(solid.behind[:, 0]) < 2.6]
    assert inside(behind).all()


def test_gif_contains_the_frames(animation, tmp_path):
    fa.animate(result(), tmp_path / "arm.gif", fps=FPS, width=640)
    stage = Stage(animation.scenes, animation.width)
    with Image.open(tmp_path / "arm.gif") as image:
        assert image.size == stage.size
        assert image.n_frames == FRAMES
        for frame in range(FRAMES):
            image.seek(frame)
            assert image.info["duration"] == 40  # ms
            assert_tip(np.asarray(image.convert("RGB")), stage, frame)


def test_frame_rate_of_a_gif_is_rounded_to_its_clock(tmp_path):
    """GIFs cannot have 30 frames per second, but 33.3."""
    made = fa.animate(result(), tmp_path / "arm.gif", width=320, channels=[])
    assert made.fps == pytest.approx(100.0 / 3.0)
    assert made.scenes[0].times[1] == pytest.approx(0.03)


@pytest.mark.thorough
def test_video_contains_the_frames(animation, tmp_path):
    ffmpeg = shutil.which("ffmpeg")
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        ffmpeg = get_ffmpeg_exe()
    except ImportError:
        if ffmpeg is None:
            pytest.skip("no ffmpeg: pip install 'flexarm[animation]'")
    animation.save(tmp_path / "arm.mp4")
    command = [ffmpeg, "-loglevel", "error", "-i", tmp_path / "arm.mp4", "-f", "rawvideo"]
    raw = subprocess.run([*command, "-pix_fmt", "rgb24", "-"], check=True, capture_output=True)
    stage = Stage(animation.scenes, animation.width)
    width, height = stage.size
    pictures = np.frombuffer(raw.stdout, np.uint8).reshape(-1, height, width, 3)
    assert len(pictures) == FRAMES
    for frame, picture in enumerate(pictures):
        assert_tip(picture, stage, frame)


def page_data(text):
    (data,) = re.findall(r'class="flexarm-data">(.*?)</script>', text, flags=re.DOTALL)
    return json.loads(data)


def test_page_needs_no_network_and_has_the_numbers(animation, tmp_path):
    animation.save(tmp_path / "arm.html")
    text = (tmp_path / "arm.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=|https?:|@import|url\(", text)
    assert len(text) < 200_000
    (scene,) = page_data(text)["scenes"]
    tips = np.array([links[-1][-1] for links in scene["links"]])
    # 1e-4 of the view, 2.4 m at most: half of the last digit.
    np.testing.assert_allclose(tips, animation.scenes[0].links[:, -1, -1], atol=5e-5)
    torque = np.array(scene["histories"][2]["lines"]).T
    np.testing.assert_allclose(torque, result().torque, atol=1e-5)


def test_long_run_is_shown_in_about_a_minute():
    """Half an hour has 54,000 frames at its own speed, more than an animation may have."""
    run = result()
    run = run.assign_coords(time=run.time * 1800.0 / float(run.time[-1]))
    long = fa.animate(run)
    assert long.speed == 50.0  # the nearest of 20, 50 and 100 to 36
    assert len(long.scenes[0].times) == 36 * 30 + 1
    assert long.scenes[0].times[-1] == 1800.0
    assert repr(long).endswith("36 s, at 50 times the speed of the run>")
    with pytest.raises(fa.InputError, match="at most 20000 frames"):
        fa.animate(run, speed=1.0)


def test_names_cannot_end_the_data_of_a_page():
    named = fa.animate({"</script><b>&": result()}, fps=5.0).html()
    assert "</script><b>" not in named
    assert page_data(named)["scenes"][0]["title"] == "</script><b>&"


def test_notebook_shows_the_page_in_a_frame(animation):
    shown = animation._repr_html_()
    (inside,) = re.findall(r'srcdoc="(.*?)"', shown, flags=re.DOTALL)
    assert html.unescape(inside) == animation.html()
    assert "<flexarm.Animation: 6 frames" in repr(animation)


def test_script_draws_the_tip_at_its_pixel(animation, tmp_path):
    """In Node with a canvas that records calls: at first, and after the slider has moved."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no Node.js")
    animation.save(tmp_path / "arm.html")
    script = os.path.join(os.path.dirname(__file__), "recording_canvas.js")
    done = subprocess.run([node, script, tmp_path / "arm.html"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    left, right, bottom, top = animation.scenes[0].view
    for frame, (x, y) in ((0, seen["first"]), (4, seen["moved"])):
        tip = animation.scenes[0].links[frame, -1, -1]
        # The script's box: 52 and 28 pixels from the corner of a canvas of 564 by 572 pixels.
        expected = (
            52 + 500 * (tip[0] - left) / (right - left),
            28 + 500 * (top - tip[1]) / (top - bottom),
        )
        assert (x, y) == pytest.approx(expected, abs=0.1)
    assert seen["playing"] == "Pause"
    assert seen["clock"] == "t = 0.160 s"


def test_without_ffmpeg_the_message_names_remedies(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(animations.shutil, "which", lambda name: None)
    with pytest.raises(fa.InputError, match=r"flexarm\[animation\].*\.gif or an \.html"):
        fa.animate(result(), tmp_path / "arm.mp4")
    assert not list(tmp_path.iterdir())


def test_errors_of_ffmpeg_are_in_the_message(tmp_path, monkeypatch, animation):
    broken = tmp_path / "ffmpeg"
    broken.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr("flexarm.view.plot.animation.find_ffmpeg", lambda *_: str(broken))
    (tmp_path / "out").mkdir()
    with pytest.raises(fa.InputError, match="Unknown encoder libx264"):
        animation.save(tmp_path / "out" / "arm.mp4")
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("suffix", [".gif", ".html"])
def test_full_disk_keeps_the_older_file(suffix, tmp_path, monkeypatch, animation):
    path = tmp_path / f"arm{suffix}"
    path.write_text("older")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("flexarm.base.writing.places.replace_file", full)
    with pytest.raises(fa.InputError, match="No space left on device"):
        animation.save(path)
    assert path.read_text() == "older"


def test_reference_of_another_arm_is_rejected():
    one = fa.Arm(links=[LINK])

    class Turn:
        def joint_angle(self, t):
            return np.array([0.1])

        joint_rate = joint_acceleration = joint_angle

    with pytest.raises(fa.InputError, match="2 joints"):
        fa.animate(result(), reference=Turn())
    assert fa.animate(fa.simulate(one, 0.01, rate=200.0), reference=Turn()).scenes


def test_narrow_pictures_have_room_for_their_panels():
    """The histories go below a narrow arm; three arms do not fit beside each other."""
    both = fa.animate(result(), fps=FPS, width=320)
    stage = Stage(both.scenes, both.width)
    assert stage.size[0] == 320
    assert all(box.get_position().height > 0.05 for box in stage.arms)
    many = fa.animate({"a": result(), "b": result(), "c": result()}, fps=FPS, width=320)
    with pytest.raises(fa.InputError, match="width must be at least 416 for 3 results, got 320"):
        Stage(many.scenes, many.width)
