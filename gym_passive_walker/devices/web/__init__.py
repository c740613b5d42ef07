"""Walkers in web pages and notebooks: the equations and the engine as WebAssembly.

`build` writes a JavaScript package with the compiled modules. They take the strides and control
steps of the CPU, bit for bit, in any browser and in Node.js.

Example:
    >>> from gym_passive_walker.devices import web
    >>> web.build("passive-walker")  # doctest: +SKIP
"""

from gym_passive_walker.devices.web.build import WebError, build

__all__ = ["WebError", "build"]
