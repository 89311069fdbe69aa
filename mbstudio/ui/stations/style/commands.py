"""The commands of the menu Style."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from mbstudio.ui.commands import Command
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.judge_work import JudgeWork
from mbstudio.ui.stations.style.link import StyleLink
from mbstudio.ui.stations.style.panel import StylePanel
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.studio import Studio


def style_commands(
    studio: Studio,
    work: StyleWork,
    clone_work: CloneWork,
    judge_work: JudgeWork,
    panel: StylePanel,
    link: StyleLink,
) -> list[Command]:
    """Return the commands of station Style."""
    return [
        *_learn(studio, work, panel, link),
        *_generate(studio, clone_work, panel, link),
        *_judge(judge_work, link),
    ]


def _judge(work: JudgeWork, link: StyleLink) -> list[Command]:
    return [
        Command(
            id="style.judge",
            title=tr("Judge clones"),
            run=link.judge_clones,
            menu="Style",
            icon="ph.scales",
            tip=tr("Find whether the clones can be told from the true grains"),
            enabled=lambda: work.can_judge,
            separated=True,
        ),
        Command(
            id="style.cancel_judging",
            title=tr("Cancel judging"),
            run=work.run.cancel,
            menu="Style",
            icon="ph.x-circle",
            tip=tr("Cancel the judgement of the clones"),
            enabled=lambda: work.run.is_running,
        ),
    ]


def _learn_or_show(studio: Studio, panel: StylePanel) -> None:
    """Learn; from elsewhere only go to the page: minutes of work do not begin by one key, unseen."""
    if panel.learn.isVisible():
        panel.learn.learn()
        return
    studio.enter("style")
    panel.open_page("learn")
    studio.give_hint(tr("Check what is learned from; “Learn style” or Ctrl+L begins."))


def _learn_chosen(studio: Studio, work: StyleWork, panel: StylePanel) -> Command:
    space = studio.workspace

    def choose_parents() -> None:
        studio.enter("style")
        panel.open_page("learn")
        panel.learn.choose_source("chosen")

    return Command(
        id="style.learn_chosen",
        title=tr("Learn from chosen grains…"),
        run=choose_parents,
        menu="Style",
        icon="ph.graduation-cap",
        tip=tr("Take the chosen grains as the parents at station Style"),
        enabled=lambda: bool(space.chosen) and not work.run.is_running,
        words=lambda: plural(
            len(work.labels("chosen")) or 1,
            mark("Learn from chosen grain…"),
            mark("Learn from {count} chosen grains…"),
        ),
        is_about_grains=True,
    )


def _learn(studio: Studio, work: StyleWork, panel: StylePanel, link: StyleLink) -> list[Command]:
    space = studio.workspace

    def at_page(go_on: Callable[[], None]) -> None:
        studio.enter("style")
        panel.open_page("learn")
        go_on()

    return [
        Command(
            id="style.learn",
            title=tr("Learn style"),
            run=partial(_learn_or_show, studio, panel),
            menu="Style",
            shortcut="Ctrl+L",
            icon="ph.graduation-cap",
            tip=tr("Learn the shape of the parents selected at station Style"),
            enabled=lambda: panel.learn.is_ready and not work.run.is_running,
        ),
        _learn_chosen(studio, work, panel),
        Command(
            id="style.learn_on",
            title=tr("Continue learning"),
            run=partial(at_page, panel.learn.learn_on),
            menu="Style",
            icon="ph.graduation-cap",
            tip=tr("Teach the style-learner new grains without forgetting the old ones"),
            enabled=lambda: panel.learn.has_new_parents and not work.run.is_running,
        ),
        Command(
            id="style.pause",
            title=tr("Pause or resume learning"),
            run=work.run.pause_or_resume,
            menu="Style",
            icon="ph.pause-circle",
            tip=tr("Pause the training, or resume it"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="style.stop",
            title=tr("Stop learning and keep the best"),
            run=work.run.stop,
            menu="Style",
            icon="ph.stop-circle",
            tip=tr("Stop the training and keep its best state"),
            enabled=lambda: work.is_training,
        ),
        Command(
            id="style.cancel",
            title=tr("Cancel learning"),
            run=work.run.cancel,
            menu="Style",
            icon="ph.x-circle",
            tip=tr("Cancel and keep the current style-learner"),
            enabled=lambda: work.run.is_running,
        ),
        Command(
            id="style.open",
            title=tr("Open style…"),
            run=link.ask_style,
            menu="Style",
            icon="ph.folder-open",
            tip=tr("Open a folder that contains a style-learner or a style of surfaces"),
            enabled=lambda: not work.run.is_running,
            separated=True,
        ),
        Command(
            id="style.save",
            title=tr("Save style…"),
            run=link.ask_folder,
            menu="Style",
            icon="ph.floppy-disk",
            tip=tr("Write the style into a folder"),
            enabled=lambda: space.has_style,
        ),
    ]


def _generate(studio: Studio, clone_work: CloneWork, panel: StylePanel, link: StyleLink) -> list[Command]:
    space = studio.workspace

    def generate() -> None:
        studio.enter("style")
        panel.open_page("generate")
        panel.generate.generate()

    return [
        Command(
            id="style.generate",
            title=tr("Generate clones"),
            run=generate,
            menu="Style",
            shortcut="Ctrl+Shift+G",
            icon="ph.sparkle",
            tip=tr("Generate new grains in the style, with the settings of station Style"),
            enabled=lambda: space.has_style and not clone_work.run.is_running,
            separated=True,
        ),
        Command(
            id="style.cancel_clones",
            title=tr("Cancel generating"),
            run=clone_work.run.cancel,
            menu="Style",
            icon="ph.x-circle",
            tip=tr("Cancel and keep the current clones"),
            enabled=lambda: clone_work.run.is_running,
        ),
        Command(
            id="style.report",
            title=tr("Write report on the clones…"),
            run=link.ask_report,
            menu="Style",
            icon="ph.file-text",
            tip=tr("Write a comparison of clones and parents as one HTML file"),
            enabled=lambda: space.state.clones is not None,
        ),
        Command(
            id="style.compare",
            title=tr("Compare clones with grains"),
            run=partial(studio.enter, "populations"),
            menu="Style",
            icon="ph.chart-bar",
            tip=tr("Compare the clones with grains and avatars at station Populations"),
            enabled=lambda: space.clones is not None,
        ),
        Command(
            id="style.export",
            title=tr("Export clones…"),
            run=link.export_clones,
            menu="Style",
            icon="ph.export",
            tip=tr("Write the clones for a DEM engine at station Export"),
            enabled=lambda: space.clones is not None,
        ),
    ]
