"""Grains shaped by hand on the command line: in a latent space, or from the surfaces of a style."""
