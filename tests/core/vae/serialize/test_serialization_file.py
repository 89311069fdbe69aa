"""Serialized avatars on disk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialize.serialization import load_serialization, save_serialization
from tests.core.vae.serialize.test_serialization import two_avatars


def test_what_is_written_is_read(tmp_path):
    made = two_avatars()
    save_serialization(made, tmp_path / "parents.npz")
    read = load_serialization(tmp_path / "parents.npz")
    assert (read.unit, read.names) == (made.unit, made.names)
    for name in ("centers", "log_weights", "diameters", "rms", "valid"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    np.testing.assert_array_equal(read.template.exchange, made.template.exchange)
    assert [path.name for path in tmp_path.iterdir()] == ["parents.npz"]


def test_the_stiffness_of_a_template_is_kept(tmp_path):
    made = two_avatars()
    made = replace(made, template=replace(made.template, stiffness=np.diag(np.arange(1.0, 33))))
    save_serialization(made, tmp_path / "parents.npz")
    read = load_serialization(tmp_path / "parents.npz")
    np.testing.assert_array_equal(read.template.stiffness, np.diag(np.arange(1.0, 33)))
    with pytest.raises(SerializationError, match=r"stiffness of shape \(3, 3\)"):
        replace(made.template, stiffness=np.eye(3))


def test_files_that_are_none_are_refused(tmp_path):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(b"no archive")
    with pytest.raises(SerializationError, match=r"broken\.npz cannot be read"):
        load_serialization(broken)
    np.savez(tmp_path / "other.npz", centers=np.zeros(3))
    with pytest.raises(SerializationError, match=r"other\.npz contains no serialized avatars"):
        load_serialization(tmp_path / "other.npz")
    with pytest.raises(SerializationError, match="cannot be written"):
        save_serialization(two_avatars(), tmp_path / "nowhere" / "parents.npz")
