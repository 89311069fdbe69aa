"""Surface meshes: files of every kind, read into closed bodies by `bodies.read_bodies`."""
