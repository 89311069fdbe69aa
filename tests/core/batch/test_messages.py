"""What goes through a pipe comes out as it went in; a broken pipe is noticed."""

from __future__ import annotations

import io

import numpy as np
import pytest

from mbstudio.core.batch.messages import receive, send


def test_heads_and_arrays_come_out_as_they_went_in():
    pipe = io.BytesIO()
    arrays = {
        "third": np.asarray([1 / 3, np.nan, np.inf]),
        "turned": np.arange(12, dtype=np.int16).reshape(3, 4).T,
        "empty": np.zeros((0, 3)),
    }
    send(pipe, {"ratio": 0.1 + 0.2, "count": np.int64(7), "name": "Körnchen"}, arrays)
    send(pipe, {"second": True})
    pipe.seek(0)
    head, received = receive(pipe)
    assert head == {"ratio": 0.1 + 0.2, "count": 7, "name": "Körnchen"}
    assert received.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(received[name], array)
        assert received[name].dtype == array.dtype
    assert receive(pipe) == ({"second": True}, {})


@pytest.mark.parametrize("kept", [0, 5, 60, -1])
def test_half_a_message_is_no_message(kept):
    pipe = io.BytesIO()
    send(pipe, {"a": 1}, {"b": np.arange(20)})
    with pytest.raises(EOFError):
        receive(io.BytesIO(pipe.getvalue()[:kept]))


def test_objects_are_refused():
    with pytest.raises(TypeError, match="another process"):
        send(io.BytesIO(), {"a": object()})
