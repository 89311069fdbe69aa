"""Shaped grains in a file: all that each follows from, so that it can be taken up again with its style."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.cloning.surface_bands import Gains
from mbstudio.core.cloning.surface_studio import GrainShape
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError
from mbstudio.core.plain_files import PlainFileError, read_json

SHAPES_FILE = "shapes.json"
"""Name of the file beside the grains."""
_FORMAT, _VERSION = "mbstudio shapes", 1
_SQUARE = 1e-6
"""How far a turn may be from an orthogonal matrix."""


def surface_style_digest(style: SurfaceStyle) -> str:
    """Return a digest of the parents and warps of a style: what shapes refer to."""
    found = hashlib.sha256(np.ascontiguousarray(style.modes).tobytes())
    for parent in style.parents:
        found.update(np.ascontiguousarray(parent.vertices).tobytes())
        found.update(np.ascontiguousarray(parent.faces).tobytes())
    return found.hexdigest()[:16]


def write_shapes(shapes: Mapping[str, GrainShape], style: SurfaceStyle) -> str:
    """Return the text of a file of shapes, by name."""
    records = [
        {
            "name": name,
            "parent": shape.parent,
            "form": shape.form.tolist(),
            "diameter": shape.diameter,
            "unit": style.unit,
            "other": shape.other,
            "share": shape.share,
            "gains": {band: getattr(shape.gains, band) for band in ("coarse", "edges", "fine")},
            "warp": shape.warp.tolist(),
            "turn": shape.turn.tolist(),
            "detail_stretch": shape.detail_stretch,
        }
        for name, shape in shapes.items()
    ]
    head = {"format": _FORMAT, "version": _VERSION, "style": surface_style_digest(style), "shapes": records}
    return json.dumps(head, indent=1) + "\n"


def read_shapes(path: str | Path, style: SurfaceStyle) -> dict[str, GrainShape]:
    """Return the shapes of a file, by name.

    Raises
    ------
    CloningError
        If it cannot be read, is of another kind, or was made with another style.
    """
    path = Path(path)
    try:
        found = read_json(path)
    except (OSError, PlainFileError) as error:
        raise CloningError(f"{path} cannot be read: {error}") from error
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise CloningError(f"{path} holds no shapes: give a {SHAPES_FILE} that 'mbstudio latent' wrote.")
    if found.get("version") != _VERSION:
        raise CloningError(f"{path} is of version {found.get('version')}: this mbstudio reads {_VERSION}.")
    if found.get("style") != surface_style_digest(style):
        raise CloningError(f"The shapes in {path} were made with another style: use that style.")
    try:
        shapes = {str(record["name"]): _shape_of(record, style) for record in found["shapes"]}
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise CloningError(f"{path} is damaged: make these grains again. ({error!r})") from error
    return shapes


def _shape_of(record: Mapping[str, Any], style: SurfaceStyle) -> GrainShape:
    parent, other = int(record["parent"]), record["other"]
    rows = [parent] if other is None else [parent, int(other)]
    if any(not 0 <= row < len(style.parents) for row in rows):
        raise ValueError(f"the style has no parents {rows}")
    form, turn, warp = (np.array(record[name], dtype=np.float64) for name in ("form", "turn", "warp"))
    gains = {band: float(record["gains"][band]) for band in ("coarse", "edges", "fine")}
    diameter, share = float(record["diameter"]), float(record["share"])
    if form.shape != (3,) or turn.shape != (3, 3) or warp.shape != (len(style.modes),):
        raise ValueError(f"shapes {form.shape}, {turn.shape}, {warp.shape} of form, turn and warp")
    if not (np.isfinite(form).all() and np.isfinite(warp).all()):
        raise ValueError("form or warp are no finite numbers")
    if not np.abs(turn @ turn.T - np.eye(3)).max() < _SQUARE:
        raise ValueError("the turn is none")
    taken = float(record["detail_stretch"])
    if not (
        diameter > 0 and 0 <= share <= 1 and 0 <= taken <= 1 and all(gain >= 0 for gain in gains.values())
    ):
        raise ValueError("a size, share or gain that no grain has")
    partner = None if other is None else int(other)
    return GrainShape(parent, form, diameter, partner, share, Gains(**gains), warp, turn, taken)
