"""The registry of presets: every entry under its own name, found without what it takes to train."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.presets import PRESETS, find_preset, recommended_preset


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_known_by_the_name_of_its_model(name):
    preset = find_preset(name)
    assert preset.name == preset.model.preset == name
    assert preset.title
    assert preset.summary.endswith(".")
    options = preset.options()
    assert 0 <= options.held_out <= 0.5
    assert hasattr(options, "steps") is preset.in_steps
    assert preset.learning_on.keys() <= vars(options).keys()


def test_an_unknown_preset_is_refused_with_those_that_there_are():
    with pytest.raises(StyleError, match="'best': use one of aligned, pca, paper"):
        find_preset("best")


def test_few_parents_are_for_principal_components():
    assert [recommended_preset(count).name for count in (5, 49)] == ["pca", "pca"]
    assert [recommended_preset(count).name for count in (50, 1000)] == ["aligned", "aligned"]


def test_a_trained_model_can_be_read_without_torch():
    script = (
        "import sys\n"
        "from mbstudio.core.vae.models.presets import PRESETS, find_preset\n"
        "from mbstudio.core.vae.models.style_learner import load_style_learner\n"
        "for name in PRESETS: find_preset(name)\n"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "False", done.stderr
