"""A folder with a packing: poses, contacts, profiles, surfaces for ParaView, and a summary."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np

from mbstudio.core.packing.packing import INSET, Packing
from mbstudio.core.packing.poses import write_poses
from mbstudio.core.replacement import replacing

POSES, CONTACTS, PROFILE, WALLS = "poses.csv", "contacts.csv", "profile.csv", "walls.csv"
SURFACES, MESH, SUMMARY = "packing.vtp", "packing.ply", "summary.json"
NAMES = (POSES, CONTACTS, PROFILE, WALLS, SURFACES, MESH, SUMMARY)


def write_packing(packing: Packing, folder: Path, *, inset: float = INSET, cells: int = 24) -> list[Path]:
    """Write a packing into a folder, which is made if need be; return the files.

    Parameters
    ----------
    packing : Packing
    folder : Path
    inset : float
        Of the measures, see :meth:`~mbstudio.core.packing.packing.Packing.measures`.
    cells : int
        Along the longest side of each grain's surface.

    Raises
    ------
    PackingError
        If the packing has no inner part.
    """
    summary = packing.summary(inset)
    folder.mkdir(parents=True, exist_ok=True)
    write_poses(folder / POSES, packing.poses, packing.kinds.names)
    packing.contacts.to_csv(folder / CONTACTS, index=False, lineterminator="\r\n")
    packing.profile(inset).to_csv(folder / PROFILE, index=False, lineterminator="\r\n")
    packing.wall_profile(inset).to_csv(folder / WALLS, index=False, lineterminator="\r\n")
    write_surfaces(packing, folder / SURFACES, cells)
    with replacing(folder / MESH) as temporary:
        packing.mesh(cells).export(temporary, file_type="ply")
    with replacing(folder / SUMMARY) as temporary:
        temporary.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return [folder / name for name in NAMES]


def write_surfaces(packing: Packing, path: Path, cells: int = 24) -> None:
    """Write the surfaces of all grains for ParaView (VTP), with number, neighbours and diameter of each."""
    mesh = packing.mesh(cells)
    grains = np.asarray(mesh.face_attributes["grain"])
    faces = np.asarray(mesh.faces, dtype=np.int64)
    neighbours = packing.found_contacts.neighbours(len(packing))
    arrays = {
        "grain": grains.astype(np.int32),
        "coordination": neighbours[grains].astype(np.int32),
        "diameter": packing.diameters[grains].astype(np.float32),
    }
    cell_data = "\n".join(_array(name, values) for name, values in arrays.items())
    text = f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData><Piece NumberOfPoints="{len(mesh.vertices)}" NumberOfPolys="{len(faces)}">
<Points>{_array("points", np.asarray(mesh.vertices, dtype=np.float32), 3)}</Points>
<CellData>
{cell_data}
</CellData>
<Polys>{_array("connectivity", faces.ravel())}
{_array("offsets", 3 * np.arange(1, len(faces) + 1, dtype=np.int64))}</Polys>
</Piece></PolyData>
</VTKFile>
"""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="ascii")


_VTK_NAMES = {"i4": "Int32", "i8": "Int64", "f4": "Float32"}


def _array(name: str, values: np.ndarray, components: int = 1) -> str:
    raw = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<")).tobytes()
    coded = base64.b64encode(np.array([len(raw)], dtype="<u8").tobytes() + raw).decode("ascii")
    kind = _VTK_NAMES[values.dtype.str[1:]]
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="binary">'
        f"{coded}</DataArray>"
    )
