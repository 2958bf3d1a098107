"""Scenes of an ensemble, and the folder of a finished one."""

from __future__ import annotations

import shutil

import pytest
from scenes import ENSEMBLE_RANGES, ENSEMBLE_STEP, SOFT

import cablepod as cp
from cablepod import cli


@pytest.fixture
def scenes_of(soft):
    """Make the scenes of so many members."""
    return lambda members=10, **options: cp.ensemble.design(
        cp.make_scene(soft), options.pop("ranges", ENSEMBLE_RANGES), members=members, **options
    )


@pytest.fixture
def slackened():
    """Let members have 1 N, with which no cable of this weight hangs."""

    def slacken(scenes, members):
        tension = scenes["cable_top_tension"].copy(deep=True)
        tension[members] = 1.0
        return scenes.assign(cable_top_tension=tension)

    return slacken


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with an ensemble of ten members in three files; not to be changed."""
    folder = tmp_path_factory.mktemp("finished") / "it"
    scenes = cp.ensemble.design(cp.make_scene(SOFT), ENSEMBLE_RANGES, members=10)
    cp.ensemble.run(scenes, folder, batch=4, step=ENSEMBLE_STEP)
    return folder


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of that folder, to be changed at will."""
    return shutil.copytree(finished, tmp_path / "it")


@pytest.fixture
def described(capsys):
    """What the command tells of a folder."""

    def describe(folder):
        capsys.readouterr()
        assert cli.main(["info", str(folder)]) == 0
        return capsys.readouterr().out

    return describe
