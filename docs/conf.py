"""How Sphinx makes the documentation's site: `make docs`."""

import inspect
import os
from importlib.metadata import version as _version
from pathlib import Path

from gym_passive_walker.envs.walker_env import PassiveWalkerEnv

os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # pages on devices are made where there is none

project = "gym_passive_walker"
author = "the gym_passive_walker authors"
copyright = author
version = release = _version("gym-passive-walker")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["_build", "_generated", "jupyter_execute"]

# Pages are Markdown. Notebooks are too, and run anew when they or the package have changed.
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "gym_passive_walker"
html_theme_options = {"navigation_with_keys": True}

# The environment's docstring is Markdown, in Gymnasium's own layout: a page of it.
_generated = Path(__file__).parent / "_generated"
_generated.mkdir(exist_ok=True)
(_generated / "environment.md").write_text(inspect.getdoc(PassiveWalkerEnv) or "", encoding="utf-8")
