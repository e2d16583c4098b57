# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of figures: printed as Markdown, and written between the markers of a document."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import isfinite
import os
from pathlib import Path
import platform
import re
import subprocess

from benchmarks.data.folders import ROOT
from somfusion_ros.whole_files import write_text

Value = str | int | float | None


@dataclass
class Table:
    """
    Named columns and rows of text; `begin`, `end` in a document hold the same name.

    A table is filled row by row, so that a long measurement can be watched.
    """

    name: str
    columns: Sequence[str]
    digits: Sequence[int | None] = ()   # of the columns' numbers; None: as they are
    rows: list[list[str]] = field(default_factory=list)

    def add(self, *values: Value) -> None:
        """Add a row; a number that is not known, None or NaN, stays empty."""
        if len(values) != len(self.columns):
            raise ValueError(f'{self.name}: {len(values)} values for {len(self.columns)} columns')
        digits = [*self.digits, *[None] * len(values)]
        self.rows.append([_text(value, n) for value, n in zip(values, digits, strict=False)])

    def extend(self, rows: Iterable[Sequence[Value]]) -> 'Table':
        """Add several rows; return the table."""
        for row in rows:
            self.add(*row)
        return self

    def markdown(self) -> str:
        """Return the table in Markdown, with columns of equal width for a terminal."""
        lines = [list(self.columns), *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        text = ['| ' + ' | '.join(word.ljust(width) for word, width in
                                  zip(line, widths, strict=True)) + ' |' for line in lines]
        text.insert(1, '|' + '|'.join('-' * (width + 2) for width in widths) + '|')
        return '\n'.join(text)


def write_into(document: Path, table: Table, origin: str) -> None:
    """
    Replace what stands between a document's markers of a table's name; KeyError without them.

    The markers are comments: <!-- figures: NAME --> and <!-- end of figures: NAME -->.
    """
    text = document.read_text(encoding='utf-8')
    begin, end = (f'<!-- {word}: {table.name} -->' for word in ('figures', 'end of figures'))
    if begin not in text or end not in text:
        raise KeyError(f'{document.name} has no place for the table {table.name!r}: {begin}')
    head, rest = text.split(begin, 1)
    tail = rest.split(end, 1)[1]
    write_text(document, f'{head}{begin}\n{table.markdown()}\n\n_{origin}_\n{end}{tail}')


def names_in(source: str) -> list[str]:
    """Find the names of the tables that a program makes."""
    return re.findall(r"Table\(\s*'([\w-]+)'", source)


def places() -> dict[str, Path]:
    """Find the document of every table, by the table's name."""
    documents = [ROOT / 'README.md', *sorted((ROOT / 'doc').glob('*.md'))]
    return {name: document for document in documents for name in
            re.findall(r'<!-- figures: (.+?) -->', document.read_text(encoding='utf-8'))}


def origin(data: str) -> str:
    """Return where figures come from: data, commit, machine, in one line."""
    return f'{data}; commit {commit()}; {machine()}.'


def commit() -> str:
    """Return the short name of the commit, with a plus where files differ from it."""
    def git(*words: str) -> str:
        found = subprocess.run(['git', *words], cwd=ROOT, capture_output=True, text=True)
        return found.stdout.strip() if found.returncode == 0 else ''
    changed = git('status', '--porcelain', '--untracked-files=no', 'somfusion_ros')
    return (git('rev-parse', '--short', 'HEAD') or 'unknown') + ('+' if changed else '')


def machine() -> str:
    """Return processor, number of cores and the version of Python."""
    name = platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        found = re.search(r'^model name\s*: (.+)$', info.read_text(), re.MULTILINE)
        name = found.group(1) if found else name
    return f'{name}, {os.cpu_count()} cores, Python {platform.python_version()}'


def _text(value: Value, digits: int | None) -> str:
    """Write a value with a number of digits behind the point."""
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return ''
    if isinstance(value, str) or digits is None:
        return str(value)
    return f'{value:.{digits}f}'
