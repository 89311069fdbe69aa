"""The twin at station Fit: all avatars fitted together to grey values, their contacts and fabric.

Begin at :class:`~mbstudio.ui.stations.fit.twin.work.TwinWork`.
"""
