# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is wrong with what a user gave: one line that names it, for the commands to show."""

LONGEST = 160   # characters of a reason; libraries tell whole dictionaries


NO_ROS = "source ROS 2 Jazzy, or pip install 'somfusion_ros[ros]'"


class InputError(ValueError):
    """A file, a folder or a parameter cannot be used; one line that names it and what is wrong."""


def sentence(error: ValueError | OSError) -> str:
    """Return what an error says, without the number of the system's errors."""
    if isinstance(error, OSError) and error.strerror:
        return ': '.join(str(word) for word in (error.filename, error.strerror)
                         if word is not None)
    return str(error)


def reason_of(error: Exception) -> str:
    """Return the reason of an error as one short line."""
    text = ' '.join((getattr(error, 'strerror', None) or str(error)).split())
    text = text or type(error).__name__
    return text if len(text) <= LONGEST else text[:LONGEST - 3] + '...'
