"""Specimens: how many bodies of which size, where they stand before they settle, how they are poured.

Begin at :func:`~mbstudio.core.dem.specimen.specimen.make_specimen`.
"""
