"""Suspicion: which grains are probably several, or parts of one, so that a person looks at them first.

Begin at :func:`~mbstudio.core.grains.suspicion.scoring.rank_grains`; `measures` says what is looked at.
"""

from mbstudio.core.grains.suspicion.scoring import rank_grains

__all__ = ["rank_grains"]
