"""The folder of a packing: tables, summary and surfaces that another program reads."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import pyvista

from mbstudio.core.errors import PackingError
from mbstudio.core.packing.packing_files import NAMES, write_packing, write_surfaces


def test_a_packing_is_written_whole(settled, tmp_path):
    files = write_packing(settled, tmp_path / "packing", inset=0.4)
    assert [path.name for path in files] == list(NAMES)
    summary = json.loads(files[-1].read_text(encoding="utf-8"))
    assert summary["porosity"] == settled.measures(0.4).porosity
    assert summary["grains"] == 20
    assert len(pd.read_csv(files[1])) == len(settled.contacts)


def test_another_program_reads_the_surfaces(settled, tmp_path):
    path = tmp_path / "grains.vtp"
    write_surfaces(settled, path, cells=16)
    read, mesh = pyvista.read(path), settled.mesh(cells=16)
    assert read.n_cells == len(mesh.faces)
    assert np.asarray(read.points) == pytest.approx(np.asarray(mesh.vertices), abs=1e-5)
    assert set(np.unique(read["grain"])) == set(range(20))
    neighbours = settled.found_contacts.neighbours(20)
    assert (read["coordination"] == neighbours[read["grain"]]).all()


def test_a_packing_without_an_inside_is_not_written(settled, tmp_path):
    with pytest.raises(PackingError, match="no inner part"):
        write_packing(settled, tmp_path / "packing", inset=3.0)
    assert not (tmp_path / "packing").exists()
