"""What can be shown in a scene: slices, volume, grains, avatars, control points, trays, deviation.

One module a layer. Begin at `layers`, their names and order.
"""
