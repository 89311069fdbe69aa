"""What a hand can do to widgets: press, drag, turn, type, choose; each act tells in words what it does."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QKeyEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QDialog,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QTabBar,
    QTextEdit,
    QWidget,
)
from shiboken6 import isValid

LEFT, RIGHT, MIDDLE = Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton, Qt.MouseButton.MiddleButton
NONE = Qt.KeyboardModifier.NoModifier
MODIFIERS = (
    NONE, NONE, NONE, Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier,
    Qt.KeyboardModifier.AltModifier,
)  # fmt: skip
KEYS = (
    Qt.Key.Key_Escape, Qt.Key.Key_Tab, Qt.Key.Key_Backtab, Qt.Key.Key_Space, Qt.Key.Key_Return, Qt.Key.Key_Up,
    Qt.Key.Key_Down, Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End, Qt.Key.Key_Delete, Qt.Key.Key_Backspace, Qt.Key.Key_F2, Qt.Key.Key_Plus,
    Qt.Key.Key_Minus, Qt.Key.Key_Question, Qt.Key.Key_A, Qt.Key.Key_N, Qt.Key.Key_M,
)  # fmt: skip
TEXTS = (
    "", " ", "0", "1", "-1", "7", "12.5", "12,5", "1e9", "1e-9", "nan", "inf", "14", "20 x 14 x 14",
    "90:140, 200:255",
    "sphericity=0.75..0.8", "csf=0.6", "10, 20", "8 12", "abc", "ä ö 粒", "'; --", "../..", "x" * 300,
    "{name}", "%s",
    "<b>a</b>", "\t",
)  # fmt: skip


def root() -> QWidget | None:
    """Return where a hand can reach: the dialog that holds all others back, else any window."""
    modal = QApplication.activeModalWidget()
    if modal is not None:
        return modal
    shown = [
        widget for widget in QApplication.topLevelWidgets() if widget.isVisible() and not widget.parent()
    ]
    return shown[0] if shown else None


def within_reach(kind: type[QWidget] | tuple[type[QWidget], ...]) -> list[Any]:
    """Return the widgets of a kind that can be seen and used."""
    place = root()
    if place is None:
        return []
    kinds = kind if isinstance(kind, tuple) else (kind,)
    return [
        widget
        for each in kinds
        for widget in place.findChildren(each)
        if widget.isVisible() and widget.isEnabled() and not widget.visibleRegion().isEmpty()
    ]


def named(widget: QWidget) -> str:
    """Return what a widget is called in the notes."""
    words = widget.accessibleName() or widget.objectName() or widget.toolTip()[:40]
    if isinstance(widget, QAbstractButton):
        words = widget.text() or words
    return f"{type(widget).__name__} “{words}”"


def some_place(widget: QWidget, random: Random) -> QPoint:
    """Return a place on a widget."""
    return QPoint(random.randrange(max(1, widget.width())), random.randrange(max(1, widget.height())))


def type_in(widget: QWidget, text: str) -> None:
    """Type a text letter by letter; QTest knows the keys of English keyboards only."""
    for letter in text:
        for kind in (QEvent.Type.KeyPress, QEvent.Type.KeyRelease):
            if isValid(widget):
                QApplication.sendEvent(widget, QKeyEvent(kind, 0, NONE, letter))


def drag(widget: QWidget, random: Random, button: Qt.MouseButton = LEFT) -> None:
    """Press a button, move, let go."""
    modifiers = random.choice(MODIFIERS)
    QTest.mousePress(widget, button, modifiers, some_place(widget, random))
    for _ in range(random.randrange(1, 5)):
        QTest.mouseMove(widget, some_place(widget, random))
        QApplication.processEvents()
    QTest.mouseRelease(widget, button, modifiers, some_place(widget, random))


def turn_wheel(widget: QWidget, random: Random) -> None:
    """Turn the wheel over a place."""
    place = QPointF(some_place(widget, random))
    event = QWheelEvent(
        place, widget.mapToGlobal(place), QPoint(), QPoint(0, 120 * random.choice((-3, -1, 1, 3))),
        Qt.MouseButton.NoButton, random.choice(MODIFIERS[:4]), Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(widget, event)


def wander(widget: QWidget, random: Random) -> str:
    """Do one of the things that a mouse can do to something that is drawn."""
    kind = random.choice(
        ("click", "click", "drag", "drag", "wheel", "double click", "right drag", "middle drag", "hover")
    )
    if kind == "click":
        QTest.mouseClick(widget, LEFT, random.choice(MODIFIERS), some_place(widget, random))
    elif kind == "double click":
        QTest.mouseDClick(widget, LEFT, NONE, some_place(widget, random))
    elif kind == "wheel":
        turn_wheel(widget, random)
    elif kind == "hover":
        QTest.mouseMove(widget, some_place(widget, random))
    else:
        drag(widget, random, {"drag": LEFT, "right drag": RIGHT, "middle drag": MIDDLE}[kind])
    return f"{kind} on {named(widget)}"


def press_button(random: Random) -> str:
    """Press any button that can be seen."""
    found = within_reach(QAbstractButton)
    if not found:
        return ""
    button = random.choice(found)
    told = f"press {named(button)}"
    QTest.mouseClick(button, LEFT, NONE, button.visibleRegion().boundingRect().center())
    return told


def move_slider(random: Random) -> str:
    """Drag a slider or scroll bar, or move it by keys."""
    found = within_reach(QAbstractSlider)
    if not found:
        return ""
    slider = random.choice(found)
    if random.random() < 0.6:
        drag(slider, random)
    else:
        QTest.keyClick(slider, random.choice(KEYS[5:13]))
    return f"move {named(slider)}"


def turn_number(random: Random) -> str:
    """Step a number, or type one, sense or nonsense."""
    found = within_reach(QAbstractSpinBox)
    if not found:
        return ""
    field = random.choice(found)
    if random.random() < 0.6:
        field.stepBy(random.choice((-10, -1, 1, 10)))
        return f"step {named(field)}"
    text = random.choice(TEXTS)
    field.setFocus()
    field.selectAll()
    type_in(field, text)
    QTest.keyClick(field, random.choice((Qt.Key.Key_Return, Qt.Key.Key_Tab)))
    return f"type “{text}” into {named(field)}"


def choose_entry(random: Random) -> str:
    """Choose another entry of a list that folds out."""
    found = [box for box in within_reach(QComboBox) if box.count()]
    if not found:
        return ""
    box = random.choice(found)
    place = random.randrange(box.count())
    box.setCurrentIndex(place)
    box.activated.emit(place)
    return f"choose “{box.itemText(place)}” in {named(box)}"


def type_text(random: Random) -> str:
    """Type sense or nonsense into a line of text."""
    found = within_reach((QLineEdit, QPlainTextEdit, QTextEdit))
    if not found:
        return ""
    field, text = random.choice(found), random.choice(TEXTS)
    field.setFocus()
    if isinstance(field, QLineEdit):
        field.selectAll()
    type_in(field, text[:40])
    QTest.keyClick(field, random.choice((Qt.Key.Key_Return, Qt.Key.Key_Tab, Qt.Key.Key_Down)))
    return f"type “{text[:40]}” into {named(field)}"


def use_table(random: Random) -> str:
    """Choose rows of a table or list by mouse or keys, sort it, write into it."""
    found = [view for view in within_reach(QAbstractItemView) if view.model() is not None]
    if not found:
        return ""
    view = random.choice(found)
    header = getattr(view, "horizontalHeader", lambda: None)()
    kind = random.choice(
        ("click", "click", "click", "drag", "key", "key", "sort", "right click", "write", "wheel")
    )
    if kind == "sort" and header is not None and header.isVisible():
        QTest.mouseClick(header.viewport(), LEFT, NONE, some_place(header.viewport(), random))
    elif kind == "key":
        QTest.keyClick(view, random.choice(KEYS), random.choice(MODIFIERS[:5]))
    elif kind == "drag":
        drag(view.viewport(), random)
    elif kind == "wheel":
        turn_wheel(view.viewport(), random)
    elif kind == "right click":
        QTest.mouseClick(view.viewport(), RIGHT, NONE, some_place(view.viewport(), random))
    elif kind == "write":
        place = some_place(view.viewport(), random)
        QTest.mouseDClick(view.viewport(), LEFT, NONE, place)
        editor = QApplication.focusWidget()
        if isinstance(editor, QLineEdit) and view.isAncestorOf(editor):
            editor.selectAll()
            type_in(editor, random.choice(TEXTS)[:20])
            QTest.keyClick(editor, Qt.Key.Key_Return)
    else:
        QTest.mouseClick(
            view.viewport(), LEFT, random.choice(MODIFIERS[:5]), some_place(view.viewport(), random)
        )
    return f"{kind} in {named(view)}"


def turn_tab(random: Random) -> str:
    """Turn to another tab."""
    found = [bar for bar in within_reach(QTabBar) if bar.count() > 1]
    if not found:
        return ""
    bar = random.choice(found)
    place = random.randrange(bar.count())
    QTest.mouseClick(bar, LEFT, NONE, bar.tabRect(place).center())
    return f"turn to “{bar.tabText(place)}”"


def use_plot(random: Random) -> str:
    """Do something to a plot."""
    found = within_reach(pg.GraphicsView)
    return wander(random.choice(found).viewport(), random) if found else ""


def press_key(random: Random) -> str:
    """Press a key wherever the keyboard is."""
    widget = QApplication.focusWidget() or root()
    if widget is None or not widget.isVisible():
        return ""
    key, modifiers = random.choice(KEYS), random.choice(MODIFIERS[:5])
    QTest.keyClick(widget, key, modifiers)
    return f"press {modifiers.name} {key.name} on {named(widget)}"


def answer_menu(random: Random) -> str:
    """Choose from the menu that is open, or close it."""
    menu = QApplication.activePopupWidget()
    if menu is None:
        return ""
    told = ""
    if isinstance(menu, QMenu):
        choices = [
            action
            for action in menu.actions()
            if action.isEnabled() and not action.isSeparator() and not action.menu()
        ]
        if choices and random.random() < 0.6:
            action = random.choice(choices)
            told = action.text()
            action.trigger()
    elif random.random() < 0.6:
        buttons = [one for one in menu.findChildren(QAbstractButton) if one.isVisible() and one.isEnabled()]
        if buttons:
            button = random.choice(buttons)
            told = named(button)
            button.click()
    menu.close()
    return f"answer a menu with “{told}”"


def answer_dialog(random: Random, dialog: QDialog, acts: list[Callable[[Random], str]]) -> str:
    """Do up to four things in a dialog, then press one of its buttons or Esc; it is not left open."""
    kind, told = type(dialog).__name__, []
    for _ in range(random.randrange(4)):
        if not is_open(dialog):
            return f"answer {kind}: " + " / ".join(told)
        told.append(random.choice(acts)(random))
        QApplication.processEvents()
        while QApplication.activePopupWidget() is not None:
            answer_menu(random)
    if is_open(dialog) and random.random() < 0.7:
        buttons = [
            each for each in dialog.findChildren(QAbstractButton) if each.isVisible() and each.isEnabled()
        ]
        if buttons:
            button = random.choice(buttons)
            told.append(f"press {named(button)}")
            QTest.mouseClick(button, LEFT, NONE, button.rect().center())
            QApplication.processEvents()
    if is_open(dialog):
        dialog.reject()
    return f"answer {kind}: " + " / ".join(told)


def is_open(dialog: QDialog) -> bool:
    """Return whether a dialog is still there and to be seen."""
    return isValid(dialog) and dialog.isVisible()
