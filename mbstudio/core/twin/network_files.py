"""The contact network as files: GraphML for graphs, VTU for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import networkx
import numpy as np
import pandas as pd
from jaxtyping import Float64

from mbstudio.core.errors import ExportError
from mbstudio.core.replacement import replacing

ENDINGS = (".graphml", ".vtu")
_NUMBERS = ("gap", "gap_deviation", "probability", "area", "nx", "ny", "nz")


def write_network(
    path: str | Path, contacts: pd.DataFrame, middles: Mapping[int, Float64[np.ndarray, "3"]], unit: str
) -> Path:
    """Write grains as nodes and contacts as lines between their middles.

    Parameters
    ----------
    path : str or Path
        Ends in ``.graphml`` or ``.vtu``.
    contacts : pandas.DataFrame
        As a twin has it.
    middles : mapping of int to float array, shape (3,)
        Of all grains, by label, in `unit`.
    unit : str

    Raises
    ------
    ExportError
        If the ending is another.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ExportError(f"{path} is no file of a network: name it *.graphml or *.vtu.")
    write = _write_graphml if path.suffix.lower() == ".graphml" else _write_vtu
    with replacing(path) as part:
        write(part, contacts, middles, unit)
    return path


def _write_graphml(path: Path, contacts: pd.DataFrame, middles: Mapping[int, np.ndarray], unit: str) -> None:
    graph = networkx.Graph(unit=unit)
    for label, (x, y, z) in middles.items():
        graph.add_node(int(label), x=float(x), y=float(y), z=float(z))
    for row in contacts.to_dict("records"):
        known = {name: float(row[name]) for name in _NUMBERS if np.isfinite(row[name])}
        graph.add_edge(int(row["a"]), int(row["b"]), kind=str(row["kind"]), **known)
    networkx.write_graphml(graph, path)


def _array(name: str, values: np.ndarray, kind: str, components: int = 1) -> str:
    told = " ".join(f"{value:.9g}" for value in np.asarray(values).ravel().tolist())
    return (
        f"<DataArray type={quoteattr(kind)} Name={quoteattr(name)} "
        f'NumberOfComponents="{components}" format="ascii">{told}</DataArray>\n'
    )


def _write_vtu(path: Path, contacts: pd.DataFrame, middles: Mapping[int, np.ndarray], unit: str) -> None:
    place = {label: k for k, label in enumerate(middles)}
    lines = np.array([(place[a], place[b]) for a, b in zip(contacts["a"], contacts["b"], strict=True)], int)
    lines = lines.reshape(-1, 2)
    points = np.array(list(middles.values()), dtype=float).reshape(-1, 3)
    count = np.bincount(lines.ravel(), minlength=len(points))
    # Numbers as text cannot be missing: what is not known of all contacts is left out.
    known = [name for name in _NUMBERS[:4] if np.isfinite(contacts[name].to_numpy(float)).all()]
    cells = "".join(_array(name, contacts[name].to_numpy(float), "Float64") for name in known)
    normals = _array("normal", contacts[["nx", "ny", "nz"]].to_numpy(float), "Float64", 3)
    path.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">\n'
        f"<!-- lengths in {unit} -->\n"
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(lines)}">\n'
        f"<Points>{_array('Points', points, 'Float64', 3)}</Points>\n"
        f"<Cells>{_array('connectivity', lines, 'Int64')}"
        f"{_array('offsets', 2 * np.arange(1, len(lines) + 1), 'Int64')}"
        f"{_array('types', np.full(len(lines), 3), 'UInt8')}</Cells>\n"
        f"<PointData>{_array('label', np.array(list(middles)), 'Int64')}"
        f"{_array('coordination', count, 'Int64')}</PointData>\n"
        f"<CellData>{cells}{normals}</CellData>\n"
        "</Piece></UnstructuredGrid></VTKFile>\n",
        encoding="utf-8",
    )
