"""Avatars whose control points stand in another order, brought to that of a template."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import SerializationError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.serialize.frame import principal_frame
from mbstudio.core.vae.serialize.serialization import FLIPS, Serialization, Template

# What a control point may stray from its place at most, on average (root mean square, in D_n).
MOST_STRAY = 0.12
_WEIGHT_TO_PLACE = 0.1  # D_n that count as much as a change of 1 in ln k
_ROTATIONS = np.flatnonzero(FLIPS.prod(axis=1) > 0)


def matched_order(
    centers: Float[np.ndarray, "n 3"], log_weights: Float[np.ndarray, " n"], template: Template
) -> tuple[Int[np.ndarray, " n"], float]:
    """Return which control point takes each place of the template, and the root mean square stray in D_n.

    The assignment of least total squared distance, ln k counting as a fourth coordinate (the
    Hungarian method).
    """
    from scipy.optimize import linear_sum_assignment

    strays = ((template.centers[:, None] - centers[None]) ** 2).sum(axis=2)
    weights = _WEIGHT_TO_PLACE * (template.log_weights[:, None] - log_weights[None])
    _, order = linear_sum_assignment(strays + weights**2)
    return order, float(np.sqrt(strays[np.arange(template.n), order].mean()))


def assign_to_template(avatar: Avatar, template: Template) -> Serialization:
    """Return an avatar in the common frame, its control points in the order of the template.

    The avatar's surface stays exactly as it is. Of the four ways to lay its principal axes (the
    turns by half about each), the one is taken in which its control points lie nearest to the
    template.

    Parameters
    ----------
    avatar : Avatar
        Of as many control points as the template, fitted from it (in whatever order and frame).
    template : Template

    Returns
    -------
    Serialization
        Of this one avatar; its rms is NaN, as there is no grain to compare with.

    Raises
    ------
    SerializationError
        If the numbers of control points differ, or the avatar's points lie so far from the template's
        that they cannot mean the same: then serialize its surface anew with `serialize`.
    """
    if avatar.n != template.n:
        raise SerializationError(
            f"Avatar '{avatar.name}' has {avatar.n} control points and the template {template.n}: "
            "fit its surface anew with serialize(), which takes avatars of any n."
        )
    frame = principal_frame(avatar, name=f"Avatar '{avatar.name}'")
    places = frame.shape_points(avatar.centers)
    log_weights = np.log(avatar.weights / frame.diameter**2)
    found = [(flip, *matched_order(places * FLIPS[flip], log_weights, template)) for flip in _ROTATIONS]
    flip, order, stray = min(found, key=lambda one: one[2])
    if stray > MOST_STRAY:
        raise SerializationError(
            f"Avatar '{avatar.name}' was not fitted from this template: its control points lie "
            f"{stray:.2f} D_n from their places on average (at most {MOST_STRAY:g}). Fit its surface anew "
            "with serialize()."
        )
    return Serialization(
        template,
        (places * FLIPS[flip])[order][None],
        log_weights[order][None],
        np.array([frame.diameter]),
        avatar.unit,
        (avatar.name,),
        np.array([np.nan]),
        np.array([topology(avatar.control).is_sound]),
    )
