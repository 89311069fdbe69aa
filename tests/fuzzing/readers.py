"""Every reader of mbstudio by name: each opens a file, reads all of it, and returns a digest."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from mbstudio.core.errors import ScanError, UnitError
from tests.core.project.contents import describe

LARGE = 1e8


def digest(*values: Any) -> str:
    """Return what tells contents apart, to the last bit."""
    found = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            found.update(f"{value.dtype.str}{value.shape}".encode())
            found.update(np.ascontiguousarray(value).tobytes())
        else:
            found.update(json.dumps(describe(value), sort_keys=True).encode())
    return found.hexdigest()


def require_one_line_that_names(told: str, names: Sequence[str]) -> None:
    """Fail unless a message is one line and names one of these files."""
    if "\n" in told:
        raise AssertionError(f"a message of several lines: {told!r}")
    if not any(name in told for name in names):
        raise AssertionError(f"the message does not name the file: {told}")


def _scan(path: Path) -> str:
    from mbstudio.core.scan.opening import place
    from mbstudio.core.scan.readers import ReadOptions, family_of, split_dataset

    file, dataset = split_dataset(path)
    found = []
    for numbers in (False, True):
        options = ReadOptions(numbers=numbers, dataset=dataset)
        reading = family_of(file, options).read(file, options)
        voxels = reading.voxels
        if np.prod([float(count) for count in voxels.shape]) >= LARGE:
            voxels = voxels[voxels.shape[0] // 2]
        found.append(digest(np.asarray(voxels), str(place(reading, "10 um", None, path))))
        try:
            found.append(str(place(reading, None, None, path)))
        except UnitError as error:  # whoever opens such a file states the size
            found.append(str(error))
            require_one_line_that_names(str(error), [path.name, str(path)])
    return digest(*found)


class _ServedHere:
    """The program that reads HDF5, in this process: a start each time would take most of the time.

    What would end or delay that program ends or delays the harness's process, and is told.
    """

    was_late = False

    def __init__(self, path: Path) -> None:
        self._path, self._server = path, None

    def ask(self, question: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        from mbstudio.core.scan.readers.hdf5.server import Server

        try:
            self._server = self._server or Server(str(self._path))
        except Exception as error:
            return {"error": str(error)}, b""
        self._answers = self._server.answers(json.loads(json.dumps(question)))
        return self.answer()

    def answer(self) -> tuple[dict[str, Any], bytes]:
        try:
            head, content = next(self._answers)
        except Exception as error:
            return {"error": str(error)}, b""
        return json.loads(json.dumps(head)), bytes(content)

    def end(self) -> None:
        if self._server is not None:
            self._server.close()


def _hdf5(path: Path) -> str:
    from mbstudio.core.scan.readers.hdf5 import served_file

    with mock.patch.object(served_file, "_Process", _ServedHere):
        return _scan(path)


def _labels(path: Path) -> str:
    from mbstudio.core.grains.label_image import load_labels

    grains = load_labels(path, voxel_size="10 um")
    return digest(np.asarray(grains.labels), grains.table)


def _mesh(path: Path) -> str:
    from mbstudio.core.meshes.bodies import read_bodies

    return digest(
        *(np.asarray(part) for body in read_bodies(path, "mm") for part in (body.vertices, body.faces))
    )


def _project(path: Path) -> str:
    from mbstudio.core.project.file import read_project

    return digest(read_project(path))


def _project_here(path: Path) -> str:
    """Read as a process of its own does it, but in this one, whose bounds are tighter than its."""
    from mbstudio.core.project import stored_reading

    def here(stream: Any, wanted: str, _: Path) -> Any:
        return contextlib.nullcontext(stored_reading._Here(stream, wanted))

    with mock.patch.object(stored_reading, "_Elsewhere", here):
        return _project(path)


def _surface_style(path: Path) -> str:
    from mbstudio.core.cloning.surface_style_file import load_surface_style

    style = load_surface_style(path if path.is_dir() else path.parent)
    avatars = [array for entry in style.avatars for array in (entry.avatar.centers, entry.avatar.weights)]
    surfaces = [array for parent in style.parents for array in (parent.vertices, parent.faces)]
    return digest(style.modes, *surfaces, *avatars, [parent.name for parent in style.parents], style.misfit)


def _journal(path: Path) -> str:
    from mbstudio.core.project.fit_journal import find_fits

    found = find_fits(path)
    return "" if found is None else digest(dict(found.fits), found.damaged)


def _style(path: Path) -> str:
    from mbstudio.core.vae.models.style_learner import load_style_learner

    learner = load_style_learner(path if path.is_dir() else path.parent)
    return digest(
        learner.latents, learner.parents.centers, learner.decode(learner.latents).centers, learner.card
    )


def _serialization(path: Path) -> str:
    from mbstudio.core.vae.serialize.serialization import load_serialization, serialization_arrays

    found = load_serialization(path)
    found.avatars()
    return digest(serialization_arrays(found))


def _recipes(path: Path) -> str:
    from mbstudio.core.vae.shaping.latent_files import read_recipes

    return digest([recipe.as_record() for recipe in read_recipes(path)])


def _latents(path: Path) -> str:
    from mbstudio.core.vae.shaping.latent_files import read_latents

    return digest(read_latents(path))


def _sweep(path: Path) -> str:
    from mbstudio.core.imaging.sweep import read_sweep

    return digest(read_sweep(path))


def _avatar(path: Path) -> str:
    from mbstudio.core.dem.formats.metaball import read_metaball

    avatar = read_metaball(path)
    return digest(avatar.centers, avatar.weights, avatar.label, avatar.name)


def _export(path: Path) -> str:
    from mbstudio.core.dem.exporting import validate

    folder = path if path.is_dir() else path.parent
    for digests in (False, True):
        validate(folder, digests=digests)
    return "whole"


def _autosave(path: Path) -> str:
    from mbstudio.core.project.autosave import Autosave

    (found,) = Autosave.find_abandoned(path.parent)
    try:
        note = found.note
        return digest([str(note.path), str(note.saved), note.grains, note.fits], found.restore().state)
    finally:
        found.release()


def _classifier(path: Path) -> str:
    from mbstudio.core.grains.classifying import load_classifier

    found = load_classifier(path)
    return digest(dict(found.entries), *(found.arrays[name] for name in sorted(found.arrays)))


def _classifier_sealed_anew(path: Path) -> str:
    """A stranger can seal whatever he has made."""
    from mbstudio.core.sealing import HEADER_BYTES, seal_image

    content = bytearray(path.read_bytes())
    if len(content) >= HEADER_BYTES:
        seal_image(memoryview(content))
        path.write_bytes(content)
    return _classifier(path)


def _clump(path: Path) -> str:
    from mbstudio.core.dem.formats.liggghts.target import read_spheres

    return digest(read_spheres(path))


def _dump(path: Path) -> str:
    from mbstudio.core.packing.dumps import read_last_frame

    found = read_last_frame(path)
    return digest(found.step, np.asarray(found.ids, dtype=float), found.places, found.widths)


def _poses(path: Path) -> str:
    from mbstudio.core.packing.poses import read_poses

    found = read_poses(path, ["ball", "stone"])
    return digest(found.kinds, found.scales, found.positions, found.quaternions)


class _ErrorOfTwoLines(ScanError):
    def __str__(self) -> str:
        return str(self.args[0])


def _bad(path: Path) -> str:
    """Do what no reader may do, to show that the harness sees it."""
    how = path.stem
    if how == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif how == "wait":
        while True:
            pass
    elif how == "raise":
        raise ZeroDivisionError
    elif how == "lines":
        raise _ErrorOfTwoLines(f"{path}\nis damaged.")
    elif how == "nameless":
        raise ScanError("It is damaged.")
    elif how == "memory":
        np.ones(9 * 2**28, np.uint8)
    return digest(path.read_bytes().decode("latin-1"))


READERS: dict[str, Callable[[Path], str]] = {
    "scan": _scan,
    "hdf5": _hdf5,
    "labels": _labels,
    "mesh": _mesh,
    "project": _project,
    "project read here": _project_here,
    "surface style": _surface_style,
    "journal": _journal,
    "style": _style,
    "serialization": _serialization,
    "recipes": _recipes,
    "latents": _latents,
    "sweep": _sweep,
    "avatar": _avatar,
    "export": _export,
    "autosave": _autosave,
    "classifier": _classifier,
    "classifier sealed anew": _classifier_sealed_anew,
    "clump": _clump,
    "dump": _dump,
    "poses": _poses,
    "bad": _bad,
}
