"""Plotters that are closed after each test."""

from __future__ import annotations

from dataclasses import replace

import pytest
import pyvista as pv


@pytest.fixture
def plotter():
    plotter = pv.Plotter(off_screen=True, window_size=(400, 300))
    yield plotter
    plotter.close()


def flatten(scene, name):
    """Show one layer alone, flat white on black: its silhouette, for measuring pictures."""
    scene.set_theme(replace(scene.theme, top="#000000", bottom="#000000"))
    scene.show_layers({name})
    scene._bar.set_visible(False)
    scene.plotter.renderer.axes_actor.SetVisibility(False)
    for actor in scene.layers.outline.actors:
        actor.SetVisibility(False)
    for actor in scene.layers[name].actors:
        actor.prop.color = "#ffffff"
        actor.prop.opacity = 1.0
        actor.prop.lighting = False
