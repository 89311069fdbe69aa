"""What is packed is unpacked up to its length, and the checksum behind it is compared."""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.errors import ScanError
from mbstudio.core.scan.readers.unpacking import inflated, unpacked

CONTENT = np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes()
PACKINGS = {"zlib": zlib.compress, "gzip": gzip.compress}


@pytest.mark.parametrize("packing", PACKINGS)
def test_every_flip_and_every_cut_is_told_or_changes_nothing(packing: str) -> None:
    packed = PACKINGS[packing](CONTENT)
    assert inflated(packed, len(CONTENT), packing) == CONTENT
    told = 0
    for place in [*range(30), *range(30, len(packed), 97), *range(len(packed) - 12, len(packed))]:
        damaged = bytearray(packed)
        damaged[place] ^= 16
        for content in (bytes(damaged), packed[:place]):
            try:
                found = inflated(content, len(CONTENT), packing)
            except zlib.error:
                told += 1
            else:
                assert found == CONTENT
    assert told > 100


def test_no_more_is_unpacked_than_one_byte_too_many() -> None:
    assert len(inflated(zlib.compress(bytes(10**7)), 100, "zlib")) == 101


def test_what_follows_may_be_left_out_and_its_checksum_counts() -> None:
    packed = bytearray(gzip.compress(CONTENT + bytes(100)))
    path = Path("s.nii.gz")
    found = unpacked(io.BytesIO(packed), "gzip", len(CONTENT), path, spare=100)
    assert found.tobytes() == CONTENT
    with pytest.raises(ScanError, match="more packed voxels"):
        unpacked(io.BytesIO(packed), "gzip", len(CONTENT), path, spare=99)
    packed[-6] ^= 1
    with pytest.raises(ScanError, match="cannot be unpacked"):
        unpacked(io.BytesIO(packed), "gzip", len(CONTENT), path, spare=100)
