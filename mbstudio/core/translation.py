"""Texts of the engine that a window may show in another language."""

from __future__ import annotations


def mark(text: str) -> str:
    """Return a text as it is; Qt's ``lupdate`` collects it for the window, which translates it when shown.

    Parameters
    ----------
    text : str
        In English, written out where `mark` is called (docs/translating.md).
    """
    return text
