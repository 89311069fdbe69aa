"""The serializer: grains, meshes and avatars as avatars of one template in one common frame."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from mbstudio.core.batch.body_messages import body_from, body_message
from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.errors import SerializationError, SerializationWarning
from mbstudio.core.units import conversion_factor, parse_unit
from mbstudio.core.vae.serialize.fit_target import prepare_body
from mbstudio.core.vae.serialize.frame import body_name
from mbstudio.core.vae.serialize.mean_shape import make_template
from mbstudio.core.vae.serialize.serialization import Serialization, Template
from mbstudio.core.vae.serialize.template import learn_template, orbit_kinds
from mbstudio.core.vae.serialize.template_fit import FittedBody, fit_from_template

if TYPE_CHECKING:
    from mbstudio.core.vae.serialize.frame import Body

FEWEST_BODIES = 5
_FOR_TEMPLATE = 32
_TEMPLATE_ROUNDS = 2
_COPY = 1e-5  # D_n and ln k
_TEMPLATE = ("centers", "log_weights", "exchange")
_OTHER_SIZE = 30.0

Progress = Callable[[float, str], None]


def serialize(
    bodies: Sequence[Body],
    n: int = 40,
    *,
    template: Template | None = None,
    unit: str | None = None,
    names: Sequence[str] | None = None,
    seed: int = 0,
    processes: int = 1,
    on_progress: Progress | None = None,
) -> Serialization:
    """Fit every body from one symmetric template, so that control point i means the same in each.

    Each body is laid into its principal frame (centroid, principal axes of inertia, unit D_n) and
    fitted from the template by Levenberg-Marquardt steps that hold every control point near its
    place. Without a template one is made: fitted to the mean shape of the bodies and all their
    flips, then replaced twice by the mean of the fits.

    Parameters
    ----------
    bodies : sequence of Grain, Avatar or trimesh.Trimesh
        At least five, or any number with a template. Avatars of any n are fitted anew to their surfaces.
    n : int
        Control points; not used with a template.
    template : Template, optional
        Serialize into the order of this one.
    unit : str, optional
        Of the diameters, that of the first body by default. For a mesh that carries no unit, the unit
        that its numbers are in.
    names : sequence of str, optional
        One a body; their own by default.
    seed : int
        Of the places of surface points.
    processes : int
        The result does not depend on it.
    on_progress : callable, optional
        ``on_progress(share, message)``; what it raises ends the work at once.

    Raises
    ------
    SerializationError
        If there are too few bodies, or one cannot be serialized: the message names it.

    Warns
    -----
    SerializationWarning
        About copies, bodies more than thirty times larger or smaller than the median, and avatars
        that are not valid.

    References
    ----------
    Zhao et al. (2023), Computers and Geotechnics 161, 105564, section 4 (serializer).
    """
    bodies = list(bodies)
    if template is None and len(bodies) < FEWEST_BODIES:
        raise SerializationError(
            f"{len(bodies)} bodies are too few to learn a style from: give at least {FEWEST_BODIES}, "
            "or the template of the population that they belong to."
        )
    if not bodies:
        raise SerializationError("There are no bodies to serialize.")
    if processes < 1:
        raise SerializationError(f"The number of processes must be 1 or more, not {processes}.")
    names = [body_name(body, i) for i, body in enumerate(bodies)] if names is None else list(names)
    if len(names) != len(bodies):
        raise SerializationError(f"{len(bodies)} bodies have {len(names)} names: give one for each.")
    asked = None if unit is None else parse_unit(unit)
    told = _ProgressCount(on_progress, len(bodies), template is None)
    work = _Work(bodies, names, asked, seed, processes)
    if template is None:
        template = _find_template(work, n, told)
    told.message = "fitted"
    fitted = work.fit(range(len(bodies)), template, told)
    return _warn_of_oddities(_gather(fitted, template, names, asked or fitted[0].unit))


class _ProgressCount:
    """Says how far the work is: the rounds for the template, then all bodies."""

    def __init__(self, told: Progress | None, bodies: int, with_template: bool) -> None:
        rounds = 1 + _TEMPLATE_ROUNDS if with_template else 0
        self._told, self._all, self._done = told, bodies + rounds * min(bodies, _FOR_TEMPLATE), 0
        self.message = "seen for the template"

    def count_one(self) -> None:
        self._done += 1
        if self._told is not None:
            self._told(self._done / self._all, f"{self._done} of {self._all} bodies {self.message}")


class _TemplateFits(Job[int, FittedBody]):
    """In goes a body by its row, out comes its fit from the template."""

    def __init__(
        self, bodies: Sequence[Body], names: Sequence[str], unit: str | None, seed: int, template: Template
    ) -> None:
        self._bodies, self._names, self._unit, self._seed = bodies, names, unit, seed
        self._template = template

    def pack(self, row: int) -> Message:
        head, arrays = body_message(self._bodies[row])
        template = {f"template_{name}": getattr(self._template, name) for name in _TEMPLATE}
        if self._template.stiffness is not None:
            template["template_stiffness"] = self._template.stiffness
        how = {"unit": self._unit, "seed": self._seed, "name": self._names[row]}
        return {"body": head, "how": how}, {**arrays, **template}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        stiffness = arrays.pop("template_stiffness", None)
        known = {name: arrays.pop(f"template_{name}") for name in _TEMPLATE}
        template = Template(**known, stiffness=stiffness)
        found = fit_from_template(body_from(head["body"], arrays), template, **head["how"])
        told = {"diameter": found.diameter, "unit": found.unit, "rms": found.rms, "valid": found.valid}
        return told, {"centers": found.centers, "log_weights": found.log_weights}

    def unpack(self, row: int, head: Head, arrays: Arrays) -> FittedBody:
        return FittedBody(arrays["centers"], arrays["log_weights"], **head)

    def work_here(self, row: int) -> FittedBody:
        return fit_from_template(
            self._bodies[row], self._template, unit=self._unit, seed=self._seed, name=self._names[row]
        )

    def lose(self, row: int, code: int) -> FittedBody:
        raise SerializationError(
            f"The process that serialized '{self._names[row]}' ended with code {code}: "
            "try again with fewer processes, which need less memory."
        )


class _Work:
    """The bodies, and how any of them are fitted from a template on one process or several."""

    def __init__(
        self, bodies: Sequence[Body], names: Sequence[str], unit: str | None, seed: int, processes: int
    ) -> None:
        self.bodies, self.names, self.unit, self.seed, self.processes = bodies, names, unit, seed, processes

    def fit(self, rows: Sequence[int], template: Template, told: _ProgressCount) -> list[FittedBody]:
        """Return the fits of these bodies, in this order."""
        job = _TemplateFits(self.bodies, self.names, self.unit, self.seed, template)
        pool = WorkerPool(job, 0 if self.processes == 1 else self.processes)
        return pool.map(rows, lambda _row, _fitted: told.count_one())


def _find_template(work: _Work, n: int, told: _ProgressCount) -> Template:
    """Return a template for the bodies, from an even sample of them where they are many."""
    orbit_kinds(n)  # a bad number of control points is said before any work
    count = len(work.bodies)
    rows = np.unique(np.linspace(0, count - 1, min(count, _FOR_TEMPLATE)).astype(int)).tolist()
    prepared = []
    for row in rows:
        prepared.append(prepare_body(work.bodies[row], unit=work.unit, seed=work.seed, name=work.names[row]))
        told.count_one()
    template = make_template(prepared, n)
    del prepared
    for _ in range(_TEMPLATE_ROUNDS):
        fitted = work.fit(rows, template, told)
        template = learn_template(
            np.stack([one.centers for one in fitted]), np.stack([one.log_weights for one in fitted])
        )
    return template


def _gather(
    fitted: Sequence[FittedBody], template: Template, names: Sequence[str], unit: str
) -> Serialization:
    return Serialization(
        template,
        np.stack([one.centers for one in fitted]),
        np.stack([one.log_weights for one in fitted]),
        np.array([one.diameter * conversion_factor(one.unit, unit) for one in fitted]),
        unit,
        tuple(names),
        np.array([one.rms for one in fitted]),
        np.array([one.valid for one in fitted]),
    )


def find_copies(serialization: Serialization) -> Int[np.ndarray, " copies"]:
    """Return the rows of avatars that have the shape of one before them."""
    shapes = np.concatenate(
        [serialization.centers.reshape(len(serialization), -1), serialization.log_weights], axis=1
    )
    return np.array(
        [i for i in range(1, len(shapes)) if (np.abs(shapes[:i] - shapes[i]).max(axis=1) < _COPY).any()],
        dtype=np.int64,
    )


def _warn_of_oddities(serialization: Serialization) -> Serialization:
    """Return serialized avatars as they are, after warnings of what is odd about them."""

    def listed(rows: np.ndarray) -> str:
        some = ", ".join(f"'{serialization.names[int(row)]}'" for row in rows[:3])
        return some + (", ..." if len(rows) > 3 else "")

    count, twice = len(serialization), find_copies(serialization)
    sizes = serialization.diameters / np.median(serialization.diameters)
    odd = np.flatnonzero((sizes > _OTHER_SIZE) | (sizes < 1 / _OTHER_SIZE))
    bad = np.flatnonzero(~serialization.valid)
    told = []
    if len(twice):
        told.append(
            f"{len(twice)} of {count} bodies have the same shape as another ({listed(twice)}): only "
            f"{count - len(twice)} shapes can be learned from."
        )
    if len(odd):
        told.append(
            f"{len(odd)} of {count} bodies ({listed(odd)}) are more than {_OTHER_SIZE:g} times larger or "
            "smaller than the median. Shapes do not depend on size, but the sizes of new grains will "
            "follow them: check their units, or leave them out."
        )
    if len(bad):
        told.append(
            f"{len(bad)} of {count} avatars ({listed(bad)}) are in pieces, have a void or do not contain "
            "their control points: serialize with a larger n, or leave them out."
        )
    for message in told:
        warnings.warn(message, SerializationWarning, stacklevel=3)
    return serialization
