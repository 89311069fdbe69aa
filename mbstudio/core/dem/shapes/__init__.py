"""Bodies as engines know them: sphere clumps, remeshed surfaces, level sets, point masses.

Formats share these, whatever files they write. Begin at :func:`~mbstudio.core.dem.shapes.clump.sphere_clump`.
"""
