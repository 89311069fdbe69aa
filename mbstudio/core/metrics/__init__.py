"""Shape factors and mass properties of grains, meshes and avatars.

`factor_table` describes every factor once. Begin at :func:`~mbstudio.core.metrics.measuring.measure`.
"""

from mbstudio.core.metrics.detail import measure_detail
from mbstudio.core.metrics.factor_table import FACTORS, Factor
from mbstudio.core.metrics.mass import MassProperties, mass_properties
from mbstudio.core.metrics.measuring import bounding_box, measure
from mbstudio.core.metrics.shape_factors import CORE_FACTORS, DETAILED_FACTORS, DetailedFactors, ShapeFactors
from mbstudio.core.metrics.uncertainty import FactorIntervals, factor_intervals

__all__ = [
    "CORE_FACTORS", "DETAILED_FACTORS", "FACTORS", "DetailedFactors", "Factor", "FactorIntervals",
    "MassProperties", "ShapeFactors", "bounding_box", "factor_intervals", "mass_properties", "measure",
    "measure_detail",
]  # fmt: skip
