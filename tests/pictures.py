"""What can be said of a picture without looking at it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image


def inked(path: str | Path) -> float:
    """Return the share of a picture that differs from its most frequent colour."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    _, counts = np.unique(pixels, axis=0, return_counts=True)
    return 1.0 - counts.max() / len(pixels)
