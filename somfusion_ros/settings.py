# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a setting is written down: default, unit, range and one sentence, once.

Each room has its settings in frozen dataclasses of such fields. The nodes declare their ROS
parameters from them, and the YAML files in `config/` repeat them with the same words (a test
compares them). The numbers that a stage was tuned with, which no user sets, stand in a frozen
dataclass beside the stage.
"""

from dataclasses import Field, field, fields
import math
import re
from typing import Any

KINDS = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}
PARTS = r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*'
NAMES = {'robot': re.compile(rf'/?{PARTS}/?', re.ASCII),
         'topic': re.compile(rf'(~/|/)?{PARTS}', re.ASCII)}
PLURALS = {float: 'numbers', str: 'texts'}


class SettingError(ValueError):
    """A parameter has a value that it cannot have; `name` is that of the parameter."""

    def __init__(self, name: str, wrong: str) -> None:
        super().__init__(f'{name} {wrong}')
        self.name, self.wrong = name, wrong

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.name, self.wrong)


def parameter(default: Any, unit: str, low: float | None, high: float | None,
              description: str, live: bool = False, words: bool = False,
              among: tuple[str, ...] = (), name: str = '') -> Any:
    """
    Make a dataclass field that carries its unit, range (None: open) and sentence.

    live: a node takes changes of it while it runs, even where its class is read at the start;
    words: a list of words, which may come as one text, separated by blanks or commas;
    among: the texts of which it is one; name: `robot` or `topic`, where it is the name of one, as
    ROS allows it, or empty where the default is.
    """
    return field(default=default, metadata={
        'unit': unit, 'low': low, 'high': high, 'description': description, 'live': live,
        'words': words, 'among': among, 'name': name})


def span(item: Field[Any]) -> str:
    """Return the range of a parameter, as 0.1..5, or 1.. where it is open; '' if it has none."""
    low, high = item.metadata['low'], item.metadata['high']
    text = f'{"" if low is None else f"{low:g}"}..{"" if high is None else f"{high:g}"}'
    return text if text.strip('.') else ''


def taken(item: Field[Any], value: Any) -> Any:
    """
    Return a value that came from outside as the field holds it; SettingError if it cannot.

    A list becomes a tuple, and a whole number serves where a number is meant.
    """
    default: Any = item.default
    if not isinstance(default, tuple):
        found = _of_kind(type(default), value)
    else:
        parts = [value] if item.metadata['words'] and isinstance(value, str) else value
        inner = type(default[0])
        found = tuple(_of_kind(inner, part) for part in parts) if (
            isinstance(parts, (list, tuple))) else None
    if found is None or (isinstance(found, tuple) and None in found):
        raise _refusal(item, value)
    _check(item, found)
    return found


def validate(config: Any) -> None:
    """Raise SettingError, naming the parameter, if a value leaves its range or its choice."""
    for item in fields(config):
        _check(item, getattr(config, item.name))


def _check(item: Field[Any], value: Any) -> None:
    """Raise SettingError if a value leaves its range or its choice."""
    low, high, among = (item.metadata[key] for key in ('low', 'high', 'among'))
    texts = value if isinstance(value, tuple) else (value,)
    words = [word for text in texts for word in re.split(r'[\s,]+', text)
             ] if item.metadata['words'] else texts
    named = NAMES.get(item.metadata['name'])
    if named and not all(named.fullmatch(word) if word else _may_be_empty(item) for word in words):
        raise _refusal(item, value)
    numeric = isinstance(value, (int, float)) and not isinstance(value, bool)
    if (among and value not in among) or (numeric and (
            (low is not None and not value >= low) or (high is not None and not value <= high))):
        raise _refusal(item, value)


def _may_be_empty(item: Field[Any]) -> bool:
    """Tell whether a name may be left out."""
    return bool(item.metadata['words'] or not item.default)


def _of_kind(kind: type[Any], value: Any) -> Any:
    """Return a value as the kind that it is to be; None if it is none, or not finite."""
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return value


def _refusal(item: Field[Any], value: Any) -> SettingError:
    """Say which value is wrong, and what is allowed."""
    default: Any = item.default
    allowed = f'a list of {PLURALS[type(default[0])]}' if isinstance(default, tuple) else (
        KINDS[type(default)])
    if item.metadata['among']:
        allowed = f'one of {", ".join(item.metadata["among"])}'
    if item.metadata['name']:
        allowed += f' of letters, digits, _ and /, as the name of a {item.metadata["name"]}'
    within = f' in {span(item)}' if span(item) else ''
    told = list(value) if isinstance(value, tuple) else value
    return SettingError(item.name, f'= {told!r} must be {allowed}{within}')


def tuned(value: Any, unit: str, reason: str, measured: str) -> Any:
    """
    Make a dataclass field for a number that was found by trying, not one that a user sets.

    Parameters
    ----------
    value : the number, or a tuple of numbers
    unit : its unit; '' for a share, a count or a power
    reason : what it does, and what goes wrong where it is larger or smaller
    measured : the benchmark, data or document where it was found; `by design` where it follows
        from something else, `not measured` where nobody has tried others
    """
    return field(default=value, metadata={'unit': unit, 'reason': reason, 'measured': measured})
