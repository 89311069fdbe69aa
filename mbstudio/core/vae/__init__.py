"""MetaballVAE: new grains in the style of a population, and single grains shaped by hand.

`serialize` brings bodies onto one template, `models` holds the style-learners and their training,
`generate` makes and judges clones, `shaping` works in the latent space. Begin at
:func:`~mbstudio.core.vae.models.training.learn` and :func:`~mbstudio.core.vae.generate.generator.generate`.
"""
