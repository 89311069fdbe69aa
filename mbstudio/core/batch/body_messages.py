"""Grains, avatars and meshes as messages between processes."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.batch.messages import Arrays, Head, Message
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import trimesh


def grain_message(grain: Grain) -> Message:
    """Return head and arrays of a grain; the mask travels as packed bits."""
    mask = np.asarray(grain.mask).astype(bool)
    head = {
        "shape": mask.shape,
        "voxel_size": asdict(grain.voxel_size),
        "origin": grain.origin,
        "label": grain.label,
        "touches_border": grain.touches_border,
        "name": grain.name,
        "filled_voxels": grain.filled_voxels,
        "segmented": grain.segmented,
    }
    return head, {"bits": np.packbits(mask)}


def grain_from(head: Head, arrays: Arrays) -> Grain:
    """Return the grain of a message."""
    shape = tuple(head["shape"])
    mask = np.unpackbits(arrays["bits"], count=int(np.prod(shape))).reshape(shape).astype(bool)
    return Grain(
        mask,
        VoxelSize(**head["voxel_size"]),
        tuple(head["origin"]),
        head["label"],
        head["touches_border"],
        head["name"],
        head["filled_voxels"],
        head["segmented"],
    )


def body_message(body: Grain | Avatar | trimesh.Trimesh) -> Message:
    """Return head and arrays of any body that can be measured."""
    if isinstance(body, Grain):
        head, arrays = grain_message(body)
        return {"body": "grain", **head}, arrays
    if isinstance(body, Avatar):
        head = {"body": "avatar", "unit": body.unit, "label": body.label, "name": body.name}
        return head, {"centers": body.centers, "weights": body.weights}
    return {"body": "mesh", "unit": body.units}, {
        "vertices": np.asarray(body.vertices, dtype=np.float64),
        "faces": np.asarray(body.faces, dtype=np.int64),
    }


def body_from(head: Head, arrays: Arrays) -> Grain | Avatar | trimesh.Trimesh:
    """Return the body of a message."""
    if head["body"] == "grain":
        return grain_from(head, arrays)
    if head["body"] == "avatar":
        return Avatar(arrays["centers"], arrays["weights"], head["unit"], head["label"], head["name"])
    import trimesh

    # As it was sent: what is wrong with it is for the measurement to find.
    mesh = trimesh.Trimesh(arrays["vertices"], arrays["faces"], process=False)
    if head["unit"] is not None:  # trimesh would take None for a name
        mesh.units = head["unit"]
    return mesh
