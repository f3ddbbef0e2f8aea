"""Films: pictures encoded as H.264 in MP4, or as GIF, by the FFmpeg libraries that PyAV brings along."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from PIL import Image

from swarm_mj.errors import OutputError
from swarm_mj.io.atomic import atomic_file
from swarm_mj.typing import Pixels

#: Kinds of film by the file's ending.
SUFFIXES = (".mp4", ".gif")
#: H.264: visually lossless to most eyes, at a speed that leaves the time to rendering.
H264_OPTIONS = {"crf": "20", "preset": "veryfast"}
#: A GIF counts time in hundredths of a second and has 256 colours for all its pictures.
GIF_CLOCK, GIF_COLOURS = 100, 256


class Film(Protocol):
    """Takes pictures one by one, shape (height, width, 3)."""

    def add(self, pixels: Pixels) -> None:
        """Append a picture."""
        ...


def check_film(path: Path, width: int, height: int, fps: float) -> None:
    """Refuse what cannot be encoded.

    Raises:
        OutputError: Unknown ending, odd size of an MP4, or a rate out of range.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: the name of a film must end in {' or '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mp4" and (width % 2 or height % 2):
        raise OutputError(f"size {width}x{height}: both sides of an MP4 must be even")
    highest = GIF_CLOCK / 2 if path.suffix.lower() == ".gif" else 240
    if not 0.1 <= fps <= highest:
        raise OutputError(f"fps {fps:g}: must be 0.1 to {highest:g} for {path.suffix}")


@contextmanager
def film(path: Path, *, width: int, height: int, fps: float, sample: Iterable[Pixels] = ()) -> Iterator[Film]:
    """A film that appears whole or not at all; one process at a time may make it.

    Args:
        path: Where; its ending chooses the kind.
        width: [pixel].
        height: [pixel].
        fps: Pictures per second.
        sample: Some pictures like those to come, from which the colours of a GIF are chosen; an MP4 needs none.

    Raises:
        OutputError: The film cannot be encoded as asked, or the file cannot be written.
    """
    check_film(path, width, height, fps)
    with atomic_file(path) as partial:
        size = width, height
        mp4 = path.suffix.lower() == ".mp4"
        writer = _Mp4(partial, *size, fps) if mp4 else _Gif(partial, *size, fps, sample)
        try:
            yield writer
            writer.finish()
        finally:
            writer.close()


class _Encoder:
    """One video stream in a file."""

    def __init__(self, path: Path, container: str, codec: str, fps: float, options: dict[str, Any]) -> None:
        import av

        self._av = av
        rate = Fraction(fps).limit_denominator(1001)
        self._container = av.open(str(path), "w", format=container, options=options)
        self._stream: Any = self._container.add_stream(codec, rate=rate)

    def _encode(self, frame: Any) -> None:
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def finish(self) -> None:
        """Write what the encoder still holds."""
        self._encode(None)

    def close(self) -> None:
        """Close the file, finished or not."""
        self._container.close()


class _Mp4(_Encoder):
    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        super().__init__(path, "mp4", "libx264", fps, {"movflags": "faststart"})
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "yuv420p"
        self._stream.options = H264_OPTIONS

    def add(self, pixels: Pixels) -> None:
        """Append a picture."""
        self._encode(self._av.VideoFrame.from_ndarray(pixels, format="rgb24"))


class _Gif(_Encoder):
    def __init__(self, path: Path, width: int, height: int, fps: float, sample: Iterable[Pixels]) -> None:
        self._palette = _palette(sample)
        colours = np.zeros((GIF_COLOURS, 3), np.uint8)
        given = np.array(self._palette.getpalette(), np.uint8).reshape(-1, 3)
        colours[: len(given)] = given
        opaque = np.full((GIF_COLOURS, 1), 255, np.uint8)
        self._argb = np.ascontiguousarray(np.hstack((opaque, colours)))
        super().__init__(path, "gif", "gif", fps, {"loop": "0"})
        self._stream.width, self._stream.height, self._stream.pix_fmt = width, height, "pal8"

    def add(self, pixels: Pixels) -> None:
        """Append a picture."""
        indexed = np.array(Image.fromarray(pixels).quantize(palette=self._palette, dither=Image.Dither.NONE))
        self._encode(self._av.VideoFrame.from_ndarray((indexed, self._argb), format="pal8"))


def _palette(sample: Iterable[Pixels]) -> Image.Image:
    """The colours that suit sample pictures, as an image that carries them."""
    stack = np.vstack(list(sample))
    return Image.fromarray(stack).quantize(GIF_COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
