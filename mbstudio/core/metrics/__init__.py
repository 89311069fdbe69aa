"""Shape factors of grains, meshes and avatars."""
