"""MetaballVAE: serializer, style-learner and generator of new grains."""

from mbstudio.core.vae.serialization import FLIPS, Serialization, Template

__all__ = ["FLIPS", "Serialization", "Template"]
