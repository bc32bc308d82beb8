"""Animations of results: the arm to scale, and time histories with a cursor at the current time."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.arguments import (
    check_count,
    check_dataset,
    check_number,
)
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.late import xr
from flexarm.base.writing.places import AnyPath, check_place, write_text, write_whole
from flexarm.model import Contact
from flexarm.model.quantities import Flag, Positive
from flexarm.simulation.calls.result import arm_of
from flexarm.view.plot import drawn_result
from flexarm.view.plot.animation.scene import (
    Scene,
    SceneOptions,
    inline,
    page,
    scene_of,
    surroundings,
    thin,
)
from flexarm.view.plot.magnified import Magnify, check_magnify, nearest_round
from flexarm.view.plot.palette import GREY, INK, SERIES

if TYPE_CHECKING:
    from flexarm.view.plot.animation.frames import Picture


#: File suffixes of animations.
SUFFIXES = (".mp4", ".gif", ".html")
_HINT = (
    "Install one with: pip install 'flexarm[animation]', which brings its own ffmpeg; "
    "or write a .gif or an .html file, which need none."
)
#: Exact colours of the lines; the rest of the palette is for their antialiased edges.
_HOUSE = [int(color[k : k + 2], 16) for color in (*SERIES, INK, GREY) for k in (1, 3, 5)]


def find_ffmpeg(name: str = "path") -> str:
    """Return the path of ffmpeg, from ``imageio-ffmpeg`` or from the system, or raise."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError, OSError):  # not installed, or not available for this CPU
        program = shutil.which("ffmpeg")
    if program is None:
        raise InputError(Problem(name, "is an .mp4 file, which needs ffmpeg", hint=_HINT))
    return program


def check_animation_place(name: str, path: AnyPath) -> Path:
    """Return the path of an animation's file after checking that it can be written."""
    place = check_place(name, path, SUFFIXES)
    if place.suffix.lower() == ".mp4":
        find_ffmpeg(name)
    return place


def mp4(
    pictures: Iterable[Picture], size: tuple[int, int], fps: float, ffmpeg: str
) -> Iterator[bytes]:
    """Yield the parts of an MP4 file (H.264) of frames (height, width, 4) RGBA, both even."""
    width, height = size
    with tempfile.TemporaryDirectory(prefix="flexarm-") as folder:
        video = Path(folder) / "video.mp4"  # a file, because its index has to move to the front
        command = [ffmpeg, "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba"]
        command += ["-s", f"{width}x{height}", "-r", f"{fps:g}", "-i", "-", "-an"]
        command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-pix_fmt", "yuv420p"]
        command += ["-movflags", "+faststart", os.fspath(video)]
        _encode(command, pictures)
        with open(video, "rb") as file:
            while part := file.read(1 << 20):
                yield part


def _encode(command: list[str], pictures: Iterable[Picture]) -> None:
    """Feed frames to ffmpeg."""
    try:
        with tempfile.TemporaryFile() as words:
            program = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=words)
            assert program.stdin is not None
            try:
                for picture in pictures:
                    program.stdin.write(picture.data)
            except BrokenPipeError:
                pass  # ffmpeg has stopped, and its error output contains the reason
            except BaseException:
                program.kill()
                raise
            finally:
                with contextlib.suppress(BrokenPipeError):
                    program.stdin.close()
                status = program.wait()
            words.seek(0)
            reported = words.read().decode(errors="replace").strip()
    except OSError as error:
        raise _failed(command[0], error.strerror or str(error)) from None
    if status:
        reason = reported.splitlines()[-1][:200] if reported else f"exit status {status}"
        raise _failed(command[0], reason)


def _failed(ffmpeg: str, reason: str) -> InputError:
    hint = f"{Path(ffmpeg).name} reported: {reason}. {_HINT}"
    return InputError(Problem("the video", "could not be encoded by ffmpeg", hint=hint))


def gif_delay(fps: float) -> int:
    """Return the delay between frames of a GIF in units of 10 ms, at least the 2 players accept."""
    return max(2, round(100.0 / fps))


def gif(pictures: Iterable[Picture], fps: float) -> bytes:
    """Return a GIF that repeats, with one palette for all frames to avoid flicker."""
    from io import BytesIO

    from PIL import Image

    frames: list[Any] = []
    palette = None
    for picture in pictures:
        image = Image.fromarray(np.ascontiguousarray(picture[..., :3]))
        if palette is None:
            others = image.quantize(256 - len(_HOUSE) // 3).getpalette() or []
            palette = Image.new("P", (1, 1))
            palette.putpalette([*_HOUSE, *others])
        frames.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    stream = BytesIO()
    options = {"duration": 10 * gif_delay(fps), "loop": 0, "disposal": 1, "optimize": False}
    frames[0].save(stream, "GIF", save_all=True, append_images=frames[1:], **options)
    return stream.getvalue()


_MOST_FRAMES, _MOST_RESULTS, _MOST_HISTORIES = 20_000, 4, 6
#: Shown duration of a long run, s; a round speed changes it by up to 58 %.
_MINUTE = 50.0
#: Intervals of a history whose extreme values are drawn, about one for two columns of a screen.
_INTERVALS = 450


class Animation:
    """Animation of one or several results, from `animate`; notebooks display it as a player.

    Attributes:
        scenes: drawn scenes, one for each result.
        fps: frames per second.
        speed: seconds of the run per second of the animation.
        width: of pictures, pixels.
    """

    def __init__(self, scenes: Sequence[Scene], fps: float, speed: float, width: int) -> None:
        self.scenes, self.fps, self.speed, self.width = tuple(scenes), fps, speed, width

    def __repr__(self) -> str:
        frames = len(self.scenes[0].times)
        pace = "" if self.speed == 1.0 else f", at {self.speed:g} times the speed of the run"
        return f"<flexarm.Animation: {frames} frames, {frames / self.fps:.3g} s{pace}>"

    def html(self) -> str:
        """Return an HTML page that plays the animation without a network."""
        return page(self.scenes, self.fps, self.speed, self.scenes[0].title or "flexarm")

    def _repr_html_(self) -> str:
        histories = len(self.scenes[0].histories)
        height = 650 if len(self.scenes) == 1 else 510 + 175 * histories
        return inline(self.html(), height)

    def pictures(self) -> Iterator[Picture]:
        """Yield the frames, (height, width, 4) RGBA from 0 to 255, in one array that is reused."""
        from flexarm.view.plot.animation.frames import Stage

        return Stage(self.scenes, self.width).pictures()

    @public_call
    def save(self, path: AnyPath) -> None:
        """Write the animation to an .mp4, .gif or .html file, completely or not at all.

        Raises:
            InputError: if the file cannot be written, or is an .mp4 and ffmpeg is not installed.
        """
        place = check_animation_place("path", path)
        suffix = place.suffix.lower()
        if suffix == ".html":
            write_text(self.html(), place)
            return
        from flexarm.view.plot.animation.frames import Stage

        stage = Stage(self.scenes, self.width)
        if suffix == ".gif":
            write_whole(place, [gif(stage.pictures(), self.fps)])
            return
        ffmpeg = find_ffmpeg()
        write_whole(place, mp4(stage.pictures(), stage.size, self.fps, ffmpeg))


@public_call
def animate(
    results: xr.Dataset | Mapping[str, xr.Dataset] | Sequence[xr.Dataset],
    path: AnyPath | None = None,
    *,
    channels: str | Sequence[str] | None = None,
    magnify: Magnify = "auto",
    rigid: bool | xr.Dataset = False,
    reference: Any = None,
    contacts: Sequence[Contact] | None = None,
    trace: Flag = True,
    torque: Flag = True,
    speed: Positive | None = None,
    fps: float = 30.0,
    width: int = 1120,
) -> Animation:
    """Create an animation of an arm's motion as a video, a GIF, or an HTML page.

    Args:
        results: a result of ``simulate``, ``run_scenario`` or ``read_result``; or up to four, by
            name or as a list, side by side.
        path: of an .mp4, .gif or .html file to write; None for none. An .mp4 requires ffmpeg, which
            ``pip install 'flexarm[animation]'`` includes.
        channels: channels to draw over time beside the arm, as in ``plot.history``; at most six,
            ``[]`` for none.
        magnify: factor on the bending of the links, which the picture states, beside a ghost of the
            true shape. "auto" draws the largest deflection at about 5 % of its link, by a factor of
            1, 2 or 5 times a power of ten; the player has a slider for it. Joint angles do not
            change; path and tip are those of the drawn arm. With closures or surfaces, the ends of
            links keep their places.
        rigid: True adds the rigid counterpart at the same joint angles, dashed; a result, such as
            that of ``arm.rigid()`` with the same torques, adds the arm of that result.
        reference: motion that contains the reference path of the tip. By default that of the
            scenario, for results of a scenario.
        contacts: contacts whose surfaces to draw. By default those of the scenario, for results of
            a scenario.
        trace: whether to draw the path of the tip.
        torque: whether to draw the joint torques as arrows; the longest is the largest torque of
            the run.
        speed: seconds of the run per second of the animation: 0.1 is slow motion. By default 1; a
            run with more than 20,000 frames then is shown in about a minute.
        fps: frames per second. For a GIF the nearest rate of its format: 50, 33.3, 25, 20, ...
        width: of the pictures of a video or GIF, pixels.

    Returns:
        An `Animation`, with ``save(path)``, ``html()`` and ``pictures()``; a notebook displays it
        as a player.

    Raises:
        InputError: if an argument has the wrong type or is out of range, the file cannot be
            written, or an .mp4 is requested and ffmpeg is not installed.
    """
    named = _named(results)
    place = None if path is None else check_animation_place("path", path)
    fps = check_number("fps", fps, lambda rate: 1.0 <= rate <= 240.0, "be from 1 to 240")
    if place is not None and place.suffix.lower() == ".gif":
        fps = 100.0 / gif_delay(fps)
    magnify = check_magnify(magnify)
    width = check_count("width", width, 320, 7680)
    if speed is None:
        duration = max(float(np.ptp(result["time"].values)) for result in named.values())
        speed = nearest_round(duration / _MINUTE) if duration * fps > _MOST_FRAMES else 1.0
    times = _times(named, fps, speed)
    motions, drawings = [], []
    for name, result in named.items():
        arm = arm_of("results", result)
        none = isinstance(channels, list | tuple) and not channels
        histories = [] if none else drawn_result.several("channels", channels, result)
        if len(histories) > _MOST_HISTORIES:
            rule = f"be at most {_MOST_HISTORIES} channels"
            raise InputError(Problem("channels", rule, shown(len(histories))))
        desired, touched = surroundings(arm, result, reference, contacts)
        ghost = drawn_result.rigid_result(rigid, arm, result)
        options = SceneOptions(1.0, trace, torque, ghost, desired, touched)
        motions.append((arm, result, bool(touched)))
        drawings.append((name, options, [thin(signals, _INTERVALS) for signals in histories]))
    factor = drawn_result.factor_of(magnify, motions)
    scenes = [
        scene_of(name, arm, result, times, replace(options, magnify=factor), histories)
        for (arm, result, _), (name, options, histories) in zip(motions, drawings, strict=True)
    ]
    if len({len(scene.histories) for scene in scenes}) > 1:
        rule = "are required, because the results have different ones"
        raise InputError(Problem("channels", rule))
    animation = Animation(scenes, fps, speed, width - width % 2)
    if place is not None:
        animation.save(place)
    return animation


def _named(results: object) -> dict[str, xr.Dataset]:
    """Return the results by title, which is empty for a single result."""
    if isinstance(results, Mapping | list | tuple) and not hasattr(results, "data_vars"):
        named = drawn_result.named_results(results, _MOST_RESULTS)
    else:
        named = {"": check_dataset("results", results)}
    return {name: drawn_result.check_drawable("results", result) for name, result in named.items()}


def _times(named: Mapping[str, xr.Dataset], fps: float, speed: float) -> np.ndarray:
    """Return the times of the frames since the start, up to the end of the longest run, s."""
    spans = [float(np.ptp(result["time"].values)) for result in named.values()]
    frames = max(spans) / speed * fps
    if frames > _MOST_FRAMES:
        rule = f"give at most {_MOST_FRAMES} frames"
        hint = "Use a larger speed or a smaller fps."
        raise InputError(Problem("results", rule, f"{frames:.0f} frames", hint))
    # The last frame is always the end of the run.
    times = np.arange(int(frames * (1.0 + 1e-12)) + 1) * (speed / fps)
    return times if times[-1] > max(spans) - 1e-9 * speed / fps else np.append(times, max(spans))
