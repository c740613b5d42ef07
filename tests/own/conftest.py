"""Scenes in which a user's systems walk."""

import pytest

from tests.own.statements import SCENES


@pytest.fixture(params=SCENES)
def scene(request):
    """The arguments of a scene in which a user's system walks."""
    return SCENES[request.param]
