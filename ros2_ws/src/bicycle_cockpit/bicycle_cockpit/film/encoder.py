"""Writing pictures as a film: MP4 and WebM by ffmpeg, GIF and WebP by Pillow."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

from PIL import Image

FORMATS = (".mp4", ".webm", ".gif", ".webp")
NAMED = "BICYCLE_FFMPEG"
"""Environment variable that names the program."""
QUALITY = 62
"""Quality of WebP, 0 to 100."""


class EncoderError(RuntimeError):
    """A film cannot be written."""


class Encoder(Protocol):
    """Takes the pictures of a film."""

    def add(self, picture: bytes) -> None:
        """Take a JPEG picture."""


def find_ffmpeg() -> str:
    """Return the path of ffmpeg: the named one, the system's, or that of `imageio-ffmpeg`.

    Raises:
        EncoderError: if there is none.
    """
    found = shutil.which(os.environ.get(NAMED) or "ffmpeg")
    if found is not None:
        return found
    with contextlib.suppress(ImportError, RuntimeError):
        # Optional: with this package no ffmpeg program is needed.
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    raise EncoderError(
        "MP4 and WebM need ffmpeg: sudo apt install ffmpeg, pip install imageio-ffmpeg, "
        f"or name one in {NAMED}; .gif and .webp need none"
    )


def check_format(path: Path) -> None:
    """Refuse a film that could not be written, before its pictures are drawn.

    Raises:
        EncoderError: on another ending, a missing folder, or without ffmpeg where it is needed.
    """
    if path.suffix.lower() not in FORMATS:
        raise EncoderError(f"{path} must end in {', '.join(FORMATS)}")
    if not path.absolute().parent.is_dir():
        raise EncoderError(f"the folder {path.absolute().parent} does not exist")
    if path.suffix.lower() in (".mp4", ".webm"):
        find_ffmpeg()


@contextlib.contextmanager
def encoder(path: Path, rate: float) -> Iterator[Encoder]:
    """Write a film of the pictures added in this context; nothing remains of a broken one.

    Args:
        path: of the film; its ending tells the format.
        rate: pictures per second.

    Raises:
        EncoderError: if it cannot be written.
    """
    check_format(path)
    kind = path.suffix.lower()
    with tempfile.TemporaryDirectory(dir=path.absolute().parent, prefix=".film-") as folder:
        result = Path(folder) / f"film{kind}"
        if kind in (".mp4", ".webm"):
            with _Ffmpeg(result, rate) as writer:
                yield writer
        else:
            images = _Images(result, rate)
            yield images
            images.close()
        result.replace(path)


class _Ffmpeg:
    """Pictures through a pipe to ffmpeg."""

    def __init__(self, path: Path, rate: float) -> None:
        codec = ["-c:v", "libx264", "-crf", "21", "-preset", "medium", "-movflags", "+faststart"]
        if path.suffix == ".webm":
            codec = ["-c:v", "libvpx-vp9", "-crf", "34", "-b:v", "0"]
        taken = ["-f", "image2pipe", "-c:v", "mjpeg", "-framerate", f"{rate:g}", "-i", "-"]
        command = [find_ffmpeg(), "-hide_banner", "-loglevel", "error", "-y", *taken]
        command += [*codec, "-pix_fmt", "yuv420p", str(path)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)

    def __enter__(self) -> _Ffmpeg:
        return self

    def add(self, picture: bytes) -> None:
        """Take a JPEG picture."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(picture)
        except BrokenPipeError:
            raise EncoderError(f"ffmpeg fails: {self._end()}") from None

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._process.kill()
            self._process.communicate()
            return
        said = self._end()
        if self._process.returncode:
            raise EncoderError(f"ffmpeg fails: {said}")

    def _end(self) -> str:
        _, said = self._process.communicate()
        lines = said.decode(errors="replace").strip().splitlines()
        return lines[-1][:200] if lines else f"status {self._process.returncode}"


class _Images:
    """Pictures in one animated image."""

    def __init__(self, path: Path, rate: float) -> None:
        self._path, self._rate = path, rate
        self._pictures: list[bytes] = []

    def add(self, picture: bytes) -> None:
        """Take a JPEG picture."""
        self._pictures.append(picture)

    def close(self) -> None:
        """Write the image."""
        if not self._pictures:
            raise EncoderError("the film has no picture")
        images = (Image.open(io.BytesIO(data)).convert("RGB") for data in self._pictures)
        more: dict[str, Any] = {"save_all": True, "duration": round(1000 / self._rate), "loop": 0}
        if self._path.suffix == ".webp":
            first = next(images)
            first.save(self._path, append_images=images, quality=QUALITY, method=4, **more)
            return
        # One palette for all pictures: a palette for each would flicker.
        middle = Image.open(io.BytesIO(self._pictures[len(self._pictures) // 2]))
        palette = middle.convert("RGB").quantize(224)
        reduced = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
        next(reduced).save(self._path, append_images=reduced, optimize=False, **more)
