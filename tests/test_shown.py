"""Text, notebook cells, tables and files of results, and missing libraries."""

from __future__ import annotations

import csv
import json
import re
import sys

import numpy as np
import pytest
from scipy.io import loadmat

from gym_passive_walker import Outcome
from gym_passive_walker._tools.extras import extra, need
from gym_passive_walker._tools.shown import Shown, Table, picture


class Made(Table):
    """A table of three columns."""

    def facts(self):
        """Return three facts."""
        return {"walker": "<lab> & co", "slope": "0.03 rad", "flag": ""}

    def columns(self):
        """Return three columns."""
        return {
            "slope": np.array([0.1, 1 / 3, np.nan]),
            "period": np.array([1, 2, 4]),
            "ends": np.array(["a,b", 'say "on"', "ü"]),
        }


def test_a_line_has_the_class_and_each_fact():
    assert repr(Made()) == "<Made: walker <lab> & co, slope 0.03 rad, flag>"


def test_an_outcome_is_printed_in_words_and_stays_a_number():
    fell = Outcome.FELL_FORWARD
    assert f"{fell}" == str(fell) == "fell forward" and f"{fell:>13}" == " fell forward"
    assert json.dumps([fell]) == "[3]" and fell == 3


def test_a_cell_of_a_notebook_has_a_row_for_each_fact_and_escapes_signs():
    html = Made()._repr_html_()
    assert html.startswith("<table><caption>Made</caption><tr>") and html.endswith("</tr></table>")
    assert "&lt;lab&gt; &amp; co</td>" in html and "<lab>" not in html
    assert html.count("<tr>") == 3 and html.index("walker") < html.index("slope")


def test_a_table_is_written_with_all_digits_in_the_order_of_its_columns(tmp_path):
    path = tmp_path / "deep" / "table.csv"
    Made().to_csv(path)
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head == ["slope", "period", "ends"]
    assert rows == [["0.1", "1", "a,b"], [repr(1 / 3), "2", 'say "on"'], ["nan", "4", "ü"]]
    Made().to_csv(path)  # replaces, and does not append
    assert len(path.read_text(encoding="utf-8").splitlines()) == 4


@pytest.mark.parametrize("ending", [".mat", ".npz"])
def test_missing_text_is_empty_and_a_missing_number_is_nan_in_arrays(ending, tmp_path):
    class Holed(Made):
        def columns(self):
            columns = {"error": ["late", None], "found": [None, True], "empty": [None, None]}
            return {name: np.array(values, dtype=object) for name, values in columns.items()}

    Holed().save(path := tmp_path / f"t{ending}")
    found = loadmat(path, simplify_cells=True) if ending == ".mat" else np.load(path)
    texts = [[str(text) if len(text) else "" for text in found[x]] for x in ("error", "empty")]
    assert texts == [["late", ""], ["", ""]]
    np.testing.assert_array_equal(found["found"], [np.nan, 1.0])


def test_columns_of_different_lengths_write_no_file(tmp_path):
    class Torn(Made):
        def columns(self):
            return {"a": np.arange(2), "b": np.arange(3)}

    with pytest.raises(ValueError, match="argument"):
        Torn().to_csv(tmp_path / "t.csv")
    assert not list(tmp_path.iterdir())


def test_an_object_without_a_picture_says_so_by_its_class():
    with pytest.raises(TypeError, match=r"^there is no picture of a Made$"):
        Made().plot()


def test_options_and_axes_of_a_plot_go_to_the_picture_of_the_class():
    class Drawn(Shown):
        pass

    @picture.register(Drawn)
    def _drawn(one, ax=None, **options):
        return one, ax, options

    one = Drawn()
    assert one.plot("axes", by="slope") == (one, "axes", {"by": "slope"})
    assert one.plot() == (one, None, {})


@pytest.mark.parametrize("hidden", [True, False])
def test_a_missing_library_is_named_with_its_extra(hidden, monkeypatch):
    name = "json" if hidden else "no_such_module_of_anyone"
    if hidden:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        ImportError,
        match=rf'^this needs {name}, which is not installed: pip install "gym-.*\[x\]"$',
    ) as lacking:
        need(name, "x")
    assert lacking.value.name == name
    with pytest.raises(ImportError, match=rf"this needs {name}.*\[y\]"), extra("y"):
        __import__(name)


def test_a_library_that_is_there_and_fails_is_reported_with_its_own_words():
    said = (
        "this needs json, which cannot be imported (cannot import name 'no_such_name' from 'json'"
    )
    with pytest.raises(ImportError, match=re.escape(said)) as lacking, extra("x"):
        from json import no_such_name  # noqa: F401
    assert str(lacking.value).endswith('too old: pip install --upgrade "gym-passive-walker[x]"')


def test_what_is_installed_or_fails_otherwise_is_left_alone():
    need("json", "x")
    need("numpy", "x")
    with pytest.raises(KeyError), extra("x"):
        raise KeyError
