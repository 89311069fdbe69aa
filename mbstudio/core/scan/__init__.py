"""CT scans: readers by file family, the lazy voxel array, and the synthetic sample."""

from mbstudio.core.scan.scan import Scan

__all__ = ["Scan"]
