"""What can be shown in a scene: slices, volume, grains, avatars, control points, tray, deviation.

One module a layer. Begin at `layer`, what every layer can do; `registry` names them all, one line each.
"""
