#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Generates man pages and the completion of bash and zsh from the programs' declarations for --help.

    scripts/manuals.py [--output build/manuals] [--version VERSION] PROGRAM...

Writes share/man/man1, share/bash-completion/completions and share/zsh/site-functions below --output; the build
runs it, and `cmake --install` copies them to P/share.
"""
import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def interface(program):
    """The program's declarations."""
    done = subprocess.run([program, "--print-interface"], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{program}: expected its interface, found exit code {done.returncode}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def flags(command):
    return [flag for option in command["options"] for flag in option["flags"]]


# --- man -------------------------------------------------------------------------------------------


def roff(text):
    """Escapes plain text for a man page, so that no character is a command."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\n".join("\\&" + line if line[:1] in (".", "'") else line for line in text.splitlines())


def usage(option):
    value = option["value"] and (" " + ("[" if option["optional_value"] else "") + option["value"] + ("]" if option["optional_value"] else ""))
    named = ", ".join(f"\\fB{roff(flag)}\\fR" for flag in option["flags"]) or f"\\fI{roff(option['positional'])}\\fR"
    return named + (f" \\fI{roff(value.strip())}\\fR" if option["flags"] and value else "")


def options_of(command):
    lines, group = [], None
    for option in command["options"]:
        if option["group"] != group:
            group = option["group"]
            lines.append(f'.SS "{roff(group)}"')
        choices = f" ({', '.join(option['choices'])})" if option["choices"] else ""
        lines += [".TP", usage(option), roff(option["help"] + choices)]
    return lines


def man_page(program, version):
    name = program["name"]
    lines = [f'.TH {name.upper()} 1 "" "JADE\\-GS {version}" "JADE\\-GS"', ".SH NAME",
             f"{name} \\- {roff(program['description'])}", ".SH SYNOPSIS"]
    places = " ".join(f"[\\fI{roff(o['positional'])}\\fR]" for o in program["options"] if o["positional"])
    lines.append(f".B {name}\n" + (".I command\n" if program["commands"] else "") + f"[\\fIoptions\\fR] {places}".rstrip())
    lines += [".SH OPTIONS", *options_of(program)]
    for command in program["commands"]:
        lines += [f'.SH "COMMAND {command["name"].upper()}"', roff(command["description"]), *options_of(command)]
    if program["footer"]:
        lines += [".SH NOTES", ".nf", roff(program["footer"].strip()), ".fi"]
    lines += [".SH FILES", "Settings that ship with the programs lie in ../share/jade/configs beside the folder of the programs.", ""]
    return "\n".join(lines)


def with_flags_of(program, command):
    """The command with the program's flags, which it accepts too."""
    own = set(flags(command))
    return {**command, "options": command["options"] + [o for o in program["options"] if o["flags"] and not own & set(o["flags"])]}


# --- bash ------------------------------------------------------------------------------------------


def quoted(text):
    return "'" + text.replace("'", "'\\''") + "'"


def bash_cases(command, indent):
    """Lines that fill COMPREPLY for the words after a command."""
    lines = [indent + 'case "$previous" in']
    for option in command["options"]:
        if not option["value"] or not option["flags"]:
            continue
        words = f'COMPREPLY=($(compgen -W {quoted(" ".join(option["choices"]))} -- "$word")); ' if option["choices"] else ""
        if not option["optional_value"]:
            lines.append(f'{indent}  {"|".join(option["flags"])}) {words}return ;;')
    lines += [indent + "esac", f'{indent}case "$word" in -*) COMPREPLY=($(compgen -W {quoted(" ".join(flags(command)))} -- "$word")) ;; esac']
    return lines


def bash_completion(program):
    name = program["name"]
    lines = [f"# Completion of {name}; where nothing fits, bash offers files.", f"_{name}() {{",
             '  local word="${COMP_WORDS[COMP_CWORD]}" previous="${COMP_WORDS[COMP_CWORD-1]}"', "  COMPREPLY=()"]
    if program["commands"]:
        names = " ".join(command["name"] for command in program["commands"])
        lines += ['  local command="" given', '  for given in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do', '    case " ' + names + ' " in *" $given "*) command="$given" ;; esac',
                  "  done", '  case "$command" in']
        for command in program["commands"]:
            lines += [f"    {command['name']})", *bash_cases(with_flags_of(program, command), "      "), "      return ;;"]
        lines += ["  esac", f'  case "$word" in -*) ;; *) COMPREPLY=($(compgen -W {quoted(names)} -- "$word")); return ;; esac']
    lines += [*bash_cases(program, "  "), "}", f"complete -o default -F _{name} {name}", ""]
    return "\n".join(lines)


# --- zsh -------------------------------------------------------------------------------------------


def zsh_arguments(command):
    lines = []
    for option in command["options"]:
        text = re.sub(r"([\[\]:\\])", r"\\\1", " ".join(option["help"].split()))
        action = f"({' '.join(option['choices'])})" if option["choices"] else "_files"
        for flag in option["flags"]:
            # "::" before an optional value.
            value = f"{'::' if option['optional_value'] else ':'}{option['value'].lower()}:{action}" if option["value"] else ""
            lines.append(quoted(f"*{flag}[{text}]{value}"))
    return lines


def zsh_completion(program):
    name = program["name"]
    lines = [f"#compdef {name}", ""]
    if program["commands"]:
        names = " ".join(command["name"] for command in program["commands"])
        lines += ["case ${words[2]} in"]
        for command in program["commands"]:
            lines.append(f"  {command['name']}) shift words; (( CURRENT-- )); _arguments {' '.join(zsh_arguments(with_flags_of(program, command)))} '*:file:_files' ;;")
        lines += [f"  *) _arguments {' '.join(zsh_arguments(program))} {quoted(f'1:command:({names})')} ;;", "esac", ""]
    else:
        lines += ["_arguments \\", *[f"  {line} \\" for line in zsh_arguments(program)], "  '*:file:_files'", ""]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=Path, nargs="+", metavar="PROGRAM")
    parser.add_argument("--output", type=Path, default=ROOT / "build/manuals")
    parser.add_argument("--version", default="")
    arguments = parser.parse_args()
    for path in arguments.programs:
        program = interface(path)
        name = program["name"]
        for place, text in {f"man/man1/{name}.1": man_page(program, arguments.version),
                            f"bash-completion/completions/{name}": bash_completion(program),
                            f"zsh/site-functions/_{name}": zsh_completion(program)}.items():
            target = arguments.output / "share" / place
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
