from __future__ import annotations

import pytest

from mbstudio.core.memory import readable_bytes


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 bytes"),
        (999, "999 bytes"),
        (1000, "1.00 kB"),
        (448e6, "448 MB"),
        (999_600, "1.00 MB"),
        (14.2e9, "14.2 GB"),
        (9.996e9, "10.0 GB"),
        (1.5e12, "1500 GB"),
    ],
)
def test_bytes_are_read_at_a_glance(count: float, words: str) -> None:
    assert readable_bytes(count) == words
