"""A metaball fitted to a surface, and how far it is from it."""

from __future__ import annotations

from dataclasses import dataclass

from mbstudio.core.metaball.avatar import Avatar


@dataclass(frozen=True, eq=False)
class SurfaceAvatar:
    """A metaball fitted to a surface.

    Attributes
    ----------
    avatar : Avatar
        In the frame and unit of the surface.
    rms : float
        Root mean square distance of the surfaces, in D_n.
    volume_error : float
        Of the avatar against the surface, as a share.
    valid : bool
        One piece, no void, no control point outside.
    """

    avatar: Avatar
    rms: float
    volume_error: float
    valid: bool
