"""The gallery below the view: parents, clones and kept grains as small pictures."""
