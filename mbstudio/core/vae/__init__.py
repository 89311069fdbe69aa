"""MetaballVAE: serializer, style-learner and generator of new grains."""

from mbstudio.core.vae.assignment import assign_to_template
from mbstudio.core.vae.generation import Generation
from mbstudio.core.vae.generator import generate
from mbstudio.core.vae.learning_on import learn_on
from mbstudio.core.vae.quality import Quality, assess
from mbstudio.core.vae.serialization import FLIPS, Serialization, Template
from mbstudio.core.vae.serialization_file import load_serialization, save_serialization
from mbstudio.core.vae.serializer import serialize
from mbstudio.core.vae.style_learner import StyleLearner, load_style_learner
from mbstudio.core.vae.training import StyleTraining, learn
from mbstudio.core.vae.training_step import TrainingStep

__all__ = [
    "FLIPS",
    "Generation",
    "Quality",
    "Serialization",
    "StyleLearner",
    "StyleTraining",
    "Template",
    "TrainingStep",
    "assess",
    "assign_to_template",
    "generate",
    "learn",
    "learn_on",
    "load_serialization",
    "load_style_learner",
    "save_serialization",
    "serialize",
]
