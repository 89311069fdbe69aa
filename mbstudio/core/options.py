"""Options: one descriptor each, from which text is read, values are checked, forms built and help written.

An :class:`Option` says what one setting is: its default, its meaning, its limits. Fit methods and presets of
style-learners keep theirs in an :class:`OptionRecord`, whose fields carry the descriptors; a DEM target has a
mapping of them. Either way an :class:`OptionList` reads and checks them, and names owner, option, value and
what is allowed when it refuses. Nothing is taken from docstrings, which ``python -OO`` drops.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, dataclass, field, fields
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

from mbstudio.core.errors import MbstudioError

_KEY = "option"
_SWITCH: Mapping[str, bool] = MappingProxyType(
    {"yes": True, "true": True, "on": True, "1": True, "no": False, "false": False, "off": False, "0": False}
)
_KINDS: Mapping[type, str] = MappingProxyType({bool: "yes or no", int: "a whole number", float: "a number"})


@dataclass(frozen=True)
class Option:
    """One setting: its default, what it means and what it may be.

    Attributes
    ----------
    default : bool, int, float or str
        Its type is the type of the option.
    meaning : str
        For tool tips and help.
    minimum, maximum : float or None
        Bounds of a number, both included.
    above, below : float or None
        Bounds of a number, themselves excluded.
    choices : tuple of str
        The words that a text may be; empty: any.
    unit : str
        Of a number, for forms.
    step : float or None
        By how much a form's arrows change a number that is not whole; None: it is typed in.
    """

    default: Any
    meaning: str
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    unit: str = ""
    step: float | None = None

    @property
    def kind(self) -> type:
        """The type of its values: bool, int, float or str."""
        return type(self.default)

    @property
    def allowed(self) -> str:
        """What may be given, in words: ``a whole number from 8 to 200``."""
        if self.choices:
            return "one of " + ", ".join(map(repr, self.choices))
        words = _KINDS.get(self.kind, "text")
        low = "" if self.minimum is None else f"from {self.minimum:g}"
        low = low if self.above is None else f"above {self.above:g}"
        high = "" if self.maximum is None else f"to {self.maximum:g}"
        high = high if self.below is None else f"to below {self.below:g}" if low else f"below {self.below:g}"
        if low.startswith("from") and not high:
            return f"{words}, {self.minimum:g} or more"
        return " ".join(part for part in (words, low, high) if part)

    def convert(self, value: Any) -> Any:
        """Return a value, or the text of one, as the option's type; None if it is not one."""
        if self.kind is bool:
            return _SWITCH.get(str(value).strip().lower())
        if self.kind is str:
            return str(value)
        try:
            if self.kind is int and isinstance(value, str) and value.strip().lstrip("+-").isdecimal():
                return int(value)
            number = float(value)
        except (TypeError, ValueError):
            return None
        if not math.isfinite(number) or (self.kind is int and number != int(number)):
            return None
        return self.kind(number)

    def admits(self, value: Any) -> bool:
        """Return whether a value of the option's type lies within its limits."""
        if self.choices:
            return value in self.choices
        return (
            (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
            and (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
        )


@dataclass(frozen=True)
class OptionList:
    """The options of one owner.

    Attributes
    ----------
    owner : str
        Whose they are, for messages: ``method 'fast'``.
    error : type
        Raised where something does not suit.
    options : mapping of str to Option
    """

    owner: str
    error: type[MbstudioError]
    options: Mapping[str, Option]

    def refuse_unknown(self, names: Iterable[str], known: Iterable[str] | None = None) -> None:
        """Raise the owner's error for the first name that is no option (or none of `known`)."""
        known = tuple(self.options if known is None else known)
        for name in names:
            if name not in known:
                owner = self.owner[:1].upper() + self.owner[1:]
                raise self.error(f"{owner} has no option '{name}': it has {', '.join(known) or 'none'}.")

    def check_value(self, name: str, value: Any) -> None:
        """Raise the owner's error unless a value lies within the limits of an option."""
        option = self.options[name]
        try:
            admitted = option.admits(value)
        except TypeError:
            admitted = False
        if not admitted:
            raise self.error(f"{name} = {value!r} is not possible for {self.owner}: give {option.allowed}.")

    def complete(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return a value for every option: those given, as values or as text, the others' defaults.

        Raises
        ------
        MbstudioError
            The owner's own, if an option is unknown, of the wrong type, or out of its limits.
        """
        self.refuse_unknown(given)
        return {name: self._value(name, given.get(name)) for name in self.options}

    def _value(self, name: str, value: Any) -> Any:
        option = self.options[name]
        if value is None:
            return option.default
        converted = option.convert(value)
        if converted is None:
            raise self.error(f"Option '{name}' of {self.owner} cannot be {value!r}: give {option.allowed}.")
        self.check_value(name, converted)
        return converted

    def read(self, texts: Iterable[str]) -> dict[str, Any]:
        """Read options written as ``name=value``; the last of one name counts.

        Numbers are written as Python writes them, switches as yes or no, words as they are.

        Raises
        ------
        MbstudioError
            The owner's own, if a text has no ``=``, names no option, or its value is of another type.
        """
        given: dict[str, Any] = {}
        for text in texts:
            name, equals, word = (part.strip() for part in text.partition("="))
            if not equals:
                raise self.error(f"Option '{text}' has no value: write it as name=value.")
            self.refuse_unknown([name])
            given[name] = self._read_word(name, word)
        return given

    def _read_word(self, name: str, word: str) -> Any:
        option = self.options[name]
        if option.choices and word not in option.choices:
            choices = ", ".join(f"{name}={choice}" for choice in option.choices)
            raise self.error(f"'{name}={word}' is not a valid choice: write {choices}.")
        value = option.convert(word)
        if value is not None:
            return value
        if option.kind is bool:
            raise self.error(f"'{name}={word}' is not valid: write {name}=yes or {name}=no.")
        wanted = _KINDS[option.kind]
        if _is_infinite(word):
            raise self.error(f"'{name}={word}' is not finite: give {wanted}.")
        raise self.error(f"'{name}={word}' cannot be read: give {wanted}, for example {name}=3.")


def _is_infinite(word: str) -> bool:
    """Return whether a word is a number, but no finite one."""
    try:
        return not math.isfinite(float(word))
    except ValueError:
        return False


def option(default: Any, meaning: str, **limits: Any) -> Any:
    """Return the field of an :class:`OptionRecord` that is an option; `limits` as in :class:`Option`."""
    return field(default=default, metadata={_KEY: Option(default, meaning, **limits)})


Record = TypeVar("Record", bound="OptionRecord")


@dataclass(frozen=True)
class OptionRecord:
    """Base of records of options: frozen dataclasses whose fields are made by :func:`option`.

    Values are checked when a record is made. A field that is no option (constants of a search) is left alone:
    it can be given, but not as text. ``help()`` lists the options below the record's own words.

    Raises
    ------
    MbstudioError
        The owner's own, for a value out of its limits.
    """

    owner: ClassVar[str]
    error: ClassVar[type[MbstudioError]]

    def __init_subclass__(cls, *, owner: str, error: type[MbstudioError]) -> None:
        super().__init_subclass__()
        cls.owner, cls.error = owner, error
        own = {name: value for name, value in vars(cls).items() if isinstance(value, Field)}
        found = {name: value.metadata[_KEY] for name, value in own.items() if _KEY in value.metadata}
        if cls.__doc__:
            cls.__doc__ = f"{cls.__doc__.rstrip()}\n\n{_attributes_section(found)}"

    def __post_init__(self) -> None:
        known = self.list_options()
        for name in known.options:
            known.check_value(name, getattr(self, name))

    @classmethod
    def list_options(cls) -> OptionList:
        """Return the options that a number, a word or a switch can be given for."""
        found = {entry.name: entry.metadata[_KEY] for entry in fields(cls) if _KEY in entry.metadata}
        return OptionList(cls.owner, cls.error, found)

    @classmethod
    def make(cls: type[Record], given: Mapping[str, Any]) -> Record:
        """Return the record with these options given, the others at their defaults.

        Raises
        ------
        MbstudioError
            The owner's own, if there is no such option or a value does not suit it.
        """
        cls.list_options().refuse_unknown(given, [entry.name for entry in fields(cls)])
        return cls(**given)

    @classmethod
    def read(cls: type[Record], texts: Iterable[str]) -> Record:
        """Return the record of options written as ``name=value``; errors of :meth:`OptionList.read`."""
        return cls.make(cls.list_options().read(texts))

    def list_changed(self) -> dict[str, Any]:
        """Return what is not at its default, by name."""
        default = type(self)()
        pairs = ((entry.name, getattr(self, entry.name)) for entry in fields(self))
        return {name: value for name, value in pairs if value != getattr(default, name)}


def _attributes_section(options: Mapping[str, Option]) -> str:
    """Return the part of a docstring that says what each option means."""
    lines = ["    Attributes", "    ----------"]
    for name, described in options.items():
        lines += [f"    {name} : {described.kind.__name__}", f"        {described.meaning}"]
    return "\n".join(lines) + "\n"
