"""Station Scan: open a stack, state its voxel size.

`work` opens, `dialog` asks for what a file does not say. Begin at `station`.
"""
