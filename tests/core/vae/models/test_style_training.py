from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.learning_on import learn_on
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import StyleTraining, learn
from mbstudio.core.vae.models.training_step import Losses
from tests.core.vae.populations import population

QUICK: dict[str, Any] = {"steps": 12, "record_every": 3, "batch": 8, "latents": 6, "details": 8}


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def same(one: StyleLearner, other: StyleLearner) -> bool:
    first, second = one.model.tensors(), other.model.tensors()
    return first.keys() == second.keys() and all(np.array_equal(first[key], second[key]) for key in first)


def test_records_say_how_it_goes() -> None:
    training = StyleTraining(population(24), annealed=0.5, **QUICK)
    steps = list(training)
    assert [step.step for step in steps] == [0, 3, 6, 9, 12]
    assert {step.steps for step in steps} == {12}
    # The weight of the last step of each record: steps 2, 5, 8, 11 of a rise over 6.
    assert [step.weight for step in steps] == pytest.approx([0.0, 2 / 6, 5 / 6, 1.0, 1.0])
    for step in steps[1:]:
        assert step.reconstruction + 0.1 * step.weight * step.distribution == pytest.approx(
            step.loss, abs=2.0
        )
        assert 0 < step.held_out < 0.1
        assert step.distribution > 0
    with pytest.raises(StopIteration):
        next(training)


def test_training_lowers_errors() -> None:
    parents = population(60, ways=6)
    training = StyleTraining(parents, steps=150, record_every=50, latents=8)
    steps = list(training)
    assert steps[-1].reconstruction < steps[1].reconstruction
    assert training.result().card.trained_rms < steps[0].held_out


def test_the_best_state_is_kept() -> None:
    training = StyleTraining(population(24), annealed=0.0, **QUICK)
    for made_up in (0.03, 0.02, 0.01, 0.05, 0.04):
        training.trainer.rms = lambda rows, value=made_up: value  # type: ignore[method-assign]
        next(training)
        if made_up == 0.01:
            kept = training.trainer.weights()
    assert [step.best for step in training.history] == [True, True, True, False, False]
    assert training.result().card.steps == 6
    assert training.best_weights is not None
    for name, array in kept.items():
        np.testing.assert_array_equal(training.best_weights[name], array)


def test_states_before_the_full_weight_do_not_count() -> None:
    training = StyleTraining(population(24), annealed=0.5, **QUICK)
    for made_up in (0.001, 0.002, 0.03, 0.02, 0.04):
        training.trainer.rms = lambda rows, value=made_up: value  # type: ignore[method-assign]
        next(training)
    assert training.result().card.steps == 9


@pytest.mark.parametrize("preset", ["aligned", "paper"])
def test_same_seed_same_numbers_whatever_the_threads(preset: str, threads: None) -> None:
    options = QUICK if preset == "aligned" else {"steps": 4, "record_every": 2, "batch": 6}
    torch.set_num_threads(1)
    one = learn(population(24), preset, seed=5, **options)  # type: ignore[arg-type]
    torch.set_num_threads(2)
    two = learn(population(24), preset, seed=5, **options)  # type: ignore[arg-type]
    assert torch.get_num_threads() == 2
    assert same(one, two)
    assert not same(one, learn(population(24), preset, seed=6, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize("preset", ["aligned", "paper", "pca"])
def test_restart_is_as_if_nothing_had_happened(preset: str, tmp_path: Path) -> None:
    options: dict[str, Any] = {"aligned": QUICK, "paper": {"steps": 8, "record_every": 2, "batch": 4}}.get(
        preset, {}
    )
    parents, file = population(24), tmp_path / "training.safetensors"
    whole = StyleTraining(parents, preset, **options)  # type: ignore[arg-type]
    straight = whole.run()
    broken = StyleTraining(parents, preset, checkpoint=file, checkpoint_every=1, **options)  # type: ignore[arg-type]
    for _ in range(min(3, len(whole.history))):
        next(broken)
    del broken  # the process dies here
    again = StyleTraining(parents, preset, checkpoint=file, checkpoint_every=1, **options)  # type: ignore[arg-type]
    assert len(again.history) == min(3, len(whole.history))
    assert same(again.run(), straight)
    assert repr(again.history) == repr(whole.history)  # repr: NaN is NaN
    # Once finished, it is finished.
    assert list(StyleTraining(parents, preset, checkpoint=file, **options)) == []  # type: ignore[arg-type]


def test_checkpoints_of_others_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "training.safetensors"
    StyleTraining(population(24), checkpoint=file, **QUICK).run()
    with pytest.raises(StyleError, match=r"another training.*parents"):
        StyleTraining(population(24, seed=1), checkpoint=file, **QUICK)
    with pytest.raises(StyleError, match=r"another training.*seed"):
        StyleTraining(population(24), seed=1, checkpoint=file, **QUICK)
    content = file.read_bytes()
    for strange in (b"", b"nonsense", content[:-50]):
        file.write_bytes(strange)
        with pytest.raises(StyleError, match=r"training\.safetensors"):
            StyleTraining(population(24), checkpoint=file, **QUICK)


def test_stopping_leaves_a_learner() -> None:
    training = StyleTraining(population(24), **QUICK)
    with pytest.raises(StyleError, match="not begun"):
        training.result()
    next(training)
    next(training)
    training.stop()
    assert list(training) == []
    assert any("Stopped after 3 of 12 steps" in note for note in training.result().card.notes)


def test_numbers_that_are_not_finite_stop_the_training() -> None:
    training = StyleTraining(population(24), **QUICK)
    advance = training.trainer.advance

    def failing(step: int) -> Losses:
        found = advance(step)
        return replace(found, loss=math.nan) if step == 7 else found

    training.trainer.advance = failing  # type: ignore[method-assign]
    steps = list(training)
    assert [step.step for step in steps] == [0, 3, 6, 8]
    assert "not finite" in steps[-1].note or "no longer finite" in steps[-1].note
    kept = training.result()
    assert kept.card.steps <= 6
    assert np.isfinite(kept.latents).all()
    assert any("no longer finite" in note for note in kept.card.notes)


def test_a_full_gpu_hands_over_to_the_processor() -> None:
    training = StyleTraining(population(24), **QUICK)
    advance, fails = training.trainer.advance, [4]

    def full(step: int) -> Losses:
        if step in fails:
            fails.remove(step)
            raise torch.OutOfMemoryError("CUDA out of memory")
        return advance(step)

    moved: list[bool] = []
    training.trainer.advance = full  # type: ignore[method-assign]
    training.trainer.move_to_processor = lambda: moved.append(True) or True  # type: ignore[method-assign,func-returns-value]
    steps = list(training)
    assert moved == [True]
    assert steps[-1].step == 12
    assert "memory of the GPU is full" in steps[2].note
    assert same(training.result(), learn(population(24), **QUICK))


def test_a_full_processor_is_an_error() -> None:
    training = StyleTraining(population(24), **QUICK)

    def full(step: int) -> Losses:
        raise torch.OutOfMemoryError("no memory")

    training.trainer.advance = full  # type: ignore[method-assign]
    next(training)
    with pytest.raises(torch.OutOfMemoryError):
        next(training)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_no_gpu_is_said() -> None:
    with pytest.raises(StyleError, match="no GPU"):
        StyleTraining(population(24), device="cuda", **QUICK)


def test_unknown_options_are_refused() -> None:
    with pytest.raises(StyleError, match="no option 'layers'"):
        StyleTraining(population(24), layers=3)
    with pytest.raises(StyleError, match="no style-learner 'best'"):
        StyleTraining(population(24), "best")  # type: ignore[arg-type]
    with pytest.raises(StyleError, match="batch = 0"):
        StyleTraining(population(24), batch=0)
    with pytest.raises(StyleError, match="no device 'tpu'"):
        StyleTraining(population(24), device="tpu")
    with pytest.raises(StyleError, match="cannot be held out"):
        StyleTraining(population(24), held_out=0.9)


def test_bad_parents_are_refused_by_name() -> None:
    parents = population(24)
    with pytest.raises(StyleError, match="4 parents are too few"):
        StyleTraining(parents.take(range(4)))
    with pytest.raises(StyleError, match="the same avatar"):
        StyleTraining(parents.take([3] * 8))
    sizes = parents.diameters.copy()
    sizes[7] *= 1000.0
    with pytest.raises(StyleError, match=r"'p0-7' has D_n = .* check its unit"):
        StyleTraining(replace(parents, diameters=sizes))
    centers = parents.centers.copy()
    centers[5] *= 1000.0
    with pytest.raises(StyleError, match="'p0-5' has a control point"):
        StyleTraining(replace(parents, centers=centers))


def test_doubtful_parents_are_noted() -> None:
    parents = population(24)
    doubled = parents.take([*range(20), 0, 1])
    doubled = replace(doubled, valid=np.arange(22) > 0)
    notes = learn(doubled, "pca").card.notes
    assert any("2 of 22 parents are copies" in note for note in notes)
    assert any("1 of 22 parents are no valid particles" in note for note in notes)


def test_learning_on_keeps_the_old_and_gets_the_new() -> None:
    # The old vary in three ways, the new in three others besides.
    old, new = population(60, ways=3), population(20, seed=8, ways=6)
    learner = learn(old, steps=150, record_every=50, latents=16)
    further = learn_on(learner, new, steps=240, record_every=80)
    assert [step.step for step in further] == [0, 80, 160, 240]
    found = further.result()
    assert found.parents.names == (*old.names, *new.names)
    assert set(learner.card.held_out) < set(found.card.held_out)
    kept = next(step.step for step in reversed(further.history) if step.best)
    assert kept > 0
    assert found.card.steps == learner.card.steps + kept

    def errors(model: StyleLearner, avatars: Any) -> float:
        return surface_rms(avatars, model.decode(model.encode(avatars)[:, : model.core])).mean()

    assert errors(found, new) < 0.8 * errors(learner, new)
    assert errors(found, old) < 1.4 * errors(learner, old)


@pytest.mark.parametrize("preset", ["pca", "paper"])
def test_learning_on_with_the_other_presets(preset: str) -> None:
    options: dict[str, Any] = {"steps": 2, "batch": 4} if preset == "paper" else {}
    learner = learn(population(12), preset, **options)  # type: ignore[arg-type]
    found = learn_on(learner, replace(population(3, seed=8), unit="m"), **options).run()
    assert len(found.parents) == 15
    # A metre in a learner of millimetres.
    np.testing.assert_allclose(found.parents.diameters[12:], 1000.0 * population(3, seed=8).diameters)


def test_learning_on_refuses_what_does_not_fit() -> None:
    learner = learn(population(12), "pca")
    with pytest.raises(StyleError, match="no new parents"):
        learn_on(learner, population(12).take([]))
    with pytest.raises(StyleError, match="n = 24"):
        learn_on(learner, population(5, generators=3))
