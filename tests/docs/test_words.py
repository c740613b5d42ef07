"""The rules of `styles/Walker` hold for the prose of the repository, and can be read by Vale."""

import configparser
import re
from pathlib import Path

import pytest

from tests import words

EXAMPLES = [
    "A walker whose knee locks.",
    "A walker who falls.",
    "Noise befalls a walker.",
    "The fate of a walker.",
    "The kernel is told a slope.",
    "It begins anew.",
    "Push-offs likewise.",
    "The speed as of the gait.",
    "Nonsense is refused.",
    "A strobe picture of a walk.",
    "The source document has it.",
    "It walks on the level.",
    "Checked at each door.",
    "A crowd of walkers.",
    "An array of truths.",
    "The walk is looked at.",
    "A linear programme.",
    "Rules of reality end it.",
    "They walked on.",
    "A film of a walk.",
    "One processor.",
    "An error with its remedy.",
    "A kick forwards.",
    "The leg goes over the top.",
    "An optimised gait.",
]
"""A sentence for each term, in the order of the terms."""

KEYS = {
    "substitution": {"swap", "ignorecase"},
    "occurrence": {"token", "max"},
}
"""What a rule of each kind has besides `extends`, `message`, `level` and `scope`."""

TERMS, LENGTH = (next(rule for rule in words.RULES if rule["extends"] == kind) for kind in KEYS)


def test_each_rule_is_one_that_vale_reads():
    for rule in words.RULES:
        assert set(rule) == {"extends", "message", "level", "scope"} | KEYS[rule["extends"]]
        assert rule["level"] == "error"  # Vale fails on errors only
        assert rule["message"].count("%s") == {"substitution": 2, "occurrence": 1}[rule["extends"]]
    assert TERMS["scope"] == "text" and LENGTH["scope"] == "sentence"
    for term, instead in TERMS["swap"].items():
        assert re.compile(term).groups == 0, term  # Vale numbers terms by their groups
        assert isinstance(instead, str) and not re.search(r"[|$%]", instead), term


def test_vale_is_configured_to_read_the_rules():
    text = (words.ROOT / ".vale.ini").read_text(encoding="utf-8")
    settings = configparser.RawConfigParser()
    settings.read_string(f"[core]\n{text}")
    assert list((words.ROOT / settings["core"]["StylesPath"]).iterdir()) == [words.STYLE]
    for files in ("*.md", "*.py"):
        assert settings[files]["BasedOnStyles"] == words.STYLE.name
    names = {f"{words.STYLE.name}.{path.stem}" for path in words.STYLE.glob("*.yml")}
    assert names.isdisjoint(name for part in settings.values() for name in part)  # none is off


@pytest.mark.parametrize(("term", "sentence"), [*zip(TERMS["swap"], EXAMPLES, strict=True)])
def test_each_term_stops_a_sentence(term, sentence):
    (breach,) = words.breaches(sentence)
    assert breach.startswith(f"Write '{TERMS['swap'][term]}' instead of"), breach


def test_a_sentence_of_more_than_thirty_words_is_stopped():
    assert list(words.breaches(" ".join(["word"] * 30))) == []
    assert list(words.breaches(" ".join(["word"] * 31), short=True)) == []
    (breach,) = words.breaches(" ".join(["word"] * 31))
    assert "may have 30 words; this one has 31" in breach


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("page.md", "A walker who falls.", ["who"]),
        ("page.md", "People who read `who` in\n```\nwhose\n```\n", []),
        ("page.md", "It begins anew.", ["anew"]),
        ("page.md", " ".join(["word"] * 31) + ".", ["31"]),
        (
            "page.md",
            "# A fate\n\n| who | that |\n|---|---|\n| a | told |\n",
            ["fate", "who", "told"],
        ),
        ("module.py", "x = 1  # told by the caller", ["told"]),
        ("module.py", 'raise ValueError(f"{x} is told")', ["told"]),
        ("module.py", '"""It is told."""', ["told"]),
        ("module.py", f'"""{" ".join(["word"] * 31)}."""', ["31"]),
        ("module.py", f"# {' '.join(['word'] * 31)}.", []),
    ],
)
def test_prose_of_pages_and_modules_is_found(name, text, said, tmp_path, monkeypatch):
    monkeypatch.setattr(words, "ROOT", tmp_path)
    path: Path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    found = list(words.faults(path))
    assert len(found) == len(said) and all(
        part in one for part, one in zip(said, found, strict=True)
    )
