"""Buttons of the pages do what their commands do, and are enabled as these are."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

from PySide6.QtCore import Qt

BUTTONS = {
    "style.panel.learn.learn_button": "style.learn",
    "style.panel.learn.on_button": "style.learn_on",
    "style.panel.learn.pause_button": "style.pause",
    "style.panel.learn.stop_button": "style.stop",
    "style.panel.learn.cancel_button": "style.cancel",
    "style.panel.learn.open_button": "style.open",
    "style.panel.learn.save_button": "style.save",
    "style.panel.generate.generate_button": "style.generate",
    "style.panel.generate.cancel_button": "style.cancel_clones",
    "style.panel.generate.report_button": "style.report",
    "style.panel.generate.populations_button": "style.compare",
    "style.panel.generate.export_button": "style.export",
    "fit.sweep_dock.start_button": "fit.start_sweep",
    "fit.sweep_dock.cancel_button": "fit.cancel_sweep",
    "fit.sweep_dock.use_button": "fit.use_n",
    "latent.dock.blend.play": "latent.play",
    "latent.dock.blend.animation": "latent.animation",
    "latent.dock.blend.apply": "latent.add",
    "export.panel.export_button": "export.run",
}


def test_a_button_is_enabled_as_its_command_and_runs_it(window, qtbot):
    allowed, ran = set(), []
    for command in BUTTONS.values():
        action = window.commands.action(command)
        action.triggered.disconnect()
        action.triggered.connect(lambda _checked=False, command=command: ran.append(command))
        window.commands._commands[command] = replace(
            window.commands._commands[command], enabled=lambda command=command: command in allowed
        )
    for path, command in BUTTONS.items():
        button = attrgetter(path)(window.stations)
        for is_allowed in (False, True, False):
            (allowed.add if is_allowed else allowed.discard)(command)
            window.commands.refresh()
            assert button.isEnabled() is is_allowed, path
            ran.clear()
            qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
            assert ran == ([command] if is_allowed else []), path


def test_a_switch_shows_what_its_command_says_and_not_how_often_it_was_pressed(window):
    action, play = window.commands.action("latent.play"), window.stations.latent.dock.blend.play
    is_on = []
    action.triggered.disconnect()
    action.triggered.connect(lambda checked: is_on.append(checked))
    window.commands._commands["latent.play"] = replace(
        window.commands._commands["latent.play"], enabled=lambda: True, checked=lambda: is_on == [True]
    )
    window.commands.refresh()
    for expected in ([True], [True, False]):
        play.click()
        assert is_on == expected
        assert play.isChecked() is expected[-1]
    # Nothing is switched on any more, whoever switched it off.
    is_on[:] = [True]
    window.commands.refresh()
    assert play.isChecked()
    is_on.clear()
    window.commands.refresh()
    assert not play.isChecked()


def test_fields_that_are_filled_in_enable_the_buttons_at_once(window, tmp_path):
    learn = window.stations.style.panel.learn
    window.enter("style")
    assert not learn.learn_button.isEnabled()
    learn.source.setCurrentIndex(learn.source.findData("folder"))
    learn.folder.setText(str(tmp_path))
    assert learn.learn_button.isEnabled()
    assert window.commands.action("style.learn").isEnabled()
    learn.folder.setText(" ")
    assert not learn.learn_button.isEnabled()
