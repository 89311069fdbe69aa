"""An honest judge of clones: whether one can tell them from true grains by what no generator selects on.

`features` measures one closed surface at stated scales, whatever its triangles; `judging` compares many.
Begin at :func:`~mbstudio.core.judging.features.body_features` and
:func:`~mbstudio.core.judging.judging.judge`.
"""
