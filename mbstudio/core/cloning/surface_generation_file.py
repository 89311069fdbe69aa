"""Clones from surfaces as entries and numbers, for any file that keeps some."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbstudio.core.cloning.clone_maker import CloneOptions, CloneRecipe, Surface
from mbstudio.core.cloning.surface_generation import SurfaceClone, SurfaceGeneration
from mbstudio.core.cloning.surface_style_file import (
    avatar_tensors,
    build_avatars,
    require_closed,
    split_rows,
)
from mbstudio.core.populations.population import Population
from mbstudio.core.tensor_folder import Tensors
from mbstudio.core.units import parse_unit
from mbstudio.core.vae.generate.conditions import Reached


def generation_entries(clones: SurfaceGeneration) -> dict[str, Any]:
    """Return what JSON can hold of clones."""
    return {
        "names": list(clones.names), "parents": [clone.parent for clone in clones.clones],
        "shaped": [clone.shaped for clone in clones.clones], "unit": clones.unit,
        "candidates": clones.candidates, "how": clones.how, "seed": clones.seed,
        "options": dict(vars(clones.options)), "reached": [figure.as_record() for figure in clones.reached],
    }  # fmt: skip


def generation_tensors(clones: SurfaceGeneration) -> Tensors:
    """Return the numbers of clones: surfaces of record and recipes end to end, and the metaballs' numbers."""
    every = clones.clones
    recipes = [clone.recipe for clone in every]
    tensors: Tensors = {
        "vertices": np.concatenate([clone.surface.vertices for clone in every]),
        "faces": np.concatenate([clone.surface.faces for clone in every]).astype(np.int32),
        "counts": np.array([[len(c.surface.vertices), len(c.surface.faces)] for c in every], dtype=np.int64),
        "rows": np.array([recipe.parent for recipe in recipes], dtype=np.int64),
        "forms": np.stack([recipe.form for recipe in recipes]),
        "turns": np.stack([recipe.turn for recipe in recipes]),
        "warps": np.stack([recipe.warp for recipe in recipes]),
        "diameters": np.array([recipe.diameter for recipe in recipes]),
        "detail_stretches": np.array([recipe.detail_stretch for recipe in recipes]),
    }
    fitted = [clone.fitted for clone in every if clone.fitted is not None]
    if len(fitted) == len(every):
        tensors |= avatar_tensors(fitted)
    return tensors


def build_generation(entries: Mapping[str, Any], tensors: Tensors, factors: Population) -> SurfaceGeneration:
    """Return the clones of entries and finite numbers as a file holds them.

    Raises
    ------
    MbstudioError, AttributeError, LookupError, OverflowError, TypeError, ValueError
        If they belong to none.
    """
    names, parents, shaped = ([str(text) for text in entries[key]] for key in ("names", "parents", "shaped"))
    unit, counts, count = parse_unit(str(entries["unit"])), tensors["counts"], len(names)
    shapes = {
        "counts": (count, 2), "rows": (count,), "forms": (count, 3), "turns": (count, 3, 3),
        "diameters": (count,),
    }  # fmt: skip
    for name, wanted in shapes.items():
        if tensors[name].shape != wanted:
            raise ValueError(f"'{name}' of shape {tensors[name].shape}")
    warps = tensors["warps"]
    # Earlier clones were stretched whole.
    taken = tensors.get("detail_stretches", np.ones(count))
    if taken.shape != (count,) or not ((taken >= 0) & (taken <= 1)).all():
        raise ValueError("shares of stretch that no clone has")
    if count < 1 or counts.min() < 4 or warps.ndim != 2 or len(warps) != count or len(factors) != count:
        raise ValueError("clones that do not belong together")
    if not (len(parents) == len(shaped) == count and (tensors["diameters"] > 0).all()):
        raise ValueError("clones that do not belong together")
    vertices, faces = (
        split_rows(tensors, "vertices", counts[:, 0]),
        split_rows(tensors, "faces", counts[:, 1]),
    )
    fitted = build_avatars(names, unit, tensors) or (None,) * count
    clones = []
    for row, name in enumerate(names):
        surface = Surface(np.ascontiguousarray(vertices[row]), faces[row].astype(np.int64))
        require_closed(*surface, name)
        recipe = CloneRecipe(
            int(tensors["rows"][row]), tensors["forms"][row], tensors["turns"][row], warps[row],
            float(tensors["diameters"][row]), float(taken[row]),
        )  # fmt: skip
        clones.append(SurfaceClone(name, surface, recipe, parents[row], unit, fitted[row], shaped[row]))
    return SurfaceGeneration(
        tuple(clones), factors, int(entries["candidates"]), str(entries["how"]),
        tuple(Reached.from_record(figure) for figure in entries["reached"]), int(entries["seed"]),
        CloneOptions.make({"detail_stretch": 1.0, **entries["options"]}),
    )  # fmt: skip
