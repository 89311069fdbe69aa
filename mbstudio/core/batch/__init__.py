"""The same step for many grains, on several processes."""

from mbstudio.core.batch.crew import BatchItem, fit_many, grain_seed

__all__ = ["BatchItem", "fit_many", "grain_seed"]
