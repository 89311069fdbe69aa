"""AmiraMesh (`.am`) of Amira and Avizo: `volume` reads it, `header` and `encodings` are its parts."""
