"""`skin --completion`: commands and options for the shell to complete."""

from __future__ import annotations

import inspect
from importlib import import_module

from skin.cli import COMMANDS

__all__ = ["script"]

SCRIPT = """\
_skin() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words="" options=""
    case "${{COMP_CWORD}} ${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}" in
        1\\ *) words="{commands}"; options="--help --version --completion" ;;
{cases}
    esac
    if [[ $word == -* ]]; then words="$options"; fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _skin skin"""
CASE = '        {pattern}) words="{words}"; options="{options}" ;;'


def script() -> str:
    """A script for bash: commands, their own words, options after a dash, and else files."""
    cases = []
    for name in COMMANDS:
        module = import_module(f"skin.cli.{name}")
        words = getattr(module, "SUBCOMMANDS", {})
        for word, place in words.items():
            within, function = place.split(":")
            options = _options(getattr(import_module(within), function))
            pattern = f"*\\ {name}\\ {word}"
            cases.append(CASE.format(pattern=pattern, words="", options=options))
        options = _options(getattr(module, name))
        pattern = f"*\\ {name}\\ *"
        cases.append(CASE.format(pattern=pattern, words=" ".join(words), options=options))
    return SCRIPT.format(commands=" ".join(COMMANDS), cases="\n".join(cases))


def _options(command: object) -> str:
    """The options of a command, as on its command line."""
    found = ["--help"]
    for name, one in inspect.signature(command).parameters.items():  # type: ignore[arg-type]
        if one.kind is one.KEYWORD_ONLY:
            negated = "no-" if one.default is True else ""
            found.append(f"--{negated}{name.replace('_', '-')}")
    return " ".join(found)
