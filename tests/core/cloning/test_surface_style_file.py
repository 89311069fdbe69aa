"""Styles of surfaces in folders: the same to the last bit, or refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.cloning.surface_generation import generate_surfaces
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.cloning.surface_style_file import (
    CARD_FILE,
    holds_surface_style,
    load_surface_style,
    save_surface_style,
)
from mbstudio.core.errors import CloningError
from mbstudio.core.sealing import seal_json


def test_a_style_comes_back_to_the_last_bit(fitted_style: SurfaceStyle, tmp_path: Path) -> None:
    folder = save_surface_style(fitted_style, tmp_path / "stones")
    assert holds_surface_style(folder)
    again = load_surface_style(folder)
    assert [parent.name for parent in again.parents] == [parent.name for parent in fitted_style.parents]
    assert (again.modes == fitted_style.modes).all()
    one, other = (generate_surfaces(style, 2, 3) for style in (fitted_style, again))
    for first, second in zip(one.clones, other.clones, strict=True):
        assert (first.surface.vertices == second.surface.vertices).all()
        assert first.fitted is not None
        assert second.fitted is not None
        assert (first.fitted.avatar.weights == second.fitted.avatar.weights).all()


def test_a_style_without_avatars_comes_back(style: SurfaceStyle, tmp_path: Path) -> None:
    again = load_surface_style(save_surface_style(style, tmp_path / "stones"))
    assert again.avatars == ()
    assert again.misfit == style.misfit


def test_flipped_bits_are_told(style: SurfaceStyle, tmp_path: Path, rng: np.random.Generator) -> None:
    folder = save_surface_style(style, tmp_path / "stones")
    for path in sorted(folder.iterdir()):
        whole = path.read_bytes()
        for _ in range(20):
            damaged = bytearray(whole)
            place = int(rng.integers(40, len(damaged)))
            damaged[place] ^= 1 << int(rng.integers(8))
            path.write_bytes(damaged)
            with pytest.raises(CloningError, match="stones"):
                load_surface_style(folder)
        path.write_bytes(whole)


@pytest.mark.parametrize(
    "change",
    [
        {"names": None},
        {"names": ["one"]},
        {"unit": "furlong"},
        {"misfit": -1.0},
        {"format": 99},
        {"kind": "?"},
    ],
    ids=str,
)
def test_cards_of_strangers_are_refused(
    style: SurfaceStyle, tmp_path: Path, change: dict[str, object]
) -> None:
    folder = save_surface_style(style, tmp_path / "stones")
    card = folder / CARD_FILE
    told = json.loads(card.read_text())
    told.pop("seal", None)
    card.write_bytes(seal_json({**told, **change}))
    with pytest.raises(CloningError, match="surface-style"):
        load_surface_style(folder)


def test_a_folder_without_a_style_is_told(tmp_path: Path) -> None:
    assert not holds_surface_style(tmp_path)
    with pytest.raises(CloningError, match="cannot be read"):
        load_surface_style(tmp_path)
