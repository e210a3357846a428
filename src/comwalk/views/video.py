"""Films as MP4, written by PyAV (extra `video`)."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RunError, one_line

FILMS = (".mp4", ".webp", ".gif")
"""Endings of films."""

STILLS = (".png", ".jpg", ".jpeg")
"""Endings of stills; a .webp may be one too."""


def check_film(path: str | Path) -> None:
    """Refuse a film or picture that cannot be written, before hours are spent on it.

    Args:
        path: The file to be.

    Raises:
        RunError: If its ending is unknown, or it is an MP4 and PyAV is missing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (*FILMS, *STILLS):
        raise RunError(
            f"cannot write the picture {path}: its name must end in .mp4, .webp, .gif, "
            ".png or .jpg"
        )
    if suffix == ".mp4" and find_spec("av") is None:
        raise RunError(
            f"{path}: an MP4 needs: pip install 'comwalk[video]'; a .webp needs nothing"
        )


@contextmanager
def mp4_writer(
    path: str | Path, fps: float, quality: int
) -> Generator[Callable[[np.ndarray], None]]:
    """Open a film as H.264 in MP4; an odd last row or column is left out.

    Args:
        path: The file.
        fps: Pictures per second.
        quality: 1 to 100; more makes a larger file.

    Yields:
        What takes the next picture, of shape (height, width, 3), uint8.

    Raises:
        RunError: If PyAV is missing, or the file cannot be written.
    """
    check_film(path)
    import av

    rate = Fraction(fps).limit_denominator(1000)
    crf = str(round(40 - 0.3 * quality))
    try:
        with av.open(str(path), "w", options={"movflags": "+faststart"}) as file:
            stream: Any = file.add_stream("libx264", rate=rate, options={"crf": crf})
            stream.pix_fmt = "yuv420p"

            def put(picture: np.ndarray) -> None:
                """Add a picture, whose sizes are cut to even numbers."""
                height, width = (n - n % 2 for n in picture.shape[:2])
                if not stream.codec_context.is_open:
                    stream.width, stream.height = width, height
                even = np.ascontiguousarray(picture[:height, :width])
                frame = av.VideoFrame.from_ndarray(even, format="rgb24")
                file.mux(stream.encode(frame))

            yield put
            file.mux(stream.encode())
    except av.error.FFmpegError as error:
        raise RunError(f"cannot write the film {path}: {one_line(error)}") from None
