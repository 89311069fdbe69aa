"""Station Latent: one grain shaped by hand in the latent space."""
