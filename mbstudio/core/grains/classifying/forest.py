"""A random forest as plain arrays: grown by scikit-learn, asked by compiled code.

Breiman (2001), *Machine Learning* 45, 5. Growing is the same for any number of threads; a vote is a sum over
the trees in their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float32, Int32, Int64

from mbstudio.core.compiled import compiled

_DEEPEST = 14
_LEAST_IN_LEAF = 3
_MOST_NODES = 5_000_000


@dataclass(frozen=True, eq=False)
class Forest:
    """Decision trees, their nodes end to end.

    Attributes
    ----------
    starts : int64 array, shape (trees + 1,)
        Where the nodes of each tree begin; the first of them is its root.
    feature : int32 array, shape (nodes,)
        The column that a node asks for; -1 for a leaf.
    threshold : float32 array, shape (nodes,)
        Rows whose value is at most this go to `left`.
    left, right : int32 array, shape (nodes,)
        Numbers of nodes within the whole array, higher than the node's own; -1 for a leaf.
    shares : float32 array, shape (nodes, classes)
        Of a leaf, the share of each class among the rows that it was grown from.
    """

    starts: Int64[np.ndarray, " t"]
    feature: Int32[np.ndarray, " n"]
    threshold: Float32[np.ndarray, " n"]
    left: Int32[np.ndarray, " n"]
    right: Int32[np.ndarray, " n"]
    shares: Float32[np.ndarray, "n k"]

    @property
    def trees(self) -> int:
        return len(self.starts) - 1

    @property
    def classes(self) -> int:
        return int(self.shares.shape[1])

    @classmethod
    def grown(
        cls, rows: Float32[np.ndarray, "m f"], classes: Int64[np.ndarray, " m"], *, trees: int, seed: int
    ) -> tuple[Forest, float]:
        """Grow a forest; return it and the share of rows that trees tell rightly which did not see them.

        Parameters
        ----------
        rows : float32 array, shape (m, f)
        classes : int64 array, shape (m,)
            0 to k - 1, each at least once.
        trees : int
        seed : int
        """
        # Imported late: it takes a second, and asking a forest does without.
        from sklearn.ensemble import RandomForestClassifier

        model = RandomForestClassifier(
            n_estimators=trees, max_depth=_DEEPEST, min_samples_leaf=_LEAST_IN_LEAF, max_features="sqrt",
            class_weight="balanced", bootstrap=True, oob_score=False, random_state=seed, n_jobs=1,
        )  # fmt: skip
        model.fit(rows, classes)
        starts, parts = [0], []
        for estimator in model.estimators_:
            tree, first = estimator.tree_, starts[-1]
            is_leaf = tree.children_left < 0
            values = tree.value[:, 0, :]
            shares = values / values.sum(axis=1, keepdims=True)
            parts.append(
                (
                    np.where(is_leaf, -1, tree.feature).astype(np.int32),
                    np.where(is_leaf, 0.0, tree.threshold).astype(np.float32),
                    np.where(is_leaf, -1, tree.children_left + first).astype(np.int32),
                    np.where(is_leaf, -1, tree.children_right + first).astype(np.int32),
                    np.where(is_leaf[:, None], shares, 0.0).astype(np.float32),
                )
            )
            starts.append(first + tree.node_count)
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        forest = cls(np.array(starts, np.int64), *columns)
        return forest, _unseen_accuracy(forest, rows, classes, model)

    def shares_of(self, rows: Float32[np.ndarray, "m f"]) -> Float32[np.ndarray, "m k"]:
        """Return the share of votes for each class."""
        votes = np.zeros((len(rows), self.classes), np.float32)
        _vote(rows, self.starts, self.feature, self.threshold, self.left, self.right, self.shares, votes)
        votes /= np.float32(self.trees)
        return votes

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Return the forest as arrays by name."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], features: int, classes: int) -> Forest:
        """Return the forest of arrays.

        Raises
        ------
        ValueError, KeyError
            If they are no forest of so many features and classes.
        """
        kinds = {"starts": np.int64, "feature": np.int32, "threshold": np.float32, "left": np.int32,
                 "right": np.int32, "shares": np.float32}  # fmt: skip
        for name, kind in kinds.items():
            if arrays[name].dtype != kind:
                raise ValueError(f"'{name}' has values of type {arrays[name].dtype}")
        forest = cls(**{name: np.ascontiguousarray(arrays[name]) for name in kinds})
        nodes = forest.feature.size
        if forest.starts.ndim != 1 or not forest.starts.size >= 2 or not 1 <= nodes <= _MOST_NODES:
            raise ValueError("it has no trees, or too many")
        if any(getattr(forest, name).shape != (nodes,) for name in ("feature", "threshold", "left", "right")):
            raise ValueError("its arrays are not of one length")
        if forest.shares.shape != (nodes, classes):
            raise ValueError(f"its leaves do not tell {classes} classes")
        forest._require_sound(features)
        return forest

    def _require_sound(self, features: int) -> None:
        """Refuse trees in which asking would not end, or would read beyond the arrays."""
        starts, nodes = self.starts, self.feature.size
        if starts[0] != 0 or starts[-1] != nodes or (np.diff(starts) < 1).any():
            raise ValueError("its trees do not follow each other")
        ends = np.repeat(starts[1:], np.diff(starts))
        inner = self.feature >= 0
        own = np.arange(nodes)
        if (self.feature >= features).any() or (self.feature < -1).any():
            raise ValueError("it asks for features that there are not")
        for child in (self.left, self.right):
            if (inner & ((child <= own) | (child >= ends))).any():
                raise ValueError("a branch leads out of its tree")
        if not (np.isfinite(self.threshold).all() and np.isfinite(self.shares).all()):
            raise ValueError("it holds numbers that are not finite")
        leaves = self.shares[~inner]
        if (leaves < 0).any() or (np.abs(leaves.sum(axis=1) - 1.0) > 1e-3).any():
            raise ValueError("the shares of a leaf do not add up to 1")


def _unseen_accuracy(forest: Forest, rows: np.ndarray, classes: np.ndarray, model: object) -> float:
    """Return how many rows the trees tell rightly that did not see them."""
    samples = model.estimators_samples_  # type: ignore[attr-defined]  # scikit-learn has no types
    votes = np.zeros((len(rows), forest.classes), np.float32)
    for place, drawn in enumerate(samples):
        unseen = np.ones(len(rows), bool)
        unseen[drawn] = False
        part = np.zeros((int(unseen.sum()), forest.classes), np.float32)
        _vote(
            np.ascontiguousarray(rows[unseen]), forest.starts[place : place + 2], forest.feature,
            forest.threshold, forest.left, forest.right, forest.shares, part,
        )  # fmt: skip
        votes[unseen] += part
    asked = votes.sum(axis=1) > 0
    return float((votes[asked].argmax(axis=1) == classes[asked]).mean()) if asked.any() else 0.0


@compiled()
def _vote(
    rows: np.ndarray, starts: np.ndarray, feature: np.ndarray, threshold: np.ndarray, left: np.ndarray,
    right: np.ndarray, shares: np.ndarray, votes: np.ndarray,
) -> None:  # fmt: skip
    count = votes.shape[1]
    for row in range(rows.shape[0]):
        for tree in range(starts.size - 1):
            node = starts[tree]
            while feature[node] >= 0:
                node = left[node] if rows[row, feature[node]] <= threshold[node] else right[node]
            for k in range(count):
                votes[row, k] += shares[node, k]
