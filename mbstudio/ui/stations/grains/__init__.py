"""Station Grains: find the grains of a scan, look through them.

`work` segments or loads labels, `table` lists the grains. Begin at `station`.
"""
