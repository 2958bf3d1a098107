"""The checker of the CF and ACDD conventions, and the findings that files of the archive may have."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

# Of the attributes that ACDD asks for, those that have no meaning for a computed cable in its own Cartesian frame, on
# elapsed time.  Whoever publishes a file adds the persons and bodies as attributes of the dataset, and they are kept.
NO_TIME = "no time axis in parameters and modes"
NO_MEANING = {
    "no place on Earth": ["geospatial_", "Could not find lat", "Could not find lon"],
    "no date": ["time_coverage_start not present", "time_coverage_end not present"],
    NO_TIME: ["time_coverage_duration not present", "time_coverage_resolution not present"],
    "the program cannot know who uses it": ["creator_", "contributor_", "institution not present", "project not present"],
    "nobody has published it": ["publisher_", "date_issued", "Attr date_issued", "naming_authority not present"],
    "nobody was asked": ["acknowledgment/acknowledgement not present"],
    "levels, platforms and instruments are those of observations": [
        "processing_level not present",
        "platform not present",
        "platform_vocabulary",
        "instrument",
        "program not present",
    ],
    "a file is never altered after it was made": ["date_modified", "date_metadata_modified", "Attr date_m"],
    "the version of the program is in source": ["product_version"],
    "the keywords are from no controlled list": ["keywords_vocabulary"],
    "nothing more is said elsewhere": ["metadata_link"],
    "the table of standard names has none for a cable": ["standard_name_vocabulary not present", "standard_name"],
}  # fmt: skip
HAVE_TIME = ("trajectory", "comparison", "ensemble", "batch")


def findings(report):
    """Return (check, message) of one standard's part of the checker's report."""
    items = [item for level in ("high", "medium", "low") for item in report[f"{level}_priorities"]]
    return {(item["name"], message) for item in items for message in item["msgs"]}


def check_compliance(paths, tmp_path, *, have_time=HAVE_TIME):
    """Run the checker on files (kind -> path) and hold that it finds only what is allowed."""
    pytest.importorskip("compliance_checker")
    command = [str(Path(sys.executable).with_name("compliance-checker")), "--test=cf:1.11", "--test=acdd:1.3"]
    report = tmp_path / "report.json"
    options = ["--criteria=strict", "--format=json_new", f"--output={report}"]
    done = subprocess.run([*command, *options, *map(str, paths.values())], capture_output=True, text=True)
    assert "exceptions occurred" not in done.stdout + done.stderr
    reports = json.loads(report.read_text())
    for kind, path in paths.items():
        has_time = kind in have_time
        found = {(name[:4], message) for name, message in findings(reports[str(path)]["cf:1.11"])}
        # the standard name "time" would demand a date to count from
        no_date = ("§5.1", "Coordinate variable 'time' should have standard_name='time', found: 'None'")
        assert found == ({no_date} if has_time else set()), kind
        starts = tuple(
            start for why, starts in NO_MEANING.items() if not has_time or why != NO_TIME for start in starts
        )
        found = {message for _, message in findings(reports[str(path)]["acdd:1.3"])}
        assert "naming_authority not present" in found, "the report has another form than this test knows"
        assert {message for message in found if not message.startswith(starts)} == set(), kind
