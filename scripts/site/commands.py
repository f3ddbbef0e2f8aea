"""The page of the command line, from its own parsers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from textwrap import wrap

from swarm_mj.cli import main


def page() -> str:
    """Markdown of the page: every command with its arguments."""
    parser = main._parser()
    parts = [
        f"# Command line\n\n{parser.description} Exit status: 0 done, 1 a check failed, 2 bad input or another named error, "
        "130 interrupted.\n"
    ]
    parts += [_command(name, command, words) for name, command, words in _commands(parser)]
    return "\n".join(parts)


def _commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser, str]]:
    """Name, parser and line of help of every command."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            words = {choice.dest: choice.help or "" for choice in action._choices_actions}
            yield from ((name, command, words.get(name, "")) for name, command in action.choices.items())


def _command(name: str, command: argparse.ArgumentParser, words: str) -> str:
    usage = "\n    ".join(wrap(" ".join(command.format_usage().removeprefix("usage: ").split()), 88))
    rows = [
        _row(action) for action in command._actions if action.help is not argparse.SUPPRESS and action.dest != "help"
    ]
    table = "\n".join(["| argument | meaning |", "|---|---|", *rows]) if rows else ""
    description = command.description or words
    return f"## swarm-mj {name}\n\n{_text(description)}\n\n```text\n{usage}\n```\n\n{table}\n"


def _row(action: argparse.Action) -> str:
    given = action.metavar or ("" if action.nargs == 0 else action.dest.upper())
    given = " ".join(given) if isinstance(given, tuple) else given
    words = ", ".join(f"`{option} {given}`" if given else f"`{option}`" for option in action.option_strings)
    meaning = (action.help or "") % {**vars(action), "prog": "swarm-mj"}
    if action.choices:
        meaning += f"; one of {', '.join(map(str, action.choices))}"
    return f"| {words or f'`{given}`'} | {_text(meaning)} |"


def _text(words: str) -> str:
    return words.replace("|", "\\|").replace("<", "&lt;")
