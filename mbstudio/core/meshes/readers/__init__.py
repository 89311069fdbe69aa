"""One reader for each mesh format: bytes in, triangles out; none opens a file.

Begin at `stl`.
"""
