"""Encoding of frames as MP4 or GIF."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.base.writing.places import AnyPath, check_place
from flexarm.view.plot.selection import GREY, INK, SERIES

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
        found = shutil.which("ffmpeg")
    if found is None:
        raise InputError(Problem(name, "is an .mp4 file, which needs ffmpeg", hint=_HINT))
    return found


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
        raise _failed(
            command[0], reported.splitlines()[-1][:200] if reported else f"exit status {status}"
        )


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
