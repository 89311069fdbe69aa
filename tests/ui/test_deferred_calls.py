"""Calls that wait for the event loop."""

from __future__ import annotations

import gc
import weakref

from PySide6.QtCore import QCoreApplication, QObject

from mbstudio.ui.deferred_calls import DeferredCalls
from tests.ui.conftest import delete_later_now


def test_what_waits_is_called_once_and_in_order(qapp):
    told, parent = [], QObject()
    soon = DeferredCalls(parent)

    def first():
        told.append("first")
        soon.call(lambda: told.append("from within"))

    soon.call(first)
    soon.call(lambda: told.append("second"))
    soon.call(first)
    assert told == []
    QCoreApplication.processEvents()
    assert told[:2] == ["first", "second"]
    QCoreApplication.processEvents()
    assert told == ["first", "second", "from within"]


def test_what_waits_goes_with_its_parent(qapp):
    class Held:
        pass

    told, parent, held = [], QObject(), Held()
    DeferredCalls(parent).call(lambda: told.append(held))
    there = weakref.ref(held)
    parent.deleteLater()
    delete_later_now()
    del parent, held
    gc.collect()
    assert told == []
    assert there() is None
