"""The same step for many grains, on several processes."""

from mbstudio.core.batch.crew import BatchItem, fit_many

__all__ = ["BatchItem", "fit_many"]
