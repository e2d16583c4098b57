# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A study of many cases goes on where it was stopped, and judges anew what has changed."""

from pathlib import Path

from benchmarks.fusion import judging
import pytest

WANTED = [('corridors', 3), ('office', 1), ('corridors', 4)]


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder without any pair of maps, for drawn cases; nothing was kept before."""
    monkeypatch.setattr(judging, 'KEPT', tmp_path / 'kept')
    (tmp_path / 'pairs').mkdir()
    (tmp_path / 'pairs' / 'manifest.csv').write_text('name,kind\n', encoding='utf-8')
    return tmp_path


def test_what_was_judged_is_kept(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = judging.judge(data, [], WANTED[:2], jobs=1)
    assert [(sample.kind, sample.number) for sample in first] == WANTED[:2]
    judged = []
    monkeypatch.setattr(judging, '_judged', lambda data, replays, wanted, jobs: (
        judged.extend(wanted) or iter([])))
    again = judging.judge(data, [], WANTED, jobs=1)
    assert judged == WANTED[2:]
    assert [(sample.kind, sample.number) for sample in again] == WANTED[:2]
    assert again[0].evidence.fine == pytest.approx(first[0].evidence.fine, rel=1e-3)


def test_nothing_is_kept_for_other_data(data: Path) -> None:
    before = judging.kept(data, [])
    assert judging.kept(data, []) == before
    (data / 'pairs' / 'more.npz').write_bytes(b'a pair')
    assert judging.kept(data, []) != before
