"""The same step for many grains, on several processes."""

from mbstudio.core.batch.fit_many import BatchItem, fit_many

__all__ = ["BatchItem", "fit_many"]
