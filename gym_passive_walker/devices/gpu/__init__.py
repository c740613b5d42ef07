"""Walkers on a CUDA GPU: the models and functions of the CPU, with one thread for each walker.

Example:
    >>> from gym_passive_walker.devices import gpu # doctest: +SKIP
    >>> gpu.stride("C", 0.036, states)  # doctest: +SKIP

Functions raise `NoDevice` without a GPU. ``NUMBA_ENABLE_CUDASIM=1`` lets numba simulate one.
"""

from __future__ import annotations

import os
from functools import partial

from gym_passive_walker._tools.extras import need

if os.environ.get("NUMBA_ENABLE_CUDASIM") != "1":
    need("numba_cuda", "gpu")

from gym_passive_walker.devices.gpu.batch import DeviceBatch
from gym_passive_walker.devices.gpu.device import NoDevice
from gym_passive_walker.devices.gpu.strides import advance
from gym_passive_walker.gaits.stride import stride as _stride

__all__ = ["DeviceBatch", "NoDevice", "advance", "stride"]

stride = partial(_stride, backend=advance)
"""`gym_passive_walker.stride` on the GPU."""
