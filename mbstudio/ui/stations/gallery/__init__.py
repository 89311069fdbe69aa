"""The gallery below the view: grains, avatars and clones as small pictures.

It belongs to no single station. Begin at `link`, which fills it.
"""
