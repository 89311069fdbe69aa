"""Export of avatars to DEM engines.

`formats` holds a module or folder for each engine, `shapes` and `specimen` what they share. Begin at
:func:`~mbstudio.core.dem.exporting.export` and `target`.
"""

from mbstudio.core.dem.exporting import ExportReport, export, validate
from mbstudio.core.dem.formats.metaball import read_metaball
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.shapes.clump import Clump, sphere_clump
from mbstudio.core.dem.shapes.clump_goal import ClumpGoal, FoundClump, clump_for_target
from mbstudio.core.dem.specimen.specimen import SpecimenPlan, make_specimen, target_curve
from mbstudio.core.dem.target import Target, targets
from mbstudio.core.options import Option

# The earlier names: a target is the engine that is exported to.
ClumpTarget, TargetClump = ClumpGoal, FoundClump

__all__ = [
    "Clump",
    "ClumpGoal",
    "ClumpTarget",
    "ExportReport",
    "FoundClump",
    "Option",
    "Specimen",
    "SpecimenPlan",
    "Target",
    "TargetClump",
    "clump_for_target",
    "export",
    "make_specimen",
    "read_metaball",
    "sphere_clump",
    "target_curve",
    "targets",
    "validate",
]
