"""Text of headers and side-cars, in whichever encoding a program wrote it."""

from __future__ import annotations


def plain_text(content: bytes) -> str:
    """Return bytes as text: by their byte-order mark, as UTF-8 if they are, else as Latin-1."""
    for mark, codec in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if content.startswith(mark):
            return content.decode(codec, errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def one_line(error: BaseException) -> str:
    """Return what an error says, without the line breaks that some libraries put into it."""
    return " ".join(str(error).split())
