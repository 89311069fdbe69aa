"""Shape factors and mass properties of grains, meshes and avatars."""

from mbstudio.core.metrics.mass import MassProperties, mass_properties
from mbstudio.core.metrics.measuring import measure
from mbstudio.core.metrics.shape_factors import CORE_FACTORS, ShapeFactors

__all__ = ["CORE_FACTORS", "MassProperties", "ShapeFactors", "mass_properties", "measure"]
