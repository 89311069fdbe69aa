"""What a style-learner was trained on, and how good it is."""

from __future__ import annotations

import platform
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from mbstudio.core.errors import StyleError
from mbstudio.core.version import __version__


@dataclass(frozen=True)
class ModelCard:
    """The card that stays with a style-learner and its file.

    Attributes
    ----------
    preset : str
    names : tuple of str
        Of the parents.
    held_out : tuple of str
        Those of them that the training did not see, by which `held_out_rms` was measured.
    unit : str
        Of the sizes.
    n : int
        Control points of an avatar.
    smallest, largest : float
        Nominal diameters D_n of the parents, in `unit`.
    latents : int
        Of the model proper, without the details that it leaves.
    seed : int
    steps : int
        Steps of the training, all told.
    settings : dict
        Options of the training that were not at their defaults.
    versions : dict
        Of mbstudio and the libraries that computed.
    parents_rms : float
        Mean over the parents of the root mean square surface distance of avatar and grain, in D_n; NaN
        if unknown.
    trained_rms, held_out_rms : float
        Mean over the avatars seen in training, and over those held out, of the root mean square surface
        distance of an avatar and what the model proper makes of it, in D_n; NaN where there is none.
    notes : tuple of str
        What happened in training, and what to expect, in sentences.
    quality : dict
        Report on clones, if one was made.
    """

    preset: str
    names: tuple[str, ...]
    unit: str
    n: int
    smallest: float
    largest: float
    latents: int
    seed: int
    held_out: tuple[str, ...] = ()
    steps: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    parents_rms: float = float("nan")
    trained_rms: float = float("nan")
    held_out_rms: float = float("nan")
    notes: tuple[str, ...] = ()
    quality: dict[str, Any] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of parents."""
        return len(self.names)

    def with_quality(self, report: dict[str, Any]) -> ModelCard:
        """Return the card with a quality report of plain numbers, words, lists and dicts."""
        return replace(self, quality=dict(report))

    def as_dict(self) -> dict[str, Any]:
        """Return the card as what JSON can hold; numbers that are none become null."""
        card: dict[str, Any] = _without_nan(asdict(self))
        return card

    @classmethod
    def from_dict(cls, entries: dict[str, Any]) -> ModelCard:
        """Return the card of :meth:`as_dict`.

        Raises
        ------
        StyleError
            If entries are missing or of the wrong kind.
        """
        try:
            known = {f.name: entries[f.name] for f in fields(cls)}
            for name in ("names", "held_out", "notes"):
                known[name] = tuple(str(text) for text in known[name])
            for name in ("smallest", "largest", "parents_rms", "trained_rms", "held_out_rms"):
                known[name] = float("nan") if known[name] is None else float(known[name])
            for name in ("n", "latents", "seed", "steps"):
                known[name] = int(known[name])
            for name in ("settings", "versions", "quality"):
                known[name] = dict(known[name])
            return cls(**known)
        except (KeyError, OverflowError, TypeError, ValueError) as error:
            raise StyleError(f"Its model card is incomplete: {error}.") from None


def library_versions(*names: str) -> dict[str, str]:
    """Return the versions of Python, mbstudio, numpy and these libraries."""
    from importlib.metadata import version

    found = {"mbstudio": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in ("numpy", *names)}


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(entry) for entry in value]
    if isinstance(value, float) and value != value:
        return None
    return value
