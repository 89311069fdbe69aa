"""The commands about packings: `pack` makes them, `packing` reads what engines have made. Begin at `pack`."""
