"""Define the commands as thin callers of the functions of the package."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from cablepod import archive, study
from cablepod.archive._folder import check_folder
from cablepod.archive._write import check_target
from cablepod.cli import (
    _arguments,
    _design,
    _ensemble,
    _group,
    _info,
    _mast,
    _page,
    _periodic,
    _report,
    _stringing,
    _summary,
    _templates,
)
from cablepod.cli._group import Group, say
from cablepod.cli._progress import Bars, telling_of_compilation
from cablepod.errors import SceneError
from cablepod.examples import scene_path
from cablepod.integrate._velocity_jump import warn_of_velocity_jump
from cablepod.parameters._from_scene import parameters
from cablepod.scene._read import read_scene
from cablepod.study._modes import RANK, make_modes

SCENE = click.argument("scene", metavar="SCENE.toml", shell_complete=_arguments.complete_scene)
NEW_FOLDER = _arguments.folder_option("folder for netCDF files and figures; made if missing", required=True)
REPLACE = _arguments.overwrite_option("replace results that are already in DIR, when all new ones are there")
NO_VERIFY = click.option(
    "--no-verify", "verify", flag_value=False, default=True,
    help="take files as they are that were changed since they were written",
)  # fmt: skip


@click.group(
    "cablepod",
    cls=Group,
    help=_templates.DESCRIPTION,
    epilog=_templates.EPILOG,
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(package_name="cablepod", message="cablepod %(version)s")
def commands() -> None:
    """Group of all commands."""


@commands.command("run", **_templates.texts("run"))
@SCENE
@_arguments.folder_option("folder for netCDF files and figures; made if missing (default: out/NAME of the scene)")
@click.option(
    "--ranks", default="1,2,4", metavar="R,R", help="modes of each coordinate to try, 20 at most (default 1,2,4)"
)
@click.option("--json", "as_json", is_flag=True, help="print answers and table as JSON")
@_page.OPTION
@REPLACE
def run_command(scene: str, out: str | None, ranks: str, as_json: bool, page: str | None, overwrite: bool) -> None:
    """Run the study of one scene, print answers and the table of models."""
    path, numbers = scene_path(scene), _arguments.ranks(ranks)
    _group.import_matplotlib()
    folder = Path("out", Path(path).stem) if out is None else _arguments.folder(out)
    dataset = read_scene(path)
    if "ensemble_json" in dataset.attrs:
        _group.note(
            "the [ensemble] table is left aside; this command runs the scene itself, cablepod ensemble its members"
        )
    target = _page.checked(page)
    with telling_of_compilation(), Bars() as bars, _arguments.as_options(), _page.heard() as notes:
        result = study.run(dataset, folder, ranks=numbers, overwrite=overwrite, progress=bars)
    report = _mast if "motion" in result else _report
    text = report.text(result, folder)
    written = _page.write(target, result, text=text, notes=notes)
    say(report.as_json(result) if as_json else "\n".join(filter(None, (text, written))))


@commands.command("paper", **_templates.texts("paper"))
@_arguments.folder_option("folder for the report; made if missing", required=True)
@click.option(
    "--small", is_flag=True, help="a trial, in a quarter of the time: fewer modes, routes, tensions and stiffnesses"
)
@_arguments.overwrite_option("replace a report that is already in DIR, when the new one is there")
def paper_command(out: str, small: bool, overwrite: bool) -> None:
    """Write the report on the paper, print its summary."""
    _group.import_matplotlib()
    from cablepod.paper import report, sections

    folder = _arguments.folder(out)
    check_folder(folder, report.FILES, overwrite=overwrite, key="--out")
    with telling_of_compilation(), Bars() as bars:
        size = sections.SMALL if small else sections.FULL
        _, rows = report.write(folder, size=size, progress=partial(bars, "the paper"))
    for quantity, _, ours, printed in rows:
        say(f"{quantity}\n    ours   {ours}\n    paper  {printed}".replace("`", ""))
    say(f"\n{folder / report.PAGE}, {report.DATASET} and {len(report.FIGURES)} figures beside it")


@commands.command("modes", **_templates.texts("modes"))
@SCENE
@_arguments.file_option("--out", "netCDF file to write", metavar="FILE.nc", required=True)
@click.option(
    "--layout",
    default="normal",
    metavar="LAYOUT",
    help="normal (the default) or vibration, for the condensed model; separate or vector, for the Galerkin model",
)
@click.option("--rank", type=int, default=RANK, metavar="R", help=f"number of modes (default {RANK})")
@_arguments.overwrite_option("replace FILE.nc")
def modes_command(scene: str, out: str, layout: str, rank: int, overwrite: bool) -> None:
    """Make the modes that a reduced model needs."""
    check_target(Path(out), overwrite=overwrite)
    dataset = read_scene(scene_path(scene))
    with telling_of_compilation(), Bars() as bars:
        modes = make_modes(dataset, layout=layout, rank=rank, progress=partial(bars, "chain"))
    archive.write(modes, out, overwrite=overwrite)
    kind = "vibration" if layout == "vibration" else f"Karhunen-Loève, layout {layout}"
    say(f"{out}: {modes.sizes['mode']} modes, {kind}")


@commands.command("ensemble", **_templates.texts("ensemble"))
@SCENE
@_arguments.folder_option("folder of the ensemble; made if missing", required=True)
@click.option(
    "--model",
    metavar="MODEL",
    shell_complete=_arguments.complete_model,
    help="chain (the default), cable, rigid, galerkin, condensed; mast, the default of a mast; module:function",
)
@_arguments.file_option(
    "--modes",
    "netCDF file of modes, for galerkin and condensed (default: made from a run of the scene itself), and of a mast's guys",
)
@click.option(
    "--option",
    "options",
    multiple=True,
    metavar="NAME=VALUE",
    help="an option of the model, its value as in the scene file: step=1e-3, outputs=['tension']; may be repeated",
)
@click.option(
    "--scheduler", metavar="ADDRESS", help='of a dask scheduler, or "processes" of this machine (default: threads)'
)
@click.option("--workers", type=int, metavar="N", help="threads or processes (default: as many as cores)")
@click.option("--batch", type=int, default=64, metavar="COUNT", help="members in a file (default 64)")
@click.option("--hertz", is_flag=True, help="draw the map over frequencies in Hz")
@_page.OPTION
@_arguments.overwrite_option("replace another ensemble in DIR, when all members are done, and damaged files at once")
@NO_VERIFY
def ensemble_command(**options: Any) -> None:
    """Simulate all members of a scene."""
    _ensemble.simulate(**options)


@commands.command("design", **_templates.texts("design"))
@SCENE
@_arguments.folder_option(
    "folder for storms, netCDF file and tables; made if missing (default: out/NAME_design of the scene)"
)
@click.option(
    "--directions",
    metavar="COUNT|DEG,DEG",
    help="a number of directions evenly round, or angles from +x towards +z into which the wind blows [deg], "
    "a single one with a comma behind it (default 8, at most 72; of a planar scene 0,180)",
)
@click.option(
    "--speeds",
    metavar="U,U",
    help="mean wind speeds at the reference height [m/s] (default: 0.6, 0.7, 0.8, 0.9 and 1 times that of the scene)",
)
@click.option(
    "--storms",
    type=int,
    default=10,
    metavar="N",
    help="storms for each direction and speed, as long as the scene (default 10)",
)
@click.option(
    "--shares",
    metavar="P,P",
    help="shares of the time in which the wind has each speed, in all directions alike: for the damage",
)
@click.option("--slope", type=float, metavar="M", help="exponent of the S-N curve, with --shares")
@click.option(
    "--reference-range",
    type=float,
    metavar="MPA",
    help="range of stress at two million cycles [MPa], with --shares",
)
@click.option("--level", type=float, default=0.9, metavar="P", help="level of the intervals of peaks (default 0.9)")
@click.option(
    "--window",
    type=float,
    nargs=2,
    metavar="START END",
    help="part of each storm that counts [s] (default: all of it)",
)
@_page.OPTION
@_arguments.overwrite_option("replace another study in DIR")
def design_command(**options: Any) -> None:
    """Run storms from all directions and of all speeds."""
    with telling_of_compilation():
        _design.run(**options)


FREQUENCY = click.option(
    "--frequency", required=True, nargs=2, type=float, metavar="LOW HIGH", help="angular frequencies of the forcing [rad/s]"
)  # fmt: skip
HERTZ = click.option("--hertz", is_flag=True, help="frequencies are given, printed and drawn in Hz")
VIBRATIONS = click.option(
    "--rank", type=int, default=_periodic.RANK, metavar="R", help=f"number of vibration modes (default {_periodic.RANK})"
)  # fmt: skip
MODES_FILE = _arguments.file_option("--modes", "netCDF file of modes, layout normal (default: vibrations about rest)")


@commands.command("respond", **_templates.texts("respond"))
@SCENE
@NEW_FOLDER
@FREQUENCY
@MODES_FILE
@VIBRATIONS
@HERTZ
@REPLACE
@NO_VERIFY
def respond_command(**options: Any) -> int:
    """Follow periodic responses over frequency."""
    with telling_of_compilation():
        return _periodic.respond(**options)


@commands.command("tongues", **_templates.texts("tongues"))
@SCENE
@NEW_FOLDER
@FREQUENCY
@click.option(
    "--amplitude", required=True, type=float, metavar="MOST", help="largest amplitude, in the units of the scene's motion [m]"
)  # fmt: skip
@click.option("--points", type=int, default=200, metavar="N", help="frequencies and amplitudes (default 200 of each)")
@MODES_FILE
@VIBRATIONS
@HERTZ
@REPLACE
@NO_VERIFY
def tongues_command(**options: Any) -> int:
    """Map the stability over frequency and amplitude."""
    with telling_of_compilation():
        return _periodic.tongues(**options)


@commands.command("check", **_templates.texts("check"))
@SCENE
def check_command(scene: str) -> None:
    """Print the static numbers of a scene, and notes on what is unusual."""
    from cablepod.cable import summary  # its imports take a second

    dataset = read_scene(scene_path(scene))
    say(dataset.attrs["title"])
    if "mast_height" in dataset:
        say("\n".join(filter(None, (_mast.check_text(dataset), _summary.ensemble_of(dataset)))))
        return
    with telling_of_compilation():
        numbers = summary(dataset)
    say("\n".join(filter(None, (_summary.table(numbers), _summary.remarks(dataset), _summary.ensemble_of(dataset)))))
    warn_of_velocity_jump(parameters(dataset))


@commands.command("stringing", **_templates.texts("stringing"))
@SCENE
@click.option(
    "--temperatures", required=True, nargs=3, type=float, metavar="LOW HIGH COUNT",
    help="equally spaced temperatures [degrees Celsius]",
)  # fmt: skip
@_arguments.file_option(
    "--cases", "tables [NAME.ice] and [NAME.wind] in place of those of the scene; an empty [NAME] is without both",
    metavar="FILE.toml",
)  # fmt: skip
@_arguments.folder_option("folder for the table and its figures; made if missing (default: the table is printed alone)")
@_page.OPTION
@REPLACE
def stringing_command(**options: Any) -> None:
    """Print tension, sag and first frequencies over temperature."""
    with telling_of_compilation():
        _stringing.stringing(**options)


@commands.command("info", **_templates.texts("info"))
@click.argument("path", metavar="PATH", shell_complete=_arguments.complete_file)
@click.option(
    "--lineage", "as_script", is_flag=True,
    help="list all that a file comes from, as a Python file that makes it again from its scenes",
)  # fmt: skip
@NO_VERIFY
def info_command(path: str, as_script: bool, verify: bool) -> None:
    """Describe a file or a folder, or print its lineage."""
    if as_script:
        say(_info.script(Path(path), verify=verify), end="")
    else:
        say(_info.description(Path(path), verify=verify))


@commands.command("new", **_templates.texts("new"))
@click.argument("name", metavar="NAME.toml", shell_complete=_arguments.complete_file)
@click.option("--mast", is_flag=True, help="a mast and its guys instead of one cable")
def new_command(name: str, mast: bool) -> None:
    """Write a scene to start from."""
    say(_templates.write_new(name, mast=mast))


@commands.command("examples", **_templates.texts("examples"))
@click.argument("name", metavar="[NAME]", required=False, shell_complete=_arguments.complete_example)
@_arguments.file_option("--out", "where to copy it (default: NAME.toml in this folder)", metavar="FILE.toml")
def examples_command(name: str | None, out: str | None) -> None:
    """List the shipped scenes, or copy one."""
    if name is not None:
        say(_templates.copy_example(name, out))
        return
    if out is not None:
        raise SceneError(f"--out: given {out} without a scene; allowed: cablepod examples NAME --out FILE.toml")
    say(_templates.list_examples())
