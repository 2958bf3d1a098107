"""What a new user of the command begins with: a scene to start from, the shipped scenes, and examples in every help."""

from __future__ import annotations

import argparse
import textwrap
import tomllib
from pathlib import Path
from typing import Any

from cablepod.schema import SceneError, refuse
from cablepod.shipped import data_folder, scenes

#: Examples of each command, shown in its help; :func:`add_examples` puts them there.
EXAMPLES = {
    "run": (
        "cablepod run example2 --out out/example2",
        "cablepod run guy.toml --out out/guy --ranks 1,2,4,8 --overwrite",
    ),
    "ensemble": (
        "cablepod ensemble study.toml --out out/study",
        "cablepod ensemble study.toml --out out/study --model condensed --modes normal_modes.nc",
        "cablepod ensemble study.toml --out out/study --option step=2.5e-4 --scheduler processes",
    ),
    "paper": ("cablepod paper --out out/paper", "cablepod paper --small --out out/trial"),
    "info": (
        "cablepod info out/example2",
        "cablepod info out/example2/chain.nc",
        "cablepod info --lineage out/example2/galerkin_r2.nc > again.py",
    ),
    "new": ("cablepod new guy.toml", "cablepod run guy.toml --out out/guy"),
    "examples": (
        "cablepod examples",
        "cablepod examples example3",
        "cablepod examples slack_cable --out scenes/mine.toml",
    ),
}


def add_commands(commands: Any) -> None:
    """Add ``new`` and ``examples`` to the sub-commands of a parser."""
    new = commands.add_parser(
        "new",
        help="write a commented scene to start from",
        description="Write a scene with a comment on every key, to be run as it is and then changed. Overwrites nothing.",
    )
    new.add_argument("name", metavar="NAME.toml", help="the file to write")
    new.set_defaults(run=_new)
    examples = commands.add_parser(
        "examples",
        help="list the shipped scenes, or copy one",
        description="Without a name list the shipped scenes and their titles; with a name copy that scene, to be changed. "
        "Overwrites nothing.",
    )
    examples.add_argument("name", nargs="?", metavar="NAME", help="a shipped scene")
    examples.add_argument("--out", metavar="FILE.toml", help="where to copy it (default: NAME.toml in this folder)")
    examples.set_defaults(run=_examples)


def add_examples(commands: Any) -> None:
    """End the help of each sub-command with its examples, one a line."""
    for name, examples in EXAMPLES.items():
        parser = commands.choices[name]
        parser.formatter_class = argparse.RawDescriptionHelpFormatter  # the only one that keeps the lines of the epilog
        parser.description = textwrap.fill(parser.description, 88)
        parser.epilog = "\n".join(["examples:", *(f"  {example}" for example in examples)])


def _new(options: argparse.Namespace) -> int:
    path = _write("NAME.toml", options.name, (data_folder() / "new.toml").read_text(encoding="utf-8"))
    print(f"{path}: a scene to start from; next: cablepod run {path} --out out/{path.stem}")
    return 0


def _examples(options: argparse.Namespace) -> int:
    if options.name is None:
        if options.out is not None:
            raise SceneError(
                f"--out: given {options.out} without a scene; allowed: cablepod examples NAME --out FILE.toml"
            )
        width = max(map(len, scenes()))
        for name in scenes():
            print(f"{name:<{width}}  {tomllib.loads(_text(name))['title']}")
        print(
            "\ncablepod run NAME --out DIR runs one as it is (free ends only from Python: chain.simulate, rigid.simulate);\n"
            "cablepod examples NAME copies it"
        )
        return 0
    if options.name not in scenes():
        raise refuse("NAME", options.name, f"one of the shipped scenes: {', '.join(scenes())}")
    path = _write("--out", options.out or f"{options.name}.toml", _text(options.name))
    print(f"{path}: a copy of {options.name}; next: cablepod run {path} --out out/{path.stem}")
    return 0


def _text(name: str) -> str:
    return (data_folder() / "scenes" / f"{name}.toml").read_text(encoding="utf-8")


def _write(key: str, given: str, text: str) -> Path:
    """Write a new scene file; whatever is there already stays."""
    path = Path(given)
    if path.suffix != ".toml" or not path.stem:
        raise refuse(key, given, "the name of a file that ends with .toml")
    if not path.parent.is_dir():
        raise refuse(key, given, f"a file in a folder that is there; {path.parent} is none")
    try:
        with path.open("x", encoding="utf-8") as file:  # fails where there is one, also one that came just now
            file.write(text)
    except FileExistsError:
        raise refuse(key, given, "the name of a file that is not there yet; nothing is overwritten") from None
    return path
