"""`camtorque completion`: lines for the start file of a shell, made from the parser itself.

A script of words costs nothing at the prompt and no package; argcomplete would start Python at every press of the key.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from camtorque.commands import COMMANDS, Outcome, Tell
from camtorque.commands.arguments import add_arguments

BASH = """_camtorque() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" words
  case "${{COMP_WORDS[1]}}" in
{cases}
    *) words="{names}" ;;
  esac
  [ "$COMP_CWORD" = 1 ] && words="{names}"
  COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _camtorque camtorque
"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def execute(arguments: argparse.Namespace, tell: Tell) -> Outcome:
    """Return the lines for one shell."""
    words = {name: _words(name) for name in COMMANDS}
    if arguments.shell == "fish":
        return Outcome(_fish(words), {})
    cases = "\n".join(f'    {name}) words="{" ".join(row)}" ;;' for name, row in words.items())
    lines = BASH.format(cases=cases, names=" ".join(words)).rstrip()
    return Outcome((ZSH if arguments.shell == "zsh" else "") + lines, {})


def _words(name: str) -> list[str]:
    """Return the options of a command, and the values of an argument that has a list of them."""
    parser = argparse.ArgumentParser(prog=name)
    add_arguments(parser, name)
    found: list[str] = []
    for action in parser._actions:  # noqa: SLF001  argparse has no public list of them
        found += action.option_strings or [str(choice) for choice in action.choices or ()]
    return sorted(set(found))


def _fish(words: Mapping[str, list[str]]) -> str:
    lines = [f"complete -c camtorque -n __fish_use_subcommand -a {name} -d '{COMMANDS[name]}'" for name in words]
    for name, row in words.items():
        for word in row:
            kind = f"-l {word[2:]}" if word.startswith("--") else f"-s {word[1:]}" if word[0] == "-" else f"-a {word}"
            lines.append(f"complete -c camtorque -n '__fish_seen_subcommand_from {name}' {kind}")
    return "\n".join(lines)
