"""Pictures and animations of scenes, drawn off screen: figures of grains, thumbnails, morphs.

Begin at `offscreen`, the plotter that all of them draw on.
"""
