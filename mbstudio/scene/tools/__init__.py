"""What a hand does in a scene: clip by a box, measure a distance, grip a slice.

Tools use layers through the interface of `scene/layers/layer.py`. Begin at `clip_box`.
"""
