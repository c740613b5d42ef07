"""Comparison of two commits: invalid input, and the definition of a changed walk."""

import pytest

from benchmarks.regress import differing, main, turns


class Steady:
    """A side of the comparison with work of known duration."""

    def __init__(self, seconds):
        self.taken, self.done = seconds, []

    def seconds(self, piece):
        """Return the given duration."""
        self.done.append(piece)
        return self.taken


def test_sides_take_turns_at_each_piece_of_work():
    old, new = Steady(2.0), Steady(3.0)
    taken = turns(old, new, ["many", "alone"], 4)
    assert old.done == new.done == ["many", "alone"] * 4
    for before, after in taken.values():
        assert set(before) == {2.0} and set(after) == {3.0}


def test_walks_that_end_elsewhere_are_reported():
    reported = differing({"lab": 1.0, "A": 2.0, "gone": 1.0}, {"lab": 1.0 + 1e-12, "A": 2.0001})
    assert len(reported) == 1 and "other walks: A came to 2.0" in reported[0]
    assert differing({"D": 1.0}, {"D": float("nan")})


def test_an_unknown_commit_is_refused():
    with pytest.raises(SystemExit, match="no commit 'nowhere' to compare with"):
        main(["nowhere"])


def test_a_number_of_turns_is_asked_for(capsys):
    with pytest.raises(SystemExit):
        main(["HEAD", "--turns", "0"])
    assert "--turns must be at least 1" in capsys.readouterr().err
