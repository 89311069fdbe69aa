"""Folders of a sealed JSON card and the numbers that it names; a write leaves the old or the new one.

The numbers are a safetensors file named after their digest; the card, replaced last, names it and carries a
seal of its own (see :mod:`mbstudio.core.sealing`).
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MbstudioError
from mbstudio.core.plain_files import PlainFileError, parse_json, read_plain_bytes
from mbstudio.core.replacement import replacing
from mbstudio.core.sealing import BrokenSealError, check_json, seal_json

Tensors = dict[str, Float[np.ndarray, "..."]]
"""Numbers by name, as they stand in the file."""

_LARGEST_CARD = 100 * 2**20
_LARGEST_WEIGHTS = 2 * 2**30


@dataclass(frozen=True)
class TensorFolder:
    """A kind of such folder.

    Attributes
    ----------
    stem : str
        What its files are called before the ending.
    kind : str
        Entry of the card that tells it from all others.
    title : str
        What messages call its contents.
    newest : int
        The format that is written, and the newest that is read.
    error : type
        Of what is raised.
    warning : type
        Of the warning about a card without a seal.
    made_again : str
        What makes such a folder anew.
    """

    stem: str
    kind: str
    title: str
    newest: int
    error: type[MbstudioError]
    warning: type[Warning]
    made_again: str

    @property
    def card(self) -> str:
        """Name of the card."""
        return f"{self.stem}.json"

    def write(self, folder: Path, entries: Mapping[str, Any], tensors: Tensors) -> Path:
        """Write a folder and return it; an older one there is replaced.

        Raises
        ------
        MbstudioError
            Of kind `error`, if the folder cannot be written.
        """
        from safetensors.numpy import save

        content = save({name: np.ascontiguousarray(array) for name, array in tensors.items()})
        digest = hashlib.sha256(content).hexdigest()
        weights = f"{self.stem}-{digest[:12]}.safetensors"
        told = {"kind": self.kind, "format": self.newest, "weights": weights, "sha256": digest, **entries}
        card = seal_json(told)
        had_folder, had_weights = folder.exists(), (folder / weights).exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(folder / weights) as temporary:
                temporary.write_bytes(content)
            with replacing(folder / self.card) as temporary:
                temporary.write_bytes(card)
            for older in folder.glob(f"{self.stem}-*.safetensors"):
                if older.name != weights:
                    older.unlink(missing_ok=True)
        except OSError as error:
            with suppress(OSError):  # a folder that cannot be read can hardly be tidied up
                if not had_weights:
                    (folder / weights).unlink(missing_ok=True)
                if not had_folder:
                    folder.rmdir()
            raise self.error(
                f"The {self.title} cannot be written into {folder}: {error.strerror or error}. "
                "Choose a folder that can be written."
            ) from error
        return folder

    def read_card(self, folder: Path) -> dict[str, Any]:
        """Return the entries of a folder's card, known to be of a format that is understood.

        Raises
        ------
        MbstudioError
            Of kind `error`, if it is missing, damaged, no JSON, foreign or newer.
        """
        path = folder / self.card
        content = self._read(path, _LARGEST_CARD)
        try:
            sealed = check_json(content)
        except BrokenSealError as error:
            raise self.error(f"{path} is damaged ({error}): take another copy of the folder.") from None
        try:
            entries = parse_json(content)
        except PlainFileError:
            raise self.error(f"{path} is damaged or no JSON file: take another copy of the folder.") from None
        if not isinstance(entries, dict) or entries.get("kind") != self.kind:
            raise self.error(f"{path} is not a {self.title}: choose a folder in which one was saved.")
        form = entries.get("format")
        if not isinstance(form, int) or isinstance(form, bool) or form < 1:
            raise self.error(f"{path} does not say its format: take another copy of the folder.")
        if form > self.newest:
            raise self.error(
                f"{path} has format {form}, from a newer mbstudio than this, which reads up to "
                f"{self.newest}: update mbstudio."
            )
        if not sealed:
            warnings.warn(
                f"{path} carries no digest: it was written by an mbstudio that did not seal its files, and "
                f"damage of it would go unseen. Saving the {self.title} again seals it.",
                self.warning,
                stacklevel=2,
            )
        return entries

    def read_tensors(self, folder: Path, entries: Mapping[str, Any]) -> tuple[Tensors, Path]:
        """Return the numbers that a card names, and their file.

        Raises
        ------
        MbstudioError
            Of kind `error`, if the file is not that which the card was written with, or damaged.
        KeyError
            If the card names none.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import load

        path = folder / Path(str(entries["weights"])).name
        content = self._read(path, _LARGEST_WEIGHTS)
        if hashlib.sha256(content).hexdigest() != entries["sha256"]:
            raise self.error(
                f"{path} is not the file that {self.card} was written with (truncated, changed or from "
                f"another {self.title}): copy the whole folder again."
            )
        try:
            return load(content), path
        except (SafetensorError, KeyError, ValueError, TypeError) as error:
            raise self.error(f"{path} is damaged or no safetensors file ({error}): copy it again.") from None

    def require_finite(self, tensors: Tensors, path: Path, *, but: tuple[str, ...] = ()) -> None:
        """Refuse numbers that are not finite, but for those of names in `but`.

        Raises
        ------
        MbstudioError
            Of kind `error`; it names the file.
        """
        for name, array in tensors.items():
            if name not in but and array.dtype.kind == "f" and not np.isfinite(array).all():
                raise self.error(
                    f"{path} contains numbers that are not finite in '{name}': {self.made_again}."
                )

    def _read(self, path: Path, most: int) -> bytes:
        try:
            return read_plain_bytes(path, most)
        except PlainFileError as error:
            raise self.error(f"{path} cannot be read: {error}.") from error
