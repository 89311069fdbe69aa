"""The user guide beside the window, opened at what the person asks about."""

from __future__ import annotations

from PySide6.QtCore import QUrl
from PySide6.QtGui import (
    QDesktopServices,
    QPalette,
    QTextBlock,
    QTextCursor,
    QTextDocument,
    QTextFormat,
    QTextLength,
)
from PySide6.QtWidgets import QDialog, QTextBrowser, QVBoxLayout, QWidget

from mbstudio.core.assets import document
from mbstudio.ui.language import tr

_CODE = QTextFormat.Property.BlockCodeFence


class Guide(QDialog):
    """A page of text that blocks nothing; links lead to other documents or the browser."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setWindowTitle(tr("MetaBall Studio guide"))
        self.setModal(False)
        self.resize(760, 720)
        self.page = QTextBrowser()
        self.page.setAccessibleName(tr("Guide"))
        self.page.setOpenLinks(False)
        self.page.document().setDocumentMargin(24)
        self.page.anchorClicked.connect(self._follow)
        self._name = ""
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.page)

    def open_document(self, name: str, heading: str = "") -> None:
        """Show a document of the program, at one of its headings.

        Raises
        ------
        MbstudioError
            If the installation is incomplete.
        """
        if name != self._name:
            path = document(name)
            self.page.setSearchPaths([str(path.parent)])
            self.page.document().setMarkdown(
                path.read_text(encoding="utf-8"), QTextDocument.MarkdownFeature.MarkdownDialectGitHub
            )
            self._name = name
            self._set()
        self.show()
        self.raise_()
        self.activateWindow()
        self.go_to(heading)

    def heading(self) -> str:
        """Return the heading at the upper edge of what is seen."""
        block = self.page.cursorForPosition(self.page.viewport().rect().topLeft()).block()
        while block.isValid() and not block.blockFormat().headingLevel():
            block = block.previous()
        return block.text()

    def go_to(self, heading: str) -> bool:
        """Scroll to a heading; return whether there is one."""
        block = self._block_of(heading)
        if block is None:
            return False
        # From the end upwards, the heading comes to stand at the upper edge.
        self.page.moveCursor(QTextCursor.MoveOperation.End)
        self.page.setTextCursor(QTextCursor(block))
        place = self.page.document().documentLayout().blockBoundingRect(block).top()
        self.page.verticalScrollBar().setValue(round(place))
        return True

    def _block_of(self, heading: str) -> QTextBlock | None:
        wanted = _anchor(heading)
        block = self.page.document().begin()
        while block.isValid():
            if block.blockFormat().headingLevel() and _anchor(block.text()) == wanted:
                return block
            block = block.next()
        return None

    def _set(self) -> None:
        """Give paragraphs air, code a ground of its own, and pictures the width of the page at most."""
        ground = self.palette().color(QPalette.ColorRole.AlternateBase)
        widest = QTextLength(QTextLength.Type.FixedLength, 680)
        cursor = QTextCursor(self.page.document())
        block = self.page.document().begin()
        while block.isValid():
            cursor.setPosition(block.position())
            form, code = block.blockFormat(), block.blockFormat().hasProperty(_CODE)
            same = code and block.next().blockFormat().hasProperty(_CODE)
            form.setTopMargin(16 if form.headingLevel() else 0)
            form.setBottomMargin(0 if same else 4 if block.textList() else 9)
            if code:
                form.setBackground(ground)
            if cursor.currentTable() is None:
                cursor.setBlockFormat(form)
            pieces = block.begin()
            while not pieces.atEnd():
                piece = pieces.fragment()
                if piece.charFormat().isImageFormat():
                    shape = piece.charFormat().toImageFormat()
                    shape.setMaximumWidth(widest)
                    cursor.setPosition(piece.position())
                    cursor.setPosition(piece.position() + piece.length(), QTextCursor.MoveMode.KeepAnchor)
                    cursor.setCharFormat(shape)
                    break
                pieces += 1
            block = block.next()

    def _follow(self, link: QUrl) -> None:
        if link.scheme() in ("http", "https"):
            QDesktopServices.openUrl(link)
        elif link.path().endswith(".md"):
            self.open_document(link.path(), link.fragment())
        else:
            self.go_to(link.fragment())


def _anchor(heading: str) -> str:
    """Return a heading as links write it: "The paper's method" is the-papers-method."""
    words = "".join(letter for letter in heading.lower() if letter.isalnum() or letter in " -")
    return words.strip().replace(" ", "-")
