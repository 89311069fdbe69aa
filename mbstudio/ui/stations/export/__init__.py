"""Station Export: files for DEM engines, with preview and specimen.

`work` writes, `preview_work` makes the shape that is shown before. Begin at `station`.
"""
