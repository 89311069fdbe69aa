"""Symbols are written in one way wherever they are read."""

from __future__ import annotations

import re
from io import StringIO
from pathlib import Path
from tokenize import STRING, generate_tokens

import mbstudio.ui


def test_no_text_of_the_window_writes_diameters_in_ascii():
    folder = Path(mbstudio.ui.__file__).parent
    found = []
    for path in sorted(folder.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        for token in generate_tokens(StringIO(source).readline):
            told = token.type == STRING and not token.string.startswith('"""')
            if told and re.search(r"\bD_(n|s|ns)\b", token.string):
                found.append(f"{path.name}:{token.start[0]}: {token.string}")
    assert found == []
