"""The serializer: every body as the same control points in the same order, in its principal frame.

The template is found once for a population, each body is then fitted from it. Begin at
:func:`~mbstudio.core.vae.serialize.serializer.serialize`.
"""
