"""One grain shaped by hand: latent vectors moved, mixed and steered by shape factors.

A recipe records the steps, so that a kept grain can be made anew. Begin at `latent` (arithmetic) and
`meaning` (sliders named after factors).
"""
