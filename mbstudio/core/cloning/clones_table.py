"""What clones of surfaces were made of, and how far their metaballs are from them, as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.cloning.surface_generation import SurfaceGeneration

CLONES_TABLE = "clones.csv"
"""Name of its file beside exported clones."""


def clones_table(found: SurfaceGeneration) -> pd.DataFrame:
    """Return what each clone was made of, and how far its metaball is from its surface, in D_n."""
    import pandas as pd

    fitted = [clone.fitted for clone in found.clones]
    table = pd.DataFrame(
        {
            "name": [clone.name for clone in found.clones],
            "parent": [clone.parent for clone in found.clones],
            "diameter": [clone.recipe.diameter for clone in found.clones],
            "avatar_rms": [entry.rms if entry else float("nan") for entry in fitted],
            "avatar_volume_error": [entry.volume_error if entry else float("nan") for entry in fitted],
            "avatar_valid": [bool(entry and entry.valid) for entry in fitted],
        }
    )
    if any(clone.shaped for clone in found.clones):
        table["shaped"] = [clone.shaped for clone in found.clones]
    return table
