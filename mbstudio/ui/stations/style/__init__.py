"""Station Style: learn what the avatars have in common, make clones.

`work` trains, `clone_work` generates, the pages of the panel hold their settings. Begin at `station`.
"""
