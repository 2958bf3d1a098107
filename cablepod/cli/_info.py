"""What ``cablepod info`` says of files, folders and ensembles."""

from __future__ import annotations

from pathlib import Path

from cablepod import archive
from cablepod.archive import _lineage
from cablepod.archive._manifest import MANIFEST, describe_ensemble


def script(path: Path, *, verify: bool) -> str:
    """Return the script that makes a file or an ensemble again."""
    if (path / MANIFEST).exists():
        return _lineage.script(archive.open_ensemble(path, incomplete=True, verify=verify))
    if path.is_dir():
        raise archive.ArchiveError(f"--lineage: given {path}, a folder; allowed: one file")
    return _lineage.script(archive.read(path, chunks={}, verify=verify))


def description(path: Path, *, verify: bool) -> str:
    """Describe a file, an ensemble, or all files of a folder."""
    if not path.is_dir():
        return archive.describe(path, verify=verify)
    if (path / MANIFEST).exists():
        return describe_ensemble(path, verify=verify)
    files = sorted(path.glob("*.nc"))
    if not files:
        raise archive.ArchiveError(
            f"{path}: a folder without netCDF files; allowed: a file or a folder that cablepod wrote"
        )
    return "\n\n".join(archive.describe(file, verify=verify) for file in files)
