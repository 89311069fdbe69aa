"""MetaballVAE: serializer, style-learner and generator of new grains."""

from mbstudio.core.vae.serialization import FLIPS, Serialization, Template
from mbstudio.core.vae.style_learner import StyleLearner, load_style_learner
from mbstudio.core.vae.training import StyleTraining, TrainingStep, learn

__all__ = [
    "FLIPS",
    "Serialization",
    "StyleLearner",
    "StyleTraining",
    "Template",
    "TrainingStep",
    "learn",
    "load_style_learner",
]
