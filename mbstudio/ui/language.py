"""The words of the window in the person's language.

Every text that a person reads passes `tr`. A translation is a file ``translations/mbstudio_<language>.qm``
beside this module, made with Qt's own tools; docs/translating.md says how.
"""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QLocale, QTranslator

from mbstudio.core.translation import mark as mark  # for the texts in tables of the window

FOLDER = Path(__file__).parent / "translations"


def tr(text: str, **values: object) -> str:
    """Return a text in the person's language, with values filled in.

    Parameters
    ----------
    text : str
        In English, written out where `tr` is called: Qt's ``lupdate`` collects it from there.
    **values
        For the ``{name}`` fields in it, which may carry formats (``{error:+.2f}``).

    Returns
    -------
    str
    """
    translated = QCoreApplication.translate("", text)
    return translated.format(**values) if values else translated


def plural(count: int, one: str, many: str, **values: object) -> str:
    """Return a text about a number of things, in the person's language.

    Parameters
    ----------
    count : int
        Of the things; fills the field ``{count}``.
    one, many : str
        Marked texts for exactly one and for any other number (`mark`): "{count} grain", "{count} grains".
    **values
        For further fields.
    """
    return tr(one if count == 1 else many, count=count, **values)


def install_translation(application: QCoreApplication, locale: QLocale | None = None) -> bool:
    """Let `tr` speak a language from now on; return whether there is a translation.

    Parameters
    ----------
    application : QCoreApplication
    locale : QLocale, optional
        The system's by default.
    """
    translator = QTranslator(application)
    if not translator.load(locale or QLocale.system(), "mbstudio", "_", str(FOLDER)):
        return False
    return application.installTranslator(translator)
