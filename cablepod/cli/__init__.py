"""Provide the command ``cablepod``: studies of one scene, ensembles, the paper, descriptions of files."""

from cablepod.cli._commands import main

__all__ = ["main"]
