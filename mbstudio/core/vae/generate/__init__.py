"""The generator: clones drawn from a style-learner, kept valid, balanced to the parents, and judged.

Candidates are drawn in blocks, checked, and chosen to match factors or targets. Begin at
:func:`~mbstudio.core.vae.generate.generator.generate`, for the report at `quality`.
"""
