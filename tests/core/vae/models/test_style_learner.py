from __future__ import annotations

import json
import warnings
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.errors import StyleError, StyleWarning
from mbstudio.core.sealing import seal_json
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.style_learner import FOLDER, StyleLearner, load_style_learner
from mbstudio.core.vae.models.training import learn
from tests.core.vae.populations import population

SHORT = {
    "pca": {},
    "aligned": {"steps": 30, "record_every": 15, "batch": 16, "details": 12, "latents": 8},
    "paper": {"steps": 4, "record_every": 2, "batch": 4, "length_unit": 100.0},
}


@pytest.fixture(scope="module", params=list(SHORT))
def learner(request: pytest.FixtureRequest) -> StyleLearner:
    return learn(population(24), request.param, **SHORT[request.param])


@pytest.fixture(scope="module")
def aligned() -> StyleLearner:
    return learn(population(24), "aligned", **SHORT["aligned"])


def arrays(learner: StyleLearner) -> list[np.ndarray]:
    sample = learner.sample(5, seed=3)
    return [
        learner.latents,
        learner.encode(learner.parents),
        learner.decode(learner.latents).centers,
        sample.serialization.log_weights,
        sample.serialization.diameters,
        sample.latents,
        sample.parents,
    ]


def test_saved_and_loaded_it_is_the_same(learner: StyleLearner, tmp_path: Path) -> None:
    learner = learner.with_quality({"valid": 0.99, "errors": [0.1, float("nan")]})
    again = load_style_learner(learner.save(tmp_path / "sand"))
    for one, other in zip(arrays(learner), arrays(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.card.as_dict() == learner.card.as_dict()
    assert again.card.quality == {"valid": 0.99, "errors": [0.1, None]}
    assert (again.preset, again.unit, again.core) == (learner.preset, learner.unit, learner.core)
    np.testing.assert_array_equal(again.parents.centers, learner.parents.centers)
    files = sorted(path.name for path in (tmp_path / "sand").iterdir())
    assert len(files) == 2
    assert files[1] == "style-learner.json"


def test_new_bodies_can_be_serialized_as_softly_as_the_parents(tmp_path: Path) -> None:
    parents = population(12)
    soft = replace(parents, template=replace(parents.template, stiffness=np.diag(np.arange(1.0, 65.0))))
    again = load_style_learner(learn(soft, "pca").save(tmp_path / "soft"))
    np.testing.assert_array_equal(again.template.stiffness, np.diag(np.arange(1.0, 65.0)))
    np.testing.assert_array_equal(again.parents.template.stiffness, again.template.stiffness)


def test_card_says_what_it_was_trained_on(learner: StyleLearner) -> None:
    card, parents = learner.card, learner.parents
    assert (card.names, card.count, card.unit, card.n, card.seed) == (parents.names, 24, "mm", 16, 0)
    assert card.smallest == parents.diameters.min()
    assert card.largest == parents.diameters.max()
    assert len(card.held_out) == 2
    assert set(card.held_out) < set(parents.names)
    assert card.parents_rms == pytest.approx(0.004)
    assert 0 < card.held_out_rms < 0.2
    assert "mbstudio" in card.versions
    assert any("literally" in note for note in card.notes) == (learner.preset == "paper")
    assert any("fewer than 50 parents" in note for note in card.notes) == (learner.preset == "aligned")


def test_sample_follows_seed(learner: StyleLearner) -> None:
    first, again, other = learner.sample(6, seed=1), learner.sample(6, seed=1), learner.sample(6, seed=2)
    np.testing.assert_array_equal(first.serialization.centers, again.serialization.centers)
    assert not np.array_equal(first.latents, other.latents)
    assert len(first.serialization) == 6
    assert len(learner.sample(0).serialization) == 0
    assert first.serialization.unit == "mm"
    assert np.isnan(first.serialization.rms).all()


def test_wrong_latents_are_refused(learner: StyleLearner) -> None:
    with pytest.raises(StyleError, match="cannot be decoded"):
        learner.decode(np.zeros((2, learner.dimension + 1)))
    with pytest.raises(StyleError, match="not finite"):
        learner.decode(np.full((1, learner.dimension), np.nan))


def test_foreign_avatars_are_refused(learner: StyleLearner) -> None:
    with pytest.raises(StyleError, match="n = 24"):
        learner.encode(population(5, generators=3))


@pytest.mark.parametrize("preset", ["pca", "aligned"])
@pytest.mark.parametrize("flip", [1, 6])
def test_a_flipped_avatar_has_flipped_signs(preset: str, flip: int) -> None:
    learner = learn(population(24), preset, **SHORT[preset])
    flipped = learner.parents.flipped(np.full(24, flip))
    assert learner.signs is not None
    np.testing.assert_allclose(learner.encode(flipped), learner.latents * learner.signs[flip], atol=1e-7)
    decoded = learner.decode(learner.latents * learner.signs[flip])
    mirrored = learner.decode(learner.latents).flipped(np.full(24, flip))
    np.testing.assert_allclose(decoded.centers, mirrored.centers, atol=1e-9)
    np.testing.assert_allclose(decoded.diameters, mirrored.diameters, rtol=1e-9)


def test_units_do_not_matter_to_the_code(aligned: StyleLearner) -> None:
    in_um = replace(aligned.parents, unit="um", diameters=aligned.parents.diameters * 1000.0)
    np.testing.assert_allclose(aligned.encode(in_um), aligned.latents, atol=1e-6)


def test_all_components_give_the_parents_back() -> None:
    parents = population(24)
    learner = learn(parents, "pca")
    # Four ways of change in eight flips, the size besides: no more than 4 * 8 + 1 components.
    assert learner.core <= 33
    np.testing.assert_allclose(learner.decode(learner.latents).centers, parents.centers, atol=1e-6)
    np.testing.assert_allclose(learner.decode(learner.latents).diameters, parents.diameters, rtol=1e-6)


def test_details_bring_the_parents_nearer(aligned: StyleLearner) -> None:
    whole = surface_rms(aligned.parents, aligned.decode(aligned.latents))
    plain = surface_rms(aligned.parents, aligned.decode(aligned.latents[:, : aligned.core]))
    assert whole.mean() < 0.7 * plain.mean()
    np.testing.assert_allclose(plain.mean(), np.mean(plain))


def damaged(folder: Path, **changes: object) -> Path:
    """Change the card of a style-learner and seal it anew, as a stranger would do it."""
    card = folder / "style-learner.json"
    card.write_bytes(seal_json(json.loads(card.read_text()) | changes))
    return folder


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("flips", [300, pytest.param(5_000, marks=pytest.mark.full)])
def test_no_flipped_bit_changes_a_style_unseen(
    aligned: StyleLearner, tmp_path: Path, rng: np.random.Generator, flips: int
) -> None:
    """Each is told, or changes nothing: only the name of the seal itself may lose a letter."""
    folder = aligned.save(tmp_path / "sand")
    files = sorted(folder.iterdir())
    before = FOLDER.read_card(folder)
    unseen = 0
    for _ in range(flips):
        path = files[rng.integers(len(files))]
        whole = path.read_bytes()
        changed = bytearray(whole)
        bit = int(rng.integers(8 * len(whole)))
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StyleWarning)  # a letter of the name of the seal
            try:
                entries = FOLDER.read_card(folder)
            except StyleError:
                entries = {}
        weights = folder / str(entries.get("weights", ""))
        if entries and sha256(weights.read_bytes()).hexdigest() == entries["sha256"]:
            assert [value for value in entries.values() if value not in before.values()] == []
            unseen += 1
        path.write_bytes(whole)
    print(f"{flips} flips, {unseen} of them changed nothing")
    assert unseen <= flips / 50
    load_style_learner(folder)


def test_a_style_of_before_seals_is_read(aligned: StyleLearner, tmp_path: Path) -> None:
    folder = aligned.save(tmp_path / "sand")
    card = folder / "style-learner.json"
    entries = json.loads(card.read_text())
    del entries["seal"]
    card.write_text(json.dumps(entries))
    with pytest.warns(StyleWarning, match=r"style-learner\.json carries no digest"):
        again = load_style_learner(folder)
    np.testing.assert_array_equal(again.latents, aligned.latents)
    again.save(folder)
    load_style_learner(folder)  # without a warning: it is sealed by now


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": 2}, "newer mbstudio"),
        ({"format": "one"}, "does not say its format"),
        ({"kind": "something else"}, "not a style-learner"),
        ({"sha256": "0" * 64}, "not the file that style-learner.json was written with"),
        ({"preset": "magic"}, "no style-learner 'magic'"),
        ({"n": 17}, "do not belong together"),
        ({"model": {}}, "incomplete"),
        ({"card": {}}, "model card is incomplete"),
        ({"weights": "../../etc/passwd"}, "cannot be read"),
    ],
)
def test_strange_cards_are_refused(
    aligned: StyleLearner, tmp_path: Path, changes: dict[str, object], words: str
) -> None:
    folder = damaged(aligned.save(tmp_path / "sand"), **changes)
    with pytest.raises(StyleError, match=words) as caught:
        load_style_learner(folder)
    assert str(folder) in str(caught.value)


def test_truncated_and_foreign_weights_are_refused(aligned: StyleLearner, tmp_path: Path) -> None:
    folder = aligned.save(tmp_path / "sand")
    weights = next(folder.glob("*.safetensors"))
    content = weights.read_bytes()
    weights.write_bytes(content[:-100])
    with pytest.raises(StyleError, match=weights.name):
        load_style_learner(folder)
    # A stranger that bothers to give the right digest.
    for strange in (b"", b"not a tensor", content[:-100]):
        weights.write_bytes(strange)
        damaged(folder, sha256=sha256(strange).hexdigest())
        with pytest.raises(StyleError, match=weights.name):
            load_style_learner(folder)
    weights.unlink()
    with pytest.raises(StyleError, match=weights.name):
        load_style_learner(folder)
    (folder / "style-learner.json").write_bytes(b"\x80\x04pickle")
    with pytest.raises(StyleError, match="damaged or no JSON"):
        load_style_learner(folder)
    with pytest.raises(StyleError, match="nowhere"):
        load_style_learner(tmp_path / "nowhere")


def test_weights_that_are_not_finite_are_refused(aligned: StyleLearner, tmp_path: Path) -> None:
    from safetensors.numpy import load, save

    folder = aligned.save(tmp_path / "sand")
    weights = next(folder.glob("*.safetensors"))
    tensors = {name: array.copy() for name, array in load(weights.read_bytes()).items()}
    tensors["model.decoder.mean"][0] = np.nan
    content = save(tensors)
    weights.write_bytes(content)
    damaged(folder, sha256=sha256(content).hexdigest())
    with pytest.raises(StyleError, match=r"not finite in 'model\.decoder\.mean'"):
        load_style_learner(folder)


def test_a_folder_that_cannot_be_written(aligned: StyleLearner, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StyleError, match="cannot be written"):
        aligned.save(tmp_path / "file" / "sand")
