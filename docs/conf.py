"""Configuration of Sphinx for the documentation's site: `make docs`."""

import os
import re
import sys
from importlib.metadata import version as _version
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

from gym_passive_walker.devices import web

os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # pages on devices are made where there is none

project = "gym_passive_walker"
author = "the gym_passive_walker authors"
copyright = author
version = release = _version("gym-passive-walker")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
# `docs/render.py` has executed the notebooks; the site shows these copies with their outputs.
exclude_patterns = ["_build", "_generated", "jupyter_execute", "notebooks/*.md"]

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = "Gym Passive Walker"  # in words: the side bar is too narrow for the name in one piece
html_theme_options = {"navigation_with_keys": True}
html_static_path = ["_generated/static", "explore"]
html_css_files = ["passive-walker/player.css", "explore.css"]

REDIRECTS = {
    "benchmarks-agents": "agents.html#results",
    "benchmarks-precision": "benchmarks.html#run-time-against-error",
    "benchmarks-speed": "benchmarks.html#throughput",
    "benchmarks-start": "benchmarks.html#cold-start",
    "building": "architecture.html#how-the-package-is-built",
    "clients": "howto-train.html#libraries",
    "former-names": "api.html#former-names",
    "gallery": "index.html",
    "mutation": "stability.html#mutation-tests",
    "names": "reference.html",
    "off-policy": "learners.html#off-policy-learners",
    "performance": "benchmarks.html#where-the-time-goes",
    "policies": "agents.html#the-policies-one-by-one",
    "validation-kneed": "validation.html#kneed-and-tuned-walkers",
    "validation-lab": "validation.html#the-laboratorys-walker",
    "validation-literature": "validation.html#other-publications",
    "validation-simplest": "validation.html#the-simplest-walker-and-point-feet",
    "vector": "environment.html#many-environments-in-one-kernel",
    "viewer": "web.html",
    "notebooks/policy_bifurcations": "policy-bifurcations.html",
}
"""Targets by the names of former pages."""

templates_path = ["_templates"]
html_additional_pages = dict.fromkeys(REDIRECTS, "redirect.html")
html_context = {"redirects": REDIRECTS}

_DRAWS = re.compile(r"\.plot\(|\bplt\.")


def _check_pictures(_: Sphinx, doctree: nodes.document) -> None:
    """Refuse a page with a cell that plots and yields no image: its reader would see nothing."""
    for cell in doctree.findall(nodes.container):
        if cell.get("nb_element") != "cell_code" or not _DRAWS.search(cell[0].astext()):
            continue
        kinds = [str(part.get("mime_type", "")) for part in cell.findall(nodes.container)]
        if not any(kind.startswith("image/") for kind in kinds):
            raise ExtensionError(
                f"{doctree['source']}: this cell plots, but no image came of it; draw into "
                f"pyplot's figures:\n{cell[0].astext()}"
            )


def setup(app: Sphinx) -> None:
    """Check each page as it is read."""
    app.connect("doctree-read", _check_pictures)


_generated = Path(__file__).parent / "_generated"
_generated.mkdir(exist_ok=True)
# Pages with a walker load its modules, and figures to explore their data.
web.build(_generated / "static" / "passive-walker")
sys.path.append(str(Path(__file__).parent))
import explore  # noqa: E402

explore.write(_generated / "static")
