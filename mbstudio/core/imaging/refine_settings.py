"""Constants of the fast search."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RefineSettings:
    """Constants of the fast search; lengths are in working lengths (RMS radius 1).

    Attributes
    ----------
    steepness_floor, steepness_roof, steepness_roof_of_few : float
        Bounds of g = abs(grad f) / f; a higher floor makes the search more cautious where f is flat. The
        roof is that of few up to 24 control points and rises with their number: few cannot follow steep
        places, and spread better over the body where these count less.
    start_damping : float
        Lambda of the first step.
    tip_weight, interior_weight, depth_weight, volume_weight, area_weight : float
        Weights of the tips (of their squares), of the hinges and of the volume and area rows against the
        surface rows.
    area_slack, area_slack_of_many, most_area_gain : float
        The area row strives for the hull's area less this share (steps of the voxels leave so
        much on smooth surfaces; the second from `many` control points on, unless blocks of voxels
        were averaged), but for no more than this share beyond what the avatar has.
    area_stays : bool
        Keep the area row at work once the area is right, which may not grow too large then either.
    area_noise : float
        Below an RMS of so many voxels the area row is left out: their steps add more to the hull's area.
    curvature_roof : float
        Bound of twice the mean curvature in the area row.
    points_per_control, points_per_many, fewest_points : int
        Surface points in use at a time: max(fewest_points, points_per_control * n); the second per control
        point where there are `many`.
    denser, points_at_end : float, int
        Times as many in the last steps, while the area row is at work; so many where it is left out.
    renew_every, renew_many_every, many, check_every : int
        Steps after which the next subset of points is taken and the volume measured anew, the second from so
        `many` control points on, unless voxels are few or long; and after which progress over all hull points
        decides whether to stop.
    least_gain : float
        Relative gain of the RMS between checks that counts as progress; two without end the search.
    noise, least_gain_in_noise : float
        Below an RMS of `noise` times the grain's fineness one check with less gain than this ends the search.
    """

    steepness_floor: float = 0.7
    steepness_roof: float = 10.0
    steepness_roof_of_few: float = 6.0
    start_damping: float = 0.1
    tip_weight: float = 0.03
    interior_weight: float = 0.5
    depth_weight: float = 0.5
    volume_weight: float = 3.0
    area_weight: float = 1.0
    area_slack: float = 0.004
    area_slack_of_many: float = 0.002
    most_area_gain: float = 0.03
    area_stays: bool = True
    area_noise: float = 0.2
    curvature_roof: float = 30.0
    points_per_control: int = 25
    points_per_many: int = 28
    fewest_points: int = 1500
    denser: float = 2.0
    points_at_end: int = 8000
    renew_every: int = 5
    renew_many_every: int = 3
    many: int = 80
    check_every: int = 10
    least_gain: float = 0.01
    noise: float = 0.35
    least_gain_in_noise: float = 0.015

    def steepness_roof_for(self, n: int) -> float:
        """Return the upper bound of g for n control points."""
        return min(self.steepness_roof, max(self.steepness_roof_of_few, n / 4))
