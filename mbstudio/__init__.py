"""MetaBall Studio: CT scans of grains to metaball avatars for DEM simulations.

The names below are the public interface; each is imported on first use, so that
``import mbstudio`` costs nothing and never touches Qt.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mbstudio.core.version import __version__

if TYPE_CHECKING:
    from mbstudio.core.cloning.parent_avatars import fit_parents
    from mbstudio.core.cloning.surface_generation import generate_surfaces
    from mbstudio.core.cloning.surface_studio import SurfaceStudio
    from mbstudio.core.cloning.surface_style import SurfaceStyle, learn_surfaces
    from mbstudio.core.cloning.surface_style_file import load_surface_style, save_surface_style
    from mbstudio.core.dem import export
    from mbstudio.core.errors import MbstudioError
    from mbstudio.core.grains import Grain, GrainSet, load_labels, segment
    from mbstudio.core.grains.classifying import Stroke, VoxelClassifier, load_classifier
    from mbstudio.core.imaging import FitResult, fit, start_fit
    from mbstudio.core.metaball import Avatar
    from mbstudio.core.metrics import ShapeFactors, measure
    from mbstudio.core.packing import Packing, pack
    from mbstudio.core.packing.comparing import compare_packings
    from mbstudio.core.packing.reading import read_packing
    from mbstudio.core.project import Project
    from mbstudio.core.scan import Scan, open_scan
    from mbstudio.core.twin.result import TwinResult
    from mbstudio.core.twin.twinning import start_twin, twin
    from mbstudio.core.vae.generate.generator import generate
    from mbstudio.core.vae.models.style_learner import StyleLearner, load_style_learner
    from mbstudio.core.vae.models.training import learn
    from mbstudio.core.vae.serialize.serializer import serialize

_HOME_OF = {
    "Avatar": "metaball",
    "FitResult": "imaging",
    "Grain": "grains",
    "GrainSet": "grains",
    "MbstudioError": "errors",
    "Packing": "packing",
    "Project": "project",
    "Scan": "scan",
    "ShapeFactors": "metrics",
    "Stroke": "grains.classifying",
    "StyleLearner": "vae.models.style_learner",
    "SurfaceStudio": "cloning.surface_studio",
    "SurfaceStyle": "cloning.surface_style",
    "TwinResult": "twin.result",
    "VoxelClassifier": "grains.classifying",
    "compare_packings": "packing.comparing",
    "export": "dem",
    "fit": "imaging",
    "fit_parents": "cloning.parent_avatars",
    "generate": "vae.generate.generator",
    "generate_surfaces": "cloning.surface_generation",
    "learn": "vae.models.training",
    "learn_surfaces": "cloning.surface_style",
    "load_classifier": "grains.classifying",
    "load_labels": "grains",
    "load_style_learner": "vae.models.style_learner",
    "load_surface_style": "cloning.surface_style_file",
    "measure": "metrics",
    "open_scan": "scan",
    "pack": "packing",
    "read_packing": "packing.reading",
    "save_surface_style": "cloning.surface_style_file",
    "segment": "grains",
    "serialize": "vae.serialize.serializer",
    "start_fit": "imaging",
    "start_twin": "twin.twinning",
    "twin": "twin.twinning",
}

__all__ = [
    "Avatar",
    "FitResult",
    "Grain",
    "GrainSet",
    "MbstudioError",
    "Packing",
    "Project",
    "Scan",
    "ShapeFactors",
    "Stroke",
    "StyleLearner",
    "SurfaceStudio",
    "SurfaceStyle",
    "TwinResult",
    "VoxelClassifier",
    "__version__",
    "compare_packings",
    "export",
    "fit",
    "fit_parents",
    "generate",
    "generate_surfaces",
    "learn",
    "learn_surfaces",
    "load_classifier",
    "load_labels",
    "load_style_learner",
    "load_surface_style",
    "measure",
    "open_scan",
    "pack",
    "read_packing",
    "save_surface_style",
    "segment",
    "serialize",
    "start_fit",
    "start_twin",
    "twin",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'mbstudio' has no attribute {name!r}")
    value = getattr(import_module(f"mbstudio.core.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
