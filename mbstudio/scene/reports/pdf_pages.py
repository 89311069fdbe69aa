"""Blocks of a report on pages of A4, as PDF, drawn by matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.replacement import replacing
from mbstudio.scene.reports.blocks import Block, Facts, Heading, Paragraph, Picture, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 8.27, 11.69  # inches of A4
_LEFT, _TOP, _BOTTOM = 0.75, 0.75, 0.7
_INK, _GREY, _LINE = "#26313b", "#5d6974", "#c9d1d8"
_LEADING = 1.42
_PER_POINT = 1 / 72
_FONT = ["DejaVu Sans"]  # the one that matplotlib brings: the same pages everywhere
_MEAN_WIDTH = 0.56
"""Mean width of a letter of that font over its size."""
_FIGURE_DPI = 170
_MOST_ROWS = 2000


class PdfPages:
    """Puts blocks on pages, one below the other.

    Parameters
    ----------
    title : str
        At the foot of every page.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self.pages: list[Figure] = []
        self._y = 0.0
        self._turn()

    def add(self, block: Block) -> None:
        """Put a block below the others, on a page of its own where there is no room."""
        match block:
            case Heading(words):
                self._room(1.1)
                self._y -= 0.14
                self.write(words, 12.5, weight="bold")
                self._rule()
            case Paragraph(words):
                self.write(words, 8.6)
                self._y -= 0.06
            case Facts(rows):
                for name, value in rows.items():
                    self._fact(name, value)
                self._y -= 0.06
            case Table():
                self._table(block)
            case Picture(figure, caption):
                self._picture(figure, caption)

    def write(self, words: str, size: float, *, weight: str = "normal", colour: str = _INK) -> None:
        """Write a text over the width of the page."""
        for line in self._wrap(words, size, WIDTH - 2 * _LEFT, weight):
            self._room(size * _LEADING * _PER_POINT)
            self._y -= size * _LEADING * _PER_POINT
            self._text(_LEFT, line, size, weight=weight, color=colour)

    def sign(self, *words: str) -> None:
        """Draw a line to be filled in for each word, side by side."""
        from matplotlib.lines import Line2D

        self._room(0.8)
        self._y -= 0.55
        width = (WIDTH - 2 * _LEFT) / len(words)
        for place in range(len(words)):
            left = _LEFT + place * width
            ends = [left / WIDTH, (left + 0.9 * width) / WIDTH]
            self.pages[-1].add_artist(Line2D(ends, [self._y / HEIGHT] * 2, color=_GREY, linewidth=0.7))
        self._y -= 0.15
        for place, word in enumerate(words):
            self._text(_LEFT + place * width, word, 7.6, color=_GREY)

    def gap(self, height: float = 0.12) -> None:
        """Leave room, in inches."""
        self._y -= height

    def save(self, path: Path, metadata: dict[str, Any]) -> Path:
        """Write the pages; the file takes its place when it is complete.

        The same pages give the same file: it carries no date.
        """
        from matplotlib import rc_context
        from matplotlib.backends.backend_pdf import PdfPages as Writer

        for number, page in enumerate(self.pages, 1):
            page.text(
                1 - _LEFT / WIDTH, 0.38 / HEIGHT, f"{number} / {len(self.pages)}", fontsize=7, color=_GREY,
                ha="right", family=_FONT,
            )  # fmt: skip
        with (
            replacing(path) as temporary,
            rc_context({"pdf.fonttype": 42}),
            Writer(temporary, metadata={"CreationDate": None, **metadata}) as writer,
        ):
            for page in self.pages:
                writer.savefig(page)
        return path

    # ---- on the page ---------------------------------------------------------------------------

    def _turn(self) -> None:
        from matplotlib.figure import Figure as Page

        page = Page(figsize=(WIDTH, HEIGHT), facecolor="white")
        page.text(_LEFT / WIDTH, 0.38 / HEIGHT, self._title, fontsize=7, color=_GREY, family=_FONT)
        self.pages.append(page)
        self._y = HEIGHT - _TOP

    def _room(self, height: float) -> None:
        if self._y - height < _BOTTOM:
            self._turn()

    def _text(self, x: float, words: str, size: float, **how: Any) -> None:
        # A dollar sign is a dollar sign, not mathematics.
        self.pages[-1].text(
            x / WIDTH, self._y / HEIGHT, words, fontsize=size, family=_FONT, parse_math=False, **how
        )

    def _rule(self, colour: str = _LINE, width: float = 0.6, drop: float = 0.06) -> None:
        from matplotlib.lines import Line2D

        self._y -= drop
        across = [_LEFT / WIDTH, 1 - _LEFT / WIDTH]
        self.pages[-1].add_artist(Line2D(across, [self._y / HEIGHT] * 2, color=colour, linewidth=width))

    def _wrap(self, words: str, size: float, width: float, weight: str = "normal") -> list[str]:
        letters = width / (size * _PER_POINT * _MEAN_WIDTH * (1.14 if weight == "bold" else 1.0))
        return textwrap.wrap(words, max(4, int(letters))) or [""]

    def _fact(self, name: str, value: str) -> None:
        size, left = 8.2, 1.75
        names = self._wrap(name, size, left - 0.1)
        lines = self._wrap(value, size, WIDTH - 2 * _LEFT - left)
        step = size * _LEADING * _PER_POINT
        self._room(step * min(max(len(lines), len(names)), 6))
        for place in range(max(len(names), len(lines))):
            self._room(step)
            self._y -= step
            if place < len(names):
                self._text(_LEFT, names[place], size, color=_GREY)
            if place < len(lines):
                self._text(_LEFT + left, lines[place], size, color=_INK)

    def _table(self, table: Table) -> None:
        columns, rows = list(table.columns), [list(row) for row in table.rows[:_MOST_ROWS]]
        width = WIDTH - 2 * _LEFT
        cells = list(zip(*rows, strict=True)) if rows else [()] * len(columns)
        longest = np.array(
            [
                max([len(cell) for cell in column] + [_longest_word(head)])
                for head, column in zip(columns, cells, strict=True)
            ],
            dtype=float,
        )
        longest += 2.0
        if table.words:
            longest[-1] = min(longest[-1], 70)
        longest[0] = min(longest[0], 46)
        size = float(np.clip(width / (longest.sum() * _MEAN_WIDTH * _PER_POINT), 4.6, 7.8))
        edges = _LEFT + np.concatenate([[0.0], np.cumsum(longest)]) / longest.sum() * width
        self._row(columns, edges, size, table.words, weight="bold", least=3)
        self._rule("#8d98a3", 0.8)
        for row in rows:
            before = len(self.pages)
            self._row(row, edges, size, table.words)
            if len(self.pages) > before and row is not rows[-1]:
                continue
        if len(table.rows) > _MOST_ROWS:
            self.write(f"… and {len(table.rows) - _MOST_ROWS} more", 7.5, colour=_GREY)
        self._y -= 0.1

    def _row(
        self, cells: Sequence[str], edges: np.ndarray, size: float, words: bool, *, weight: str = "normal",
        least: int = 1,
    ) -> None:  # fmt: skip
        wrapped = [
            self._wrap(cell, size, float(edges[place + 1] - edges[place]), weight)
            for place, cell in enumerate(cells)
        ]
        step = size * 1.5 * _PER_POINT
        lines = max(map(len, wrapped))
        self._room(step * (min(lines, 12) + (least if weight == "bold" else 0)))
        for line in range(lines):
            self._room(step)
            self._y -= step
            for place, cell in enumerate(wrapped):
                if line >= len(cell):
                    continue
                is_left = place == 0 or (words and place == len(cells) - 1)
                x = float(edges[place]) if is_left else float(edges[place + 1]) - 0.04
                if is_left and place:
                    x += 0.1
                self._text(x, cell[line], size, weight=weight, color=_INK, ha="left" if is_left else "right")

    def _picture(self, figure: Figure, caption: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        wide, high = figure.get_size_inches()
        width = min(WIDTH - 2 * _LEFT, float(wide))
        height = float(high) * width / float(wide)
        if height > 7.6:
            width, height = width * 7.6 / height, 7.6
        self._room(height + 0.5)
        dpi = figure.get_dpi()
        canvas = FigureCanvasAgg(figure)
        figure.set_dpi(_FIGURE_DPI * width / float(wide) * 1.15)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())
        figure.set_dpi(dpi)
        self._y -= height
        axes = self.pages[-1].add_axes((_LEFT / WIDTH, self._y / HEIGHT, width / WIDTH, height / HEIGHT))
        axes.imshow(pixels, aspect="auto", interpolation="lanczos")
        axes.set_axis_off()
        self.write(caption, 7.6, colour=_GREY)
        self._y -= 0.12


def _longest_word(words: str) -> int:
    return max((len(word) for word in words.split()), default=0)


def write_pdf(
    path: Path,
    title: str,
    lead: str,
    blocks: Sequence[Block],
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write blocks as PDF on pages of A4.

    Parameters
    ----------
    path : Path
    title, lead : str
        At the head of the first page.
    blocks : sequence of Block
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work and leaves what was there.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    pages = PdfPages(title)
    pages.write(title, 17, weight="bold")
    pages.gap(0.04)
    pages.write(lead, 9.5, colour=_GREY)
    for place, block in enumerate(blocks):
        pages.add(block)
        if progress is not None:
            progress((place + 1) / (len(blocks) + 1), "pages")
    return pages.save(path, {"Title": title, "Creator": "mbstudio"})
