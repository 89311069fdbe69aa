"""Porosity of the segmented specimen along its axes and in growing boxes; where which sizes lie.

Begin at :func:`~mbstudio.core.porosity.profiles.porosity_profiles`.
"""

from mbstudio.core.porosity.arrangement import SizeProfile, size_profiles
from mbstudio.core.porosity.profiles import PorosityProfile, Specimen, porosity_profiles
from mbstudio.core.porosity.representative import RepresentativeVolume, representative_volume

__all__ = [
    "PorosityProfile", "RepresentativeVolume", "SizeProfile", "Specimen", "porosity_profiles",
    "representative_volume", "size_profiles",
]  # fmt: skip
