"""What the numbers of an image stand for: one decoder for scans, slices and label images alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt16

from mbstudio.core.errors import ScanError

# Grey pictures that went through JPEG come back with colours that differ by rounding.
_LOSSY_TOLERANCE = 2


@dataclass(frozen=True, eq=False)
class PixelMeaning:
    """How a format says that its pixels are to be seen.

    Attributes
    ----------
    white_is_zero : bool
        Small numbers are bright (TIFF's MINISWHITE).
    bits : int
        Bits a sample, which set the largest number.
    palette : uint16 array, shape (n, 3), or None
        Colour of each number.
    samples : int
        Values a pixel, on the last axis where there are several: grey with alpha, RGB or RGBA.
    lossy : bool
        Whether equal colours may differ by rounding.
    slope, intercept : float
        What the stored numbers are multiplied by, and what is added then.
    """

    white_is_zero: bool = False
    bits: int = 8
    palette: UInt16[np.ndarray, "n 3"] | None = None
    samples: int = 1
    lossy: bool = False
    slope: float = 1.0
    intercept: float = 0.0

    @property
    def is_rescaled(self) -> bool:
        """Whether the stored numbers are not the values that they stand for."""
        return self.slope != 1 or self.intercept != 0

    @property
    def is_plain(self) -> bool:
        """Whether the numbers are the grey values as they stand."""
        is_single = self.palette is None and self.samples == 1 and self.bits > 1
        return is_single and not self.white_is_zero and not self.is_rescaled


def decode(
    image: Shaped[np.ndarray, "*shape"], meaning: PixelMeaning, name: object, *, numbers: bool = False
) -> Shaped[np.ndarray, "*shape"]:
    """Return grey values, large ones bright, or the numbers of grains.

    Parameters
    ----------
    image : array
        Any number of axes; the samples of a pixel on the last one where there are several.
    meaning : PixelMeaning
    name : object
        What to call the image in messages.
    numbers : bool
        The pixels are numbers of grains: colours of a palette and white at zero do not count.

    Raises
    ------
    ScanError
        If the image is in colour.
    """
    if meaning.samples > 1:
        image = _one_sample(image, meaning, name, numbers)
    if meaning.palette is not None:
        image = _through_palette(image, meaning.palette, name, numbers)
    image = plain_numbers(image)
    if meaning.is_rescaled:
        image = _rescaled(image, meaning)
    if meaning.white_is_zero and not numbers:
        image = inverted(image, meaning.bits)
    return image


def plain_numbers(image: Any) -> Any:
    """Return truth values as 0 and 1, and half-precision numbers as single: what all else can count with."""
    if image.dtype.kind == "b":
        return image.view(np.uint8)
    if image.dtype.kind == "f" and image.dtype.itemsize == 2:
        return image.astype(np.float32)
    return image


def inverted(image: np.ndarray, bits: int) -> np.ndarray:
    """Return an image whose zero is white as one whose zero is black."""
    if image.dtype.kind == "f":
        return -image
    if image.dtype.kind == "i":
        return ~image
    largest = image.dtype.type(min(2**bits, 2 ** (8 * image.dtype.itemsize)) - 1)
    return np.asarray(largest - image)


def _rescaled(image: np.ndarray, meaning: PixelMeaning) -> np.ndarray:
    """Return the values that stored numbers stand for: whole ones where they can be, else real ones."""
    if meaning.slope == 1 and meaning.intercept == int(meaning.intercept) and image.dtype.kind in "iu":
        largest = 2.0 ** min(meaning.bits, 8 * image.dtype.itemsize) + abs(meaning.intercept)
        kind = np.int16 if largest < 2**15 else np.int32
        if largest < 2**31:
            return np.add(image.astype(kind), kind(meaning.intercept))  # type: ignore[no-any-return]
    is_small = image.dtype.itemsize <= 2 or image.dtype == np.float32
    real = np.float32 if is_small else np.float64
    with np.errstate(all="ignore"):  # what becomes infinite is told where the voxels are used
        values: np.ndarray = image.astype(real)
        np.multiply(values, real(meaning.slope), out=values)
        np.add(values, real(meaning.intercept), out=values)
    return values


def _one_sample(image: np.ndarray, meaning: PixelMeaning, name: object, numbers: bool) -> np.ndarray:
    """Return the grey values of an image of several samples a pixel."""
    count = image.shape[-1]
    if count not in (2, 3, 4):
        raise ScanError(
            f"{name} contains {count} values per pixel: save one channel of grey values as its own file."
        )
    tolerance = _LOSSY_TOLERANCE if meaning.lossy else 0
    first = image[..., 0]
    if count > 2:
        for other in (image[..., 1], image[..., 2]):
            low, high = np.minimum(first, other), np.maximum(first, other)
            if (high - low > tolerance).any():
                what = "colours instead of grain numbers" if numbers else "colour images"
                raise ScanError(
                    f"{name} contains {what}: convert it to grey values first, "
                    "for example in ImageJ with Image > Type > 16-bit."
                )
    if count != 3:
        alpha = image[..., -1]
        if alpha.size and (alpha != alpha.flat[0]).any():
            raise ScanError(f"{name} contains partly transparent pixels: save it without an alpha channel.")
    return np.ascontiguousarray(image[..., 1] if count > 2 and meaning.lossy else first)


def _through_palette(
    image: np.ndarray, palette: UInt16[np.ndarray, "n 3"], name: object, numbers: bool
) -> np.ndarray:
    """Return what a palette of greys shows; numbers as they are where it is one of colours."""
    index = image.astype(np.uint8) if image.dtype.kind == "b" else image
    used = np.unique(index)
    if used.size and int(used[-1]) >= len(palette):
        raise ScanError(f"{name} contains numbers that its palette lacks: export it again as grey values.")
    # One slice alone may show none of the colours: numbers are taken by the palette as a whole.
    shown = palette if numbers else palette[used]
    is_grey = bool((shown == shown[:, :1]).all())
    if not is_grey:
        if numbers:
            return index
        raise ScanError(
            f"{name} has a colour palette that does not say which colours are bright: "
            "convert it to grey values first, for example in ImageJ with Image > Lookup Tables > Grays."
        )
    greys = palette[:, 0]
    if numbers and len(np.unique(greys)) < len(greys):
        return index  # two grains of one grey are two grains
    if not (greys % 257).any():
        return np.asarray((greys // 257).astype(np.uint8)[index])
    if not (greys % 256).any():
        return np.asarray((greys // 256).astype(np.uint8)[index])
    return np.asarray(greys.astype(np.uint16)[index])
