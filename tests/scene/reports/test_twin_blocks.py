"""The section of a report on the twin."""

from __future__ import annotations

from dataclasses import replace

from mbstudio.scene.reports.blocks import Picture, html_of
from mbstudio.scene.reports.twin_blocks import twin_blocks
from tests.core.project.test_twin_table import made_twin


def test_a_report_tells_fit_contacts_and_porosity():
    twin = made_twin((1, 2, 3))
    blocks = twin_blocks(twin)
    page = "".join(html_of(block) for block in blocks)
    for words in (
        "misfit 8.00 %",
        "4.00 % after 2 sweeps",
        "2, and 0 near misses",
        "40.00 %",
        "Look.",
        "data:image",
    ):
        assert words in page, words
    apart = twin_blocks(replace(twin, contacts=twin.contacts.assign(probability=0.1)))
    assert not any(isinstance(block, Picture) for block in apart)
    assert "0, and 2 near misses" in "".join(html_of(block) for block in apart)
