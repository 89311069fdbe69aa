"""Work that is begun again goes on where it was ended, and uses nothing that it should not."""

from __future__ import annotations

import errno
import warnings

import numpy as np
import pytest
import trimesh

from mbstudio.core.batch import kept_answers
from mbstudio.core.batch.kept_answers import KeptAnswers, keeping_answers, question_of
from mbstudio.core.batch.pool import WorkerPool
from mbstudio.core.errors import Cancelled, FitError
from mbstudio.core.journal_file import JournalWriter, read_journal
from mbstudio.core.vae.serialize.serializer import serialize
from tests.core.batch.square_job import CountedJob


@pytest.fixture
def path(tmp_path):
    return tmp_path / "out.unfinished"


def run(path, tasks, size=0, after=None):
    """Return results and which tasks were worked on; stop after so many."""
    job = CountedJob()
    done = []

    def tell(task, result):
        done.append(result)
        if len(done) == after:
            raise Cancelled("enough")

    try:
        with keeping_answers(path):
            return WorkerPool(job, size).map(tasks, tell), CountedJob.worked()
    except Cancelled:
        return done, CountedJob.worked()


@pytest.fixture(autouse=True)
def _counted(tmp_path, monkeypatch):
    monkeypatch.setenv("MBSTUDIO_TEST_COUNT", str(tmp_path / "count"))


@pytest.mark.parametrize("size", [0, 2])
def test_what_was_done_is_not_done_again(path, size):
    tasks = list(range(10))
    first, worked = run(path, tasks, size, after=4)
    assert len(first) == 4
    assert path.exists()
    results, again = run(path, tasks, size)
    assert results == [n * n for n in tasks]
    assert len(again) <= 10 - 4
    assert not set(again) & set(worked[:4]) or size
    assert not path.exists(), "the output holds it all"
    assert run(path, tasks)[1] == tasks


def test_other_questions_are_not_answered_by_them(path):
    run(path, [3, 4, 5], after=2)
    results, worked = run(path, [13, 4, 14], after=3)
    assert results == [169, 16, 196]
    assert worked == [13, 14]


def test_questions_differ_by_job_head_arrays_and_their_kinds():
    array = np.arange(6.0)
    questions = [
        question_of(job, (head, {name: values}))
        for job in (CountedJob, KeptAnswers)
        for head in ({"number": 1}, {"number": 2})
        for name, values in (
            ("a", array),
            ("b", array),
            ("a", array.reshape(2, 3)),
            ("a", array.astype("f4")),
        )
    ]
    assert len(set(questions)) == len(questions)


def test_answers_of_others_are_not_used(path, monkeypatch):
    run(path, [3, 4], after=1)
    whole = path.read_bytes()
    # Without the mark of this person.
    with monkeypatch.context() as patch:
        patch.setattr(kept_answers, "is_own", lambda *_: False)
        assert run(path, [3, 4], after=2)[1] == [3, 4]
    # Of another version.
    path.write_bytes(whole)
    records = [record.content for record in read_journal(path).records]
    JournalWriter.create(path, b'{"kind": "answers", "written_by": "0.0.1"}', records).close()
    assert run(path, [3, 4], after=2)[1] == [3, 4]
    path.write_bytes(b"something else")
    assert run(path, [3, 4])[0] == [9, 16]


def test_no_flipped_bit_gives_another_answer(path, rng):
    run(path, [3, 4, 5], after=3)
    whole = path.read_bytes()
    for bit in rng.integers(8 * len(whole), size=60).tolist():
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        assert run(path, [3, 4, 5])[0] == [9, 16, 25]


def test_a_second_run_at_the_same_time_keeps_nothing(path):
    with keeping_answers(path) as first:
        assert first is not None
        with keeping_answers(path) as second:
            assert second is None
            assert WorkerPool(CountedJob(), 0).map([3]) == [9]
        assert path.exists()


def end_with(path, error):
    with keeping_answers(path):
        WorkerPool(CountedJob(), 0).map([3])
        raise error


def test_work_that_is_refused_leaves_nothing(path):
    for error, stays in ((FitError("no"), False), (Cancelled("enough"), True), (KeyboardInterrupt(), True)):
        with pytest.raises(type(error)):
            end_with(path, error)
        assert path.exists() is stays
        path.unlink(missing_ok=True)
    with pytest.raises(FitError), keeping_answers(path):
        raise FitError("the disk is full") from OSError(errno.ENOSPC, "No space left on device")
    assert path.exists()


def test_where_nothing_can_be_kept_the_work_is_done(tmp_path, path, monkeypatch):
    with keeping_answers(tmp_path / "no folder" / "out") as kept:
        assert kept is None
        assert WorkerPool(CountedJob(), 0).map([3]) == [9]

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(JournalWriter, "append", full)
    with keeping_answers(path) as kept:
        assert WorkerPool(CountedJob(), 0).map([3, 4]) == [9, 16]
    assert kept.trouble.errno == errno.ENOSPC


def test_serialized_bodies_are_the_same_with_kept_answers(path, rng):
    bodies = [trimesh.creation.box(extents=rng.uniform(1, 2, 3)) for _ in range(5)]
    for body in bodies:
        body.units = "mm"

    def found():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return serialize(bodies, 8)

    plain = found()
    for stays in (True, False):
        with keeping_answers(path) as kept:
            kept.stays = stays
            again = found()
        np.testing.assert_array_equal(plain.centers, again.centers)
        np.testing.assert_array_equal(plain.log_weights, again.log_weights)
        np.testing.assert_array_equal(plain.rms, again.rms)
        assert (kept.found > 5) is not stays
