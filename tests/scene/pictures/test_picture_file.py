"""Pictures as files: an ending that no picture has is refused as the docstring says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbstudio.scene.pictures.picture_file import write_picture


@pytest.mark.parametrize("name", ["view.sand", "view"])
def test_the_ending_of_no_picture_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(OSError, match="the ending of no picture"):
        write_picture(tmp_path / name, np.zeros((4, 4, 3), np.uint8))
    assert not list(tmp_path.iterdir())
