"""The documents name only what is there: pages, headings, pictures, files, modules, commands and options."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer.main

import mbstudio
from mbstudio.cli.app import app

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])
_FENCE = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_SPAN = re.compile(r"`([^`]+)`")
_FOLDERS = ("mbstudio/", "docs/", "assets/", "benchmarks/", "tests/")

COMMAND: Any = typer.main.get_command(app)

documents = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)


def _fences(document: Path, language: str) -> list[str]:
    return [code for kind, code in _FENCE.findall(document.read_text(encoding="utf-8")) if kind == language]


def _prose(document: Path) -> str:
    return _FENCE.sub("", document.read_text(encoding="utf-8"))


def _spans(document: Path) -> list[str]:
    return [" ".join(span.split()) for span in _SPAN.findall(_prose(document))]


def _anchors(document: Path) -> set[str]:
    """Return the headings of a document as links write them."""
    headings = re.findall(r"^#+ +(.*)$", _prose(document), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def _command_lines(document: Path) -> list[list[str]]:
    """Return the words of every line of a plain fence, comments apart and broken lines joined."""
    text = "\n".join(_fences(document, "")).replace("\\\n", " ")
    return [words for line in text.splitlines() if (words := shlex.split(line, comments=True))]


def _options(command: Any) -> set[str]:
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}


HELP = {"-h", "--help"}
ALL_OPTIONS = HELP.union(_options(COMMAND), *(_options(command) for command in COMMAND.commands.values()))


@pytest.mark.parametrize(
    "document", [*DOCUMENTS, ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"], ids=lambda path: path.name
)
def test_links_lead_to_pages_and_headings_that_exist(document: Path) -> None:
    for link in _LINK.findall(_prose(document)):
        if link.startswith(("https://", "http://")):
            continue
        name, _, anchor = link.partition("#")
        page = document.parent / name if name else document
        assert page.is_file(), f"{document.name}: {link}"
        assert not anchor or anchor in _anchors(page), f"{document.name}: {link}"


@documents
def test_named_files_are_in_the_repository(document: Path) -> None:
    for span in _spans(document):
        if span.startswith(_FOLDERS) and not re.search(r"[\s<>*{]", span):
            made_by_the_reader = "/translations/" in span
            assert made_by_the_reader or (ROOT / span).exists(), f"{document.name}: {span}"


@documents
def test_named_modules_and_functions_can_be_imported(document: Path) -> None:
    for span in _spans(document):
        if re.fullmatch(r"mbstudio(\.\w+)+", span):
            assert _resolves(span), f"{document.name}: {span}"


def _resolves(name: str) -> bool:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return hasattr(importlib.import_module(module), attribute)
    return True


@documents
def test_python_examples_compile_and_import_names_that_exist(document: Path) -> None:
    for code in _fences(document, "python"):
        tree = ast.parse(code, document.name)
        compile(tree, document.name, "exec")
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    assert hasattr(module, alias.name), f"{document.name}: {node.module}.{alias.name}"
            elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "mb":
                assert node.attr in mbstudio.__all__, f"{document.name}: mb.{node.attr}"


@documents
def test_command_lines_parse(document: Path) -> None:
    for words in _command_lines(document):
        if words[0] == "mbstudio":
            command = COMMAND.commands[words[1]]
            command.make_context(words[1], words[2:])  # raises UsageError; does not run the command
        elif words[0].startswith("python"):
            assert (ROOT / words[1]).is_file(), f"{document.name}: {words[1]}"
            source = (ROOT / words[1]).read_text(encoding="utf-8")
            for word in words[2:]:
                assert not word.startswith("--") or f'"{word}"' in source, f"{document.name}: {words}"


@documents
def test_commands_and_options_in_the_text_exist(document: Path) -> None:
    of_other_programs = "\n".join(
        path.read_text(encoding="utf-8")
        for path in (*(ROOT / "benchmarks").glob("*.py"), ROOT / "tests" / "conftest.py")
    )
    for span in _spans(document):
        words = span.split()
        known = ALL_OPTIONS
        if words[0] == "mbstudio" and len(words) > 1 and words[1].islower() and words[1][0] != "-":
            assert words[1] in COMMAND.commands, f"{document.name}: {span}"
            known = HELP | _options(COMMAND.commands[words[1]])
        elif words[0] != "mbstudio" and not words[0].startswith("-"):
            continue
        for word in words:
            if re.fullmatch(r"--?[a-z][\w-]*", word):
                of_another = words[0] != "mbstudio" and f'"{word}"' in of_other_programs
                assert word in known or of_another, f"{document.name}: {span}"


@documents
def test_extras_that_are_installed_are_declared(document: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    text = document.read_text(encoding="utf-8")
    for extra in re.findall(r"pip install (?:-e )?['\"]?(?:mbstudio|\.)\[(\w+)\]", text):
        assert extra in project["optional-dependencies"], f"{document.name}: {extra}"
