"""PNG, BMP and JPEG images: one slice each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.pixels import PixelMeaning, decode

# Pillow's modes: bits a sample, samples a pixel.
_MODES = {
    "1": (1, 1), "L": (8, 1), "P": (8, 1), "I;16": (16, 1), "I;16B": (16, 1), "I;16L": (16, 1), "I": (32, 1),
    "F": (32, 1), "LA": (8, 2), "RGB": (8, 3), "RGBA": (8, 4),
}  # fmt: skip


def read_picture(file: Path, numbers: bool) -> np.ndarray:
    """Return the image of a file, decoded: grey values or numbers of grains."""
    from PIL import Image

    with Image.open(file) as image:
        if getattr(image, "n_frames", 1) > 1:
            raise ScanError(f"The slice {file} contains several images instead of one.")
        if image.mode not in _MODES:
            raise ScanError(
                f"The slice {file} is a colour image ({image.mode}): convert the slices to grey values first."
            )
        bits, samples = _MODES[image.mode]
        palette = _palette(image)
        array = np.asarray(image)
        if image.mode == "1":
            array = array != 0
    if image.mode == "I" and array.size and array.min() >= 0 and array.max() < 2**16:
        array = array.astype(np.uint16)  # 16-bit grey that Pillow hands out in 32
    meaning = PixelMeaning(False, bits, palette, samples, image.format in ("JPEG", "MPO"))
    return decode(array, meaning, f"The slice {file}", numbers=numbers)


def describe_picture(file: Path) -> tuple[tuple[int, int], str]:
    """Return rows and columns of an image and what its pixels are, from its header alone."""
    from PIL import Image

    with Image.open(file) as image:
        return (image.height, image.width), f"mode {image.mode}"


def _palette(image: Any) -> np.ndarray | None:
    """Return the colours of a palette as 16-bit numbers."""
    if image.mode != "P" or image.palette is None:
        return None
    colours = np.frombuffer(image.palette.convert("RGB").tobytes() if image.palette.mode != "RGB" else
                            image.palette.tobytes(), np.uint8)  # fmt: skip
    return colours[: len(colours) // 3 * 3].reshape(-1, 3).astype(np.uint16) * np.uint16(257)
