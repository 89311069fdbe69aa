"""The version of mbstudio: the one place where it stands, for files written and for the distribution."""

from __future__ import annotations

__version__ = "0.1.0"
