"""Contacts as files: a table of all pairs (CSV), or the network of the contacts (VTU, GraphML)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float64

from mbstudio.core.errors import ExportError
from mbstudio.core.replacement import replacing
from mbstudio.core.twin.fabric import LEAST_PROBABILITY
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.twin.network_files import ENDINGS as NETWORK_ENDINGS
from mbstudio.core.twin.network_files import write_network

ENDINGS = (".csv", *NETWORK_ENDINGS)
_LENGTHS = ("x", "y", "z", "gap", "gap_deviation", "branch_x", "branch_y", "branch_z")


def write_contact_table(path: str | Path, contacts: pd.DataFrame, unit: str) -> Path:
    """Write all pairs as CSV, lengths with their unit in the heading.

    Parameters
    ----------
    path : str or Path
    contacts : pandas.DataFrame
        As a twin has it.
    unit : str
    """
    path = Path(path)
    headings = {name: f"{name} [{unit}]" for name in _LENGTHS} | {"area": f"area [{unit}^2]"}
    with replacing(path) as part:
        contacts.rename(columns=headings).to_csv(part, index=False)
    return path


def write_contact_network(
    path: str | Path, contacts: pd.DataFrame, middles: Mapping[int, Float64[np.ndarray, "3"]], unit: str
) -> Path:
    """Write the pairs that are contacts most probably as a network, as :func:`write_network`."""
    return write_network(path, contacts[contacts["probability"] >= LEAST_PROBABILITY], middles, unit)


def write_contacts(path: str | Path, twin: KeptTwin) -> Path:
    """Write the contacts of a twin: what, is told by the ending.

    Raises
    ------
    ExportError
        If the ending is another.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ExportError(
            f"{path} is no file of contacts: name it {', '.join('*' + end for end in ENDINGS)}."
        )
    if path.suffix.lower() == ".csv":
        return write_contact_table(path, twin.contacts, twin.unit)
    return write_contact_network(path, twin.contacts, twin.middles, twin.unit)
