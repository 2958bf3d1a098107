"""The page for contributors, the citation and the dependency groups: what they name is there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import cablepod as cp

PACKAGE = Path(cp.__file__).parent
ROOT = PACKAGE.parent
PAGE = ROOT / "CONTRIBUTING.md"


def test_files_that_contributors_are_sent_to_exist():
    paths = re.findall(r"`((?:\w+/)*\w+\.(?:py|toml))`", PAGE.read_text(encoding="utf-8"))
    assert len(paths) > 50
    assert [path for path in paths if not (PACKAGE / path).exists() and not (ROOT / path).exists()] == []


def test_names_in_files_that_contributors_are_sent_to_exist():
    found = re.findall(r"`((?:\w+/)*\w+\.py)` \(((?:`\w+`(?:, )?)+)\)", PAGE.read_text(encoding="utf-8"))
    assert len(found) > 2
    for path, names in found:
        for name in re.findall(r"\w+", names):
            assert re.search(rf"\b{name}\b", (PACKAGE / path).read_text(encoding="utf-8")), (path, name)


def test_the_citation_has_the_version_and_licence_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = dict(re.findall(r"^(version|license): (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.MULTILINE))
    assert stated == {"version": project["version"], "license": project["license"]}


@pytest.mark.parametrize("name", ["test", "docs", "dev"])
def test_dependency_groups_are_the_extras(name):
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    group = [entry for entry in content["dependency-groups"][name] if isinstance(entry, str)]
    assert group == content["project"]["optional-dependencies"][name]
