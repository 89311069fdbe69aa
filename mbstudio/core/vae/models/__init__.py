"""Style-learners: what a population of serialized bodies has in common, as a latent space.

A preset (`aligned`, `paper`, `pca`) is a model, its options and its trainer; a training is a step object.
Begin at :class:`~mbstudio.core.vae.models.style_learner.StyleLearner`.
"""
