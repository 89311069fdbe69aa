"""What a report is made of: headings, paragraphs, facts, tables and figures, before they are HTML or PDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbstudio.scene.reports import report_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Heading:
    """The heading of a section."""

    words: str


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of plain text."""

    words: str


@dataclass(frozen=True)
class Facts:
    """Names and what they are."""

    rows: Mapping[str, str]


@dataclass(frozen=True)
class Table:
    """A table of plain text.

    Attributes
    ----------
    columns : sequence of str
    rows : sequence of sequence of str
    words : bool
        Whether the last column is text to be read, not a number.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: bool = False


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure with what it shows."""

    figure: Figure
    caption: str


Block = Heading | Paragraph | Facts | Table | Picture


def html_of(block: Block) -> str:
    """Return a block as HTML."""
    match block:
        case Heading(words):
            return report_page.heading(words)
        case Paragraph(words):
            return report_page.paragraph(words)
        case Facts(rows):
            return report_page.facts(rows)
        case Table(columns, rows, words):
            return report_page.table(columns, rows, words=words)
        case Picture(figure, caption):
            return report_page.picture(figure, caption)
