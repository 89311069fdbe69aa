"""MetaballVAE: serializer, style-learner and generator of new grains."""

from mbstudio.core.vae.assignment import assign_to_template
from mbstudio.core.vae.serialization import FLIPS, Serialization, Template
from mbstudio.core.vae.serialization_file import load_serialization, save_serialization
from mbstudio.core.vae.serializer import serialize

__all__ = [
    "FLIPS",
    "Serialization",
    "Template",
    "assign_to_template",
    "load_serialization",
    "save_serialization",
    "serialize",
]
