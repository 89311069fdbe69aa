"""Metaball-Imaging: sphere clustering, then gradient search, each a step at a time."""
