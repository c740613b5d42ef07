"""Records have room for the coordinates and the controls of every system."""

from collections import namedtuple
from types import SimpleNamespace

import pytest

from gym_passive_walker.engine.layout import NARROW, WIDE, layout_of


@pytest.mark.parametrize(
    ("links", "controls", "layout"),
    [
        (NARROW.links, NARROW.controls, NARROW),
        (NARROW.links + 1, 0, WIDE),
        (1, NARROW.controls + 1, WIDE),
        (WIDE.links, WIDE.controls, WIDE),
    ],
)
def test_a_system_has_the_smallest_records_with_room_for_it(links, controls, layout):
    State, Control = (
        namedtuple("Fields", [f"of{i}" for i in range(count)]) for count in (2 * links, controls)
    )
    assert layout_of(SimpleNamespace(State=State, Control=Control)) is layout
