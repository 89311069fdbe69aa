"""One thread inside the block, all threads after it, also where blocks of several threads overlap."""

from __future__ import annotations

import threading

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from mbstudio.core.threads import one_thread


def threads_of_blas():
    import numpy.linalg  # noqa: F401

    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        yield


def test_a_block_has_one_thread_and_gives_back_what_was():
    assert threads_of_blas() == {2}
    with one_thread():
        assert threads_of_blas() == {1}
        with one_thread():
            assert threads_of_blas() == {1}
        assert threads_of_blas() == {1}
    assert threads_of_blas() == {2}


def test_an_error_inside_gives_back_too():
    with pytest.raises(ZeroDivisionError), one_thread():
        raise ZeroDivisionError
    assert threads_of_blas() == {2}


def test_blocks_that_overlap_give_back_when_the_last_ends():
    begun, ended, seen = threading.Event(), threading.Event(), []

    def second():
        with one_thread():
            begun.set()
            ended.wait(30)
            seen.append(threads_of_blas())

    other = threading.Thread(target=second)
    with one_thread():
        other.start()
        assert begun.wait(30)
    seen.append(threads_of_blas())
    ended.set()
    other.join(30)
    assert seen == [{1}, {1}]
    assert threads_of_blas() == {2}


def test_torch_has_one_thread_inside():
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_grains_are_measured_on_one_thread(monkeypatch):
    import numpy as np

    import mbstudio as mb
    from mbstudio.core.metrics import measuring

    found, maximum_projection = [], measuring.maximum_projection

    def watched(*args, **options):
        found.append(threads_of_blas())
        return maximum_projection(*args, **options)

    monkeypatch.setattr(measuring, "maximum_projection", watched)
    mb.measure(mb.Avatar(np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([1.0, 1.0]), "mm"))
    assert found == [{1}]
    assert threads_of_blas() == {2}
