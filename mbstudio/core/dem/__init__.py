"""Export of avatars to DEM engines, one module a target behind one registry."""

from mbstudio.core.dem.clump import Clump, sphere_clump
from mbstudio.core.dem.exporting import ExportReport, export, validate
from mbstudio.core.dem.metaball import read_metaball
from mbstudio.core.dem.target import Option, Target, targets

__all__ = [
    "Clump",
    "ExportReport",
    "Option",
    "Target",
    "export",
    "read_metaball",
    "sphere_clump",
    "targets",
    "validate",
]
