"""A device is simulated here: by numba, whose module for devices is not imported yet."""

import os
import sys

import numba

assert "numba.cuda" not in sys.modules, "a device can be simulated only before it is looked for"
os.environ["NUMBA_ENABLE_CUDASIM"] = "1"
numba.config.ENABLE_CUDASIM = 1
