"""Station Style: learn what the avatars have in common, make clones."""
