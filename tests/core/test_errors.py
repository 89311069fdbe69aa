"""Errors meant for the user are one line, whatever a file put into them."""

import inspect

import pytest

from mbstudio.core import errors


@pytest.mark.parametrize("written", ["a\nb", "a\r\n\tb", "a\x00\x08b", "a\u2028b"])
def test_a_message_is_one_line(written):
    told = str(errors.ScanError(f"s.dcm holds no image ({written}): open the folder of the slices."))
    assert told == "s.dcm holds no image (a b): open the folder of the slices."


def test_every_error_keeps_to_it():
    kinds = [
        kind
        for _, kind in inspect.getmembers(errors, inspect.isclass)
        if issubclass(kind, errors.MbstudioError)
    ]
    assert len(kinds) > 20
    assert all(kind.__str__ is errors.MbstudioError.__str__ for kind in kinds)
