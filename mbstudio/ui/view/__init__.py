"""The view in the middle of the window: 3-D scene, slices, tools, pictures.

Begin at `scene_view`, which keeps the scene in step with the workspace; `viewport` is the widget itself.
"""
