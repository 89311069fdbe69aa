"""The in-place twin: all avatars of a scan fitted together to its grey values, and their contacts.

`feet` and `optics` say what grey value a voxel near a surface has, `levels` what pores and grains look like,
`body` moves one avatar and `sweeps` all of them; `contacts` finds where they touch. Begin at
:func:`~mbstudio.core.twin.twinning.twin`.
"""
