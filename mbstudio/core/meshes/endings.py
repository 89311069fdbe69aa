"""Endings of the mesh files that are read: apart, so that asking for them imports nothing heavy."""

MESH_ENDINGS = (".stl", ".ply", ".obj", ".off", ".3mf", ".glb", ".gltf")
