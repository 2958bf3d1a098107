"""Provide the texts of the help, the template of a scene, and copies of shipped scenes."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from cablepod.errors import did_you_mean, scene_error
from cablepod.examples import data_folder, scenes

DESCRIPTION = "Reduced-order models of cable dynamics."
EPILOG = """\
begin with: cablepod new guy.toml, or cablepod examples; cablepod COMMAND --help has examples of each

\b
completion by the tab key, in bash (zsh and fish alike):
  eval "$(_CABLEPOD_COMPLETE=bash_source cablepod)"
"""


class Texts(NamedTuple):
    """Help of a command: one line, description, argument, examples."""

    line: str
    description: str
    argument: str
    examples: tuple[str, ...]


TEXTS = {
    "run": Texts(
        "simulate one scene: rest, chain, modes, reduced models and their errors",
        "Rest, snapshots of the chain, modes, reduced models, their errors and run times, figures; all archived.",
        f"SCENE.toml: scene file, or a shipped scene: {', '.join(scenes())}",
        ("cablepod run example2", "cablepod run guy.toml --out out/guy --ranks 1,2,4,8 --overwrite"),
    ),
    "paper": Texts(
        "set every table and figure of the paper beside our own",
        "Table 1, Table 2, Examples 1 to 4, Figures 4 to 9, the routes to the modes and the range of validity of the chain's "
        "basis: a netCDF file, figures and one page, paper.md.",
        "",
        ("cablepod paper --out out/paper", "cablepod paper --small --out out/trial"),
    ),
    "modes": Texts(
        "modes of motion for reduced models",
        "Modes of the deflection normal to the chord from a run of the chain, or other ones, in a netCDF file.",
        "SCENE.toml: scene file, or a shipped scene",
        (
            "cablepod modes guy.toml --out modes.nc",
            "cablepod modes guy.toml --out vibration.nc --layout vibration --rank 4",
        ),
    ),
    "ensemble": Texts(
        "simulate all members of a scene with a table [ensemble]",
        "Every member simulated, in batches, each a netCDF file; at the end a table of the largest tensions, of a mast "
        "also of fatigue ranges, utilisation, displacement and moment, and a map over two parameters. After Ctrl-C or a crash "
        "the same command goes on.",
        "SCENE.toml: scene file with a table [ensemble]",
        (
            "cablepod ensemble study.toml --out out/study",
            "cablepod ensemble study.toml --out out/study --model condensed --batch 256",
            "cablepod ensemble study.toml --out out/study --option step=2.5e-4 --scheduler processes",
            "cablepod ensemble mast.toml --out out/mast",
        ),
    ),
    "design": Texts(
        "storms from all directions and of all speeds: peaks, envelopes and reactions of a mast or a guy",
        "Storms from all directions and of all speeds on a mast or a guy: peaks of the tensions with intervals, utilisation, "
        "envelopes of moment, shear and axial force, displacements, reactions, slack guys, buckling, damage; netCDF and CSV. "
        "After Ctrl-C or a crash the same command goes on.",
        "SCENE.toml: scene file with [wind] and [time], or a shipped scene",
        (
            "cablepod design mast120",
            "cablepod design mast.toml --out out/design --directions 0,60,120 --speeds 15,20,25 --storms 10",
            "cablepod design mast.toml --speeds 10,20,30 --shares 0.3,0.05,0.001 --slope 4 --reference-range 150",
        ),
    ),
    "respond": Texts(
        "periodic responses over the frequency of the forcing, their stability and bifurcations",
        "Branches of periodic responses of the condensed model under the harmonic forcing of the scene: netCDF, figures and "
        "a table of bifurcations.",
        "SCENE.toml: scene file with harmonic motions or loads of one frequency, or a shipped scene",
        (
            "cablepod respond guy.toml --out out/response --frequency 4 8",
            "cablepod respond guy.toml --out out/response --frequency 0.8 1.2 --hertz --rank 4",
        ),
    ),
    "tongues": Texts(
        "stability map: where periodic responses are unstable over frequency and amplitude of the forcing",
        "A map of growth rates of disturbances in and out of the plane, and its edges: netCDF, figures and one table.",
        "SCENE.toml: scene file with harmonic motions or loads of one frequency, or a shipped scene",
        (
            "cablepod tongues guy.toml --out out/tongues --frequency 4 16 --amplitude 0.01",
            "cablepod tongues guy.toml --out out/tongues --frequency 4 16 --amplitude 0.01 --points 100",
        ),
    ),
    "stringing": Texts(
        "tension, sag and first frequencies of a cable over temperature, with ice and in the mean wind",
        "A table in kN, m and Hz of a cable with cable.thermal_expansion. What a scene gives holds at its reference temperature "
        "without ice and wind. With --out netCDF and figures.",
        "SCENE.toml: scene file of one cable",
        (
            "cablepod stringing guy.toml --temperatures -20 40 7",
            "cablepod stringing guy.toml --temperatures -20 40 7 --cases cases.toml --out out/stringing",
        ),
    ),
    "info": Texts(
        "what a file holds and how it was made",
        "What each netCDF file or an ensemble holds, its units, and how it was made.",
        "PATH: a netCDF file of this package, a folder of them, or of an ensemble",
        (
            "cablepod info out/example2",
            "cablepod info out/example2/chain.nc",
            "cablepod info --lineage out/example2/galerkin_r2.nc > again.py",
        ),
    ),
    "check": Texts(
        "static numbers of a scene, and what is unusual about it",
        "Weight, stiffness, tensions, stress, sag and first frequencies at rest, and notes on values that are likely in another "
        "unit. Nothing is simulated or written.",
        "SCENE.toml: scene file, or a shipped scene",
        ("cablepod check guy.toml", "cablepod check example2"),
    ),
    "new": Texts(
        "write a commented scene to start from",
        "Write a scene with comments on the usual keys, to be run as it is and then changed. Overwrites nothing.",
        "NAME.toml: the file to write",
        ("cablepod new guy.toml", "cablepod run guy.toml --out out/guy", "cablepod new --mast mast.toml"),
    ),
    "examples": Texts(
        "list the shipped scenes, or copy one",
        "Without a name list the shipped scenes and their titles; with a name copy that scene, to be changed. "
        "Overwrites nothing.",
        "NAME: a shipped scene",
        ("cablepod examples", "cablepod examples example3", "cablepod examples slack_cable --out scenes/mine.toml"),
    ),
}


def texts(command: str) -> dict[str, Any]:
    """Return the help of a command as keywords of click; examples keep their line breaks."""
    line, description, argument, examples = TEXTS[command]
    return {
        "short_help": line,
        "help": f"{description}\n\n{argument}",
        "epilog": "\n".join(["\b", "examples:", *(f"  {example}" for example in examples)]),
    }


def write_new(name: str, *, mast: bool = False) -> str:
    """Write the template of a scene, of a cable or of a mast; return a message with the next command."""
    template = "new_mast.toml" if mast else "new.toml"
    path = _write("NAME.toml", name, (data_folder() / template).read_text(encoding="utf-8"))
    return f"{path}: a scene to start from; next: cablepod run {path} --out out/{path.stem}"


def copy_example(name: str, out: str | None) -> str:
    """Copy a shipped scene; return a message with the next command."""
    if name not in scenes():
        listed = ", ".join(scenes())
        raise scene_error("NAME", name, f"one of the shipped scenes: {listed}{did_you_mean(name, scenes())}")
    path = _write("--out", out or f"{name}.toml", _text(name))
    return f"{path}: a copy of {name}; next: cablepod run {path} --out out/{path.stem}"


def list_examples() -> str:
    """Return names and titles of the shipped scenes, one per line."""
    width = max(map(len, scenes()))
    lines = [f"{name:<{width}}  {tomllib.loads(_text(name))['title']}" for name in scenes()]
    lines += [
        "",
        "cablepod run NAME --out DIR runs one as it is (free ends only from Python: chain.simulate, rigid.simulate);",
        "cablepod examples NAME copies it",
    ]
    return "\n".join(lines)


def _text(name: str) -> str:
    """Return the file of a shipped scene."""
    return (data_folder() / "scenes" / f"{name}.toml").read_text(encoding="utf-8")


def _write(key: str, given: str, text: str) -> Path:
    """Write a new scene file; refuse to overwrite."""
    path = Path(given)
    if path.suffix != ".toml" or not path.stem:
        raise scene_error(key, given, "the name of a file that ends with .toml")
    if not path.parent.is_dir():
        raise scene_error(key, given, f"a file in a folder that is there; {path.parent} is none")
    try:
        with path.open("x", encoding="utf-8") as file:  # fails if the file exists, without a race
            file.write(text)
    except FileExistsError:
        raise scene_error(key, given, "the name of a file that is not there yet; nothing is overwritten") from None
    return path
