from __future__ import annotations

import hashlib
import io
import json

import pytest

from mbstudio.core.sealing import (
    HEADER_BYTES,
    BrokenSealError,
    check_json,
    check_seal,
    read_seal,
    seal_image,
    seal_json,
)


def sealed(length: int = 3000) -> bytes:
    image = bytearray(bytes(HEADER_BYTES) + bytes(i % 251 for i in range(length)))
    seal_image(image)
    return bytes(image)


def test_a_seal_is_the_digest_of_what_follows_and_of_the_header_itself():
    content = sealed()
    seal = read_seal(content[:HEADER_BYTES])
    check_seal(io.BytesIO(content), seal)
    assert hashlib.sha256(content[HEADER_BYTES:]).hexdigest() == seal.digest
    blank = content[:HEADER_BYTES].replace(seal.header.encode(), b"0" * 64)
    assert hashlib.sha256(blank).hexdigest() == seal.header
    assert content[HEADER_BYTES:] == bytes(i % 251 for i in range(3000))


def test_no_bit_flips_unseen():
    content = sealed(40)
    for bit in range(8 * len(content)):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        seal = read_seal(bytes(changed[:HEADER_BYTES]))
        if seal is not None:
            with pytest.raises(BrokenSealError):
                check_seal(io.BytesIO(changed), seal)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda content: content[:-1], "its end is missing"),
        (lambda content: content + b"\0", "bytes were added"),
        (lambda content: content[:600] + content[601:602] + content[601:], "not those that were written"),
    ],
)
def test_what_differs_is_told(change, told):
    content = change(sealed())
    with pytest.raises(BrokenSealError, match=told):
        check_seal(io.BytesIO(content), read_seal(content[:HEADER_BYTES]))


@pytest.mark.parametrize("head", [b"", b"\0" * HEADER_BYTES, b"\x89HDF\r\n\x1a\n" + bytes(504), b"hello"])
def test_other_files_have_no_seal(head):
    assert read_seal(head) is None


def test_json_carries_its_seal():
    content = seal_json({"name": "µ", "numbers": [1, 0.1 + 0.2]})
    assert check_json(content)
    told = json.loads(content)
    assert (told["name"], told["numbers"]) == ("µ", [1, 0.1 + 0.2])


def test_no_bit_of_json_flips_unseen():
    """A flip in the name of the seal unseals the file, and changes nothing that is read."""
    content = seal_json({"name": "sand", "volume": 1.5})
    for bit in range(8 * len(content)):
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << bit % 8
        try:
            if not check_json(bytes(changed)):
                told = json.loads(changed)
                assert (told["name"], told["volume"]) == ("sand", 1.5)
        except ValueError:
            continue


def test_json_without_a_seal_is_of_earlier():
    assert not check_json(b'{"name": "sand"}')
    assert not check_json(b"no JSON")
