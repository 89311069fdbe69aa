"""Extremely randomised trees in compiled code: permutations need a thousand small forests."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float64

from mbstudio.core.compiled import compiled

TREES = 100
_SMALLEST_LEAF = 2


def score_by_forest(
    train: Float[np.ndarray, "n f"],
    kinds: Bool[np.ndarray, " n"],
    held_out: Float[np.ndarray, "m f"],
    seed: int,
) -> Float64[np.ndarray, " m"]:
    """Return the mean over trees of the share of the first kind in the leaf that a body falls into.

    Both kinds weigh the same. At each node the root of the number of features are tried, each at one place
    drawn between its least and its largest value; the split that leaves the least Gini impurity is kept.

    References
    ----------
    Geurts, Ernst & Wehenkel (2006), Extremely randomized trees, Machine Learning 63, 3-42.
    """
    share = kinds.mean()
    weights = np.where(kinds, 0.5 / share, 0.5 / (1.0 - share))
    tried = max(1, round(np.sqrt(train.shape[1])))
    scores = np.zeros(len(held_out))
    _grow_and_ask(
        np.ascontiguousarray(train, dtype=np.float64), kinds.astype(np.float64), weights,
        np.ascontiguousarray(held_out, dtype=np.float64), tried, TREES, _SMALLEST_LEAF, seed, scores,
    )  # fmt: skip
    return scores


@compiled()
def _grow_and_ask(
    train: np.ndarray, kinds: np.ndarray, weights: np.ndarray, held_out: np.ndarray, tried: int, trees: int,
    smallest: int, seed: int, scores: np.ndarray,
) -> None:  # fmt: skip
    np.random.seed(seed)  # noqa: NPY002  the compiled code's own generator
    count, width = train.shape
    most = 2 * count + 1
    feature = np.empty(most, np.int64)
    threshold, value = np.empty(most), np.empty(most)
    child = np.empty((most, 2), np.int64)
    span = np.empty((most, 2), np.int64)
    features = np.arange(width)
    for _ in range(trees):
        rows = np.arange(count)
        nodes = 1
        span[0, 0], span[0, 1] = 0, count
        node = 0
        while node < nodes:
            start, end = span[node, 0], span[node, 1]
            feature[node], threshold[node] = _draw_split(
                train, kinds, weights, rows[start:end], features, tried, smallest
            )
            ours, total = 0.0, 0.0
            for row in rows[start:end]:
                ours += weights[row] * kinds[row]
                total += weights[row]
            value[node] = ours / total
            if feature[node] >= 0:
                middle = start
                for place in range(start, end):
                    row = rows[place]
                    if train[row, feature[node]] < threshold[node]:
                        rows[place], rows[middle] = rows[middle], row
                        middle += 1
                child[node, 0], child[node, 1] = nodes, nodes + 1
                span[nodes, 0], span[nodes, 1] = start, middle
                span[nodes + 1, 0], span[nodes + 1, 1] = middle, end
                nodes += 2
            node += 1
        for asked in range(len(held_out)):
            node = 0
            while feature[node] >= 0:
                side = 0 if held_out[asked, feature[node]] < threshold[node] else 1
                node = child[node, side]
            scores[asked] += value[node] / trees


@compiled()
def _draw_split(
    train: np.ndarray, kinds: np.ndarray, weights: np.ndarray, rows: np.ndarray, features: np.ndarray,
    tried: int, smallest: int,
) -> tuple[int, float]:  # fmt: skip
    """Return the feature and the place of the best of some random splits; -1 where none is to be made."""
    best, best_place, least = -1, 0.0, np.inf
    if len(rows) < 2 * smallest:
        return best, best_place
    found, number = 0, 0
    width = len(features)
    while found < tried and number < width:
        drawn = number + int(np.random.random() * (width - number))  # noqa: NPY002
        features[number], features[drawn] = features[drawn], features[number]
        column = features[number]
        number += 1
        low, high = np.inf, -np.inf
        for row in rows:
            low, high = min(low, train[row, column]), max(high, train[row, column])
        if not high > low:
            continue
        found += 1
        place = low + np.random.random() * (high - low)  # noqa: NPY002
        below = 0
        left_ours, left, ours, total = 0.0, 0.0, 0.0, 0.0
        for row in rows:
            weight = weights[row]
            total += weight
            ours += weight * kinds[row]
            if train[row, column] < place:
                below += 1
                left += weight
                left_ours += weight * kinds[row]
        if below < smallest or len(rows) - below < smallest:
            continue
        right, right_ours = total - left, ours - left_ours
        impurity = left_ours * (left - left_ours) / left + right_ours * (right - right_ours) / right
        if impurity < least:
            best, best_place, least = column, place, impurity
    if best >= 0 and least <= 0.0 and _is_pure(kinds, rows):
        return -1, 0.0
    return best, best_place


@compiled()
def _is_pure(kinds: np.ndarray, rows: np.ndarray) -> bool:
    total = 0.0
    for row in rows:
        total += kinds[row]
    return total == 0.0 or total == len(rows)
