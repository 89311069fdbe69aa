"""Avatars: the metaball function, its surface, mass properties and validity."""

from mbstudio.core.metaball.avatar import Avatar

__all__ = ["Avatar"]
