"""Plotters that are closed after each test."""

from __future__ import annotations

import pytest
import pyvista as pv


@pytest.fixture
def plotter():
    plotter = pv.Plotter(off_screen=True, window_size=(400, 300))
    yield plotter
    plotter.close()
