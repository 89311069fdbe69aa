"""Garbage is not looked for while the window is made, and is again afterwards."""

from __future__ import annotations

import gc
import weakref

import pytest

from mbstudio.ui.shell.collection import pause_collection, resume_collection


class Node:
    """One that holds itself."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture(autouse=True)
def collector():
    yield
    gc.unfreeze()
    gc.enable()


def test_nothing_is_collected_while_paused_and_garbage_of_later_is():
    pause_collection()
    assert not gc.isenabled()
    resume_collection()
    assert gc.isenabled()
    later = weakref.ref(Node())
    gc.collect()
    assert later() is None


def test_what_was_made_before_is_never_walked_through_again():
    pause_collection()
    stays = [Node() for _ in range(100)]
    resume_collection()
    assert not any(thing is stays for thing in gc.get_objects())
    assert gc.get_freeze_count() > 1000


def test_collecting_goes_on_where_it_was_never_paused():
    frozen = gc.get_freeze_count()
    resume_collection()
    assert gc.get_freeze_count() == frozen
