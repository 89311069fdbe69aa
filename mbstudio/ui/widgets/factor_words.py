"""What shape factors are called in the window, in the person's language: the words are those of the table."""

from __future__ import annotations

from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.ui.language import tr


def factor_title(name: str) -> str:
    """Return a factor in words."""
    return tr(FACTORS[name].title)


def factor_label(name: str) -> str:
    """Return a factor in words, with its symbol."""
    return f"{factor_title(name)} {FACTORS[name].symbol}".strip()


def factor_heading(name: str, length: str) -> str:
    """Return words, symbol and unit of a factor: the name of an axis."""
    unit = FACTORS[name].unit(length)
    return f"{factor_label(name)} ({unit})" if unit else factor_label(name)


def factor_short(name: str, length: str | None = None) -> str:
    """Return the symbol of a factor where people know it by that, else its words; with a unit if stated."""
    factor = FACTORS[name]
    unit = "" if length is None else factor.unit(length)
    return f"{tr(factor.short)} [{unit}]" if unit else tr(factor.short)


def factor_tip(name: str) -> str:
    """Return what a factor means, with its formula."""
    factor = FACTORS[name]
    return f"{tr(factor.meaning)}: {factor.formula}" if factor.formula else tr(factor.meaning)


def latent_count(core: int, dimension: int) -> str:
    """Return how many latent variables a style has: those of its model, and those of the details."""
    return f"{core}" if core == dimension else f"{core} + {dimension - core}"
