# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m somfusion_ros.ros.watch`: the process of `somfusion watch`."""

from somfusion_ros.ros.start import watch

if __name__ == '__main__':
    raise SystemExit(watch())
