"""Where a search starts: spheres packed into the grain, thinned and made control points.

Begin at `sphere_clustering`.
"""
