"""The files beside the code are found, and what is missing is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from mbstudio.core.assets import asset, assets_folder
from mbstudio.core.errors import MbstudioError


def test_the_sample_recipe_is_there(repository: Path) -> None:
    assert assets_folder() == repository / "assets"
    assert asset("sample_scan.toml").read_text().startswith("#")


def test_a_missing_asset_is_named() -> None:
    with pytest.raises(MbstudioError, match=r"nothing\.svg is missing"):
        asset("nothing.svg")
