"""Station Latent: one grain shaped by hand in the latent space.

`work` carries out what the sliders ask for, `history` is undo there. Begin at `station`.
"""
