"""AmiraMesh (`.am`) of Amira and Avizo.

Begin at `volume`, which reads it; `header` and `encodings` are its parts.
"""
