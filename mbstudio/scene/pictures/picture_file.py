"""A picture as a file: the old one or the new one is there, whatever happens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from mbstudio.core.replacement import replacing


def write_picture(path: Path, image: UInt8[np.ndarray, "h w 3"]) -> None:
    """Write a picture in the format that the file's ending names.

    Raises
    ------
    OSError
        If the ending is none of a picture's, the folder cannot be written, or the disk is full.
    """
    import imageio.v3 as imageio
    from PIL import Image

    if path.suffix.lower() not in Image.registered_extensions():
        raise OSError(f"{path} has the ending of no picture: use .png, .jpg, .tif or .bmp")
    # Not into the file: most formats' writers do not tell that a disk is full.
    content = imageio.imwrite("<bytes>", image, extension=path.suffix)
    assert isinstance(content, bytes)
    with replacing(path) as temporary:
        temporary.write_bytes(content)
