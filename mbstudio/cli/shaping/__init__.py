"""Grains shaped by hand, in a latent space or from the surfaces of a style. Begin at `latent`."""
