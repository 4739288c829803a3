"""CSV and other text of columns; csv_layout.py finds how it is laid out."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from terrapin_tools.workbench.files.csv_files import read_csv
from terrapin_tools.workbench.files.format import Asked, Format, Part


def read(path: Path, asked: Asked, texts: Collection[str]) -> list[Part]:
    """One table."""
    columns, first, notes = read_csv(path, texts, asked)
    return [Part("", columns, {}, first, notes)]


FORMAT = Format("a CSV file", (".csv", ".tsv", ".txt", ".dat"), read)
