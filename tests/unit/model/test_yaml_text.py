"""YAML read with and without libyaml: equal values, lines and messages, for any depth or length."""

from pathlib import Path

import pytest

import flexarm as fa
from flexarm.model.file_format import yaml_text
from flexarm.model.file_format.yaml_text import parse, to_yaml

FILE = Path("file.yaml")

RIGHT = [
    "a: 1\nb: [1, 2.5, 1e5, .5, -3., .inf, 0x1F, 0o17, 010]\n",
    "text: [yes, on, 1:30, 2024-01-02, 'quoted', \"tab\\t\", null, ~, true]\n",
    "base: &base {x: 1, y: 2}\nmore:\n  <<: *base\n  y: 3\nlist: [*base, *base]\n",
    "long: |\n  two\n  lines\nfolded: >-\n  one\n  line\n# a comment\nlast: end\n",
    "- [1, 2]\n- [3, 4]\n-\n  - 5\n  - 6\n",
    "twice: 1\ntwice: 2\nnested: {same: 1, same: 2}\n",
    "! tagged: !!set {a, b}\n",
    "\u00e4\u00f6: \u2113\n---\n"[:-4],
    "{a: 1, b: [2, {c: 3}], : 4}\n",
    "",
]
WRONG = [
    "a: [1, 2\nb: 3\n",
    "a: 1\n\tb: 2\n",
    "a: *nothing\n",
    "a: 'open\n",
    "a: 1\n---\nb: 2\n",
    "a: b: c\n",
    "a: \x00\n",
    "%YAML 3.0\n---\na\n",
]


def result_of(text):
    """Return value, problems and lines of a text, or the message of its error."""
    try:
        found = parse(FILE, text)
    except fa.InputError as error:
        return str(error)
    keys = list(found.value) if isinstance(found.value, dict) else range(len(found.value))
    lines = [found.where((key,)) for key in keys]
    return repr(found.value), [str(problem) for problem in found.problems], lines


@pytest.mark.parametrize("text", [*RIGHT, *WRONG])
def test_both_parsers_give_the_same_result(text, monkeypatch):
    fast = result_of(text)
    monkeypatch.setattr(yaml_text, "CParser", None)
    assert result_of(text) == fast


@pytest.mark.parametrize("text", WRONG)
def test_text_that_is_not_yaml_is_rejected_with_its_line(text):
    assert result_of(text).startswith("file.yaml:")


@pytest.mark.thorough_cases("[-]")
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ("{a: ", "}"), ("- ", "")])
def test_deep_nesting_is_rejected_without_a_crash(opening, closing):
    """The composer of libyaml overflows the stack here, which ends the process."""
    text = opening * 300_000 + closing * 300_000
    assert "nested too deeply" in result_of(text)


def test_values_are_counted_with_their_aliases(monkeypatch):
    """Lists and mappings count as values too: here 1 + (1 + 2) + (1 + 2)."""
    text = "a: &pair [1, 2]\nb: *pair\n"
    monkeypatch.setattr(yaml_text, "_MOST_VALUES", 7)
    assert parse(FILE, text).value == {"a": [1, 2], "b": [1, 2]}
    monkeypatch.setattr(yaml_text, "_MOST_VALUES", 6)
    assert "has more than 6 values with its aliases expanded" in result_of(text)


def test_lines_in_a_long_table(tmp_path):
    rows = [f"    - [{k}, 0.5]" for k in range(3000)]
    rows[1234] = "    - [soon, 0.5]"
    rows[2345] = "    - [1.0, 2.0, 3.0]"
    head = [
        "flexarm: 1",
        "arm: {links: [{length: 1, flexural_rigidity: 9, mass_per_length: 1}]}",
        "run: {duration: 1}",
        "drive:",
        "  kind: torque",
        "  rate: 1000",
        "  values:",
    ]
    file = tmp_path / "long.yaml"
    file.write_text("\n".join([*head, *rows]) + "\n")
    with pytest.raises(fa.ModelError) as caught:
        fa.load_scenario(file)
    lines = {int(problem.where.rpartition(":")[2]) for problem in caught.value.problems}
    assert len(head) + 1 + 1234 in lines
    assert len(head) + 1 + 2345 in lines


def test_table_is_written_and_read_back():
    content = {
        "values": [[k / 7.0, -1e-9 * k] for k in range(500)],
        "name": "\u00e4: b",
        "on": True,
    }
    text = to_yaml(content)
    assert parse(FILE, text).value == content
    assert text.startswith("values:\n- [0.0, -0.0]\n")


def test_long_lists_are_refused_before_their_end_is_read(monkeypatch):
    """The rest of the file is not YAML, which is not noticed."""
    monkeypatch.setattr(yaml_text, "_MOST_MAPPINGS", 3)
    text = "links:\n" + "  - {length: 1}\n" * 3
    assert len(parse(FILE, text).value["links"]) == 3
    assert parse(FILE, "[1, 2, 3, 4, 5]").value == [1, 2, 3, 4, 5]  # tables of numbers are longer
    wrong = text + "  - {length: 1}\n  - [[[}\n"
    assert result_of(wrong) == "file.yaml:5: the file has a list of more than 3 mappings."


def test_values_are_counted_before_the_end_is_read(monkeypatch):
    monkeypatch.setattr(yaml_text, "_MOST_VALUES", 10)
    assert "the file has more than 10 values" in result_of("[" + "1, " * 30 + "[[}")


@pytest.mark.thorough_cases("links: [{}]\\n")
@pytest.mark.parametrize("part", ["links: [{}]\n", "links: [{{length: 1.0, gauges: [{}]}}]\n"])
def test_files_of_many_links_or_gauges_are_refused(part, tmp_path):
    path = tmp_path / "many.yaml"
    entries = "{station: 0.1, distance: 0.01}, " * 100_000
    path.write_text("flexarm: 1\narm:\n  " + part.format(entries), encoding="utf-8")
    with pytest.raises(fa.ModelError, match="a list of more than 5000 mappings"):
        fa.load_arm(path)
