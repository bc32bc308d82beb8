"""The pictures of the entry page are those of the scripts that their pages show."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from gallery.moving import (
    CARDS,
    ENTRY,
    FILES,
    FOLDER,
    NAMES,
    OVERVIEW,
    SCRIPTS,
    WIDTH,
    Card,
    overview,
    page_text,
    run,
    with_table,
)
from gallery.moving_svg import svg

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.view.studio.presets import cards

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
#: Of a picture, tenths of a pixel of 3600: other processors round otherwise, which impacts enlarge.
_AWAY = 30.0
LARGEST, LARGEST_SUM = 200_000, 3_000_000  # bytes


def test_every_script_is_a_card() -> None:
    assert sorted(NAMES) == sorted(path.stem for path in SCRIPTS.glob("*.py"))
    assert len(CARDS) == 24
    assert len({card.title for card in CARDS}) == len(CARDS)


def test_pages_are_those_of_the_scripts() -> None:
    for card in CARDS:
        stored = (FOLDER / f"{card.name}.md").read_text(encoding="utf-8")
        assert stored == page_text(card), "run `make gallery`"
        assert card.sentence.count(".") == 1
        assert "\n" not in card.sentence
    entry = ENTRY.read_text(encoding="utf-8")
    assert entry == with_table(entry), "run `make gallery`"
    assert OVERVIEW.read_text(encoding="utf-8") == overview(), "run `make gallery`"


def test_pictures_are_small() -> None:
    sizes = [(FOLDER / f"{name}.svg").stat().st_size for name in NAMES]
    assert max(sizes) < LARGEST
    assert sum(sizes) + OVERVIEW.stat().st_size < LARGEST_SUM


def places(text: str) -> list[np.ndarray]:
    """Return the points of the animated parts of a picture, one array for each value."""
    found = []
    for values in re.findall(r' values="([^"]*)"', text):
        for value in values.split(";"):
            numbers = [float(number) for number in _NUMBER.findall(value)]
            if value.startswith("M"):  # points are relative to the one before
                lines = [
                    np.reshape(np.float64(_NUMBER.findall(k)), (-1, 2))
                    for k in value.split("M")[1:]
                ]
                numbers = (
                    np.concatenate([np.cumsum(line, axis=0) for line in lines]).ravel().tolist()
                )
            found.append(np.array(numbers))
    return found


@pytest.mark.sampled("boom")
@pytest.mark.parametrize("card", CARDS, ids=NAMES)
def test_script_makes_the_picture(card: Card, tmp_path: Path) -> None:
    scope = run(card, tmp_path)
    made, stored = (
        (folder / f"{card.name}.svg").read_text(encoding="utf-8") for folder in (tmp_path, FOLDER)
    )
    assert re.sub(_NUMBER, "", re.sub(r'"[^"]*"', "", made)) == re.sub(
        _NUMBER, "", re.sub(r'"[^"]*"', "", stored)
    ), "run `make gallery`"
    pairs = list(zip(places(made), places(stored), strict=True))
    assert len(pairs) > 100
    for ours, theirs in pairs:
        scale = 1e4 / 3600.0 if ours.size == 1 else 1.0  # the path of the tip counts to 10,000
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=_AWAY * scale)
    files = [
        (folder / f"{card.name}.yaml").read_text(encoding="utf-8") for folder in (tmp_path, FOLDER)
    ]
    assert re.sub(_NUMBER, "", files[0]) == re.sub(_NUMBER, "", files[1])
    if (FILES / f"{card.name}.yaml").exists():
        check_file(card, scope)


def check_file(card: Card, scope: dict[str, object]) -> None:
    """Check that the run of a card's file is that of the script; of a study, all drives."""
    runs = scope.get("runs", {"": scope["run"]} if "run" in scope else {})
    assert isinstance(runs, dict)
    (project,) = [make() for title, _, make in cards() if title == card.title]
    ours = [prepare(side.scenario).run(progress=False) for side in project.sides]
    theirs = list(runs.values())[::-1][: len(ours)]
    reach = sum(link.length for link in project.record.arm.links)
    for result, expected in zip(ours, theirs, strict=True):
        assert result.time.values[-1] == pytest.approx(expected.time.values[-1])
        tips = (dataset.tip.values[:, :2] for dataset in (result, expected))
        # Tables of an angle and of a force are splines through points of the script's functions.
        np.testing.assert_allclose(*tips, rtol=0.0, atol=2e-3 * reach)


def test_files_of_the_package_are_those_of_the_pages() -> None:
    for path in FILES.glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        assert text == (FOLDER / path.name).read_text(encoding="utf-8"), "run `make gallery`"
        (card,) = [card for card in CARDS if card.name == path.stem]
        assert text.startswith(f"# {card.title}: {card.sentence}\n"), "run `make gallery`"
    assert len(cards()) == len(list(FILES.glob("*.yaml"))) == 18


def circles(text: str, look: str) -> np.ndarray:
    """Return the centres of a disk at the frames, (F + 1, 2) with the last frame repeated."""
    part = text.split(f'<circle class="{look}"')[1].split("</circle>")[0]
    axes = [
        re.search(rf'attributeName="{name}"[^>]*values="([^"]*)"', part) for name in ("cx", "cy")
    ]
    assert all(axes)
    return np.array([np.float64(axis[1].split(";")) for axis in axes if axis]).T


def test_tip_is_in_its_place_at_every_frame() -> None:
    """The bar of length states the scale; y points down."""
    link = fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=0.5)
    arm = fa.Arm(links=[link], payload=fa.Payload(mass=0.3))
    run = fa.simulate(arm, 0.5, torque=lambda t: [1.0], rate=200.0)
    animation = fa.animate(run, channels="joint_angle", fps=20.0, speed=0.5, magnify=1.0)
    text = svg(animation.scenes, 20.0, 0.5, WIDTH)
    places = circles(text, "payload")
    assert len(places) == 22
    bar = re.search(r'd="M\d+ \d+h-(\d+)"/><text[^>]*>([\d.]+) m<', text)
    assert bar is not None
    scale = float(bar[1]) / float(bar[2])
    tips = animation.scenes[0].links[:, -1, -1]
    moved = (tips - tips[0]) * [scale, -scale]
    np.testing.assert_allclose(places[:-1] - places[0], moved, atol=1.0 + 1e-3 * scale)
    assert (places[-1] == places[-2]).all()
    assert ">speed × 0.5<" in text
    assert "Joint angle, 0 to " in text


def test_factor_on_the_bending_is_stated() -> None:
    link = fa.Link(length=1.0, flexural_rigidity=500.0, mass_per_length=0.5)
    run = fa.simulate(fa.Arm(links=[link]), 0.3, torque=lambda t: [1.0])
    animation = fa.animate(run, channels=[])
    text = svg(animation.scenes, animation.fps, 1.0, WIDTH)
    assert f">bending × {animation.scenes[0].magnify:g}<" in text
    assert 'class="true"' in text
    assert text.count("<animate ") == text.count(" keyTimes=")
    for keys, values in re.findall(r'keyTimes="([^"]*)" values="([^"]*)"', text):
        times = np.float64(keys.split(";"))
        assert times[[0, -1]].tolist() == [0.0, 1.0]
        assert (np.diff(times) > 0.0).all()
        assert len(times) == len(values.split(";"))
