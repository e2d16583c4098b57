# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where the figures of README and doc/ come from; run as `python -m benchmarks.slam.accuracy`.

One thread for linear algebra, so that a time is that of one core. It must be set before numpy is
imported.
"""

import os

for _variable in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_variable, '1')
