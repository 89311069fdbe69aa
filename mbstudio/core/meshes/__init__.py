"""Surface meshes: files of every kind, read into closed bodies.

Begin at `bodies.read_bodies`.
"""
