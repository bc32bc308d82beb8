"""The studio in a browser: loads, contacts, instruments, tables and the plants of a study."""

from __future__ import annotations

import runpy

import numpy as np
import pytest
from studio_server import LENGTH, SCENARIO, assert_shows, scene_of

import flexarm as fa
from flexarm.view.studio.state import open_bytes

pytestmark = pytest.mark.thorough

NEW_LOAD, FORCE = "loads.<new>", "loads[0].force[1]"
TABLE = "loads[0].factor.<table>"


def saved(window, item="Save the scenario"):
    """The project of a file that the window saves."""
    name, content = window.save("Save", item)
    return open_bytes(content, name)


@pytest.fixture
def loaded(window):
    """A window with a load at the tip."""
    window.open_group("Loads")
    window.press(NEW_LOAD)
    window.set(FORCE, "-20")
    return window


def test_a_load_is_added_changed_and_removed(loaded):
    project = saved(loaded)
    assert project.record.loads == (fa.Load(link=2, force=(0.0, -20.0)),)
    assert_shows(loaded, project)
    bent = loaded.pixels()
    before = loaded.number
    loaded.press("loads[0].<remove>")
    loaded.wait_for_picture(before)
    assert saved(loaded).record.loads == ()
    assert np.abs(loaded.pixels() - bent).max() > 100
    before = loaded.number
    loaded.page.get_by_role("button", name="Undo").click()
    loaded.wait_for_picture(before)
    assert loaded.value(FORCE) == -20.0
    assert np.array_equal(loaded.pixels(), bent)


def test_a_load_that_is_not_on_the_arm_is_refused_beside_its_field(loaded):
    loaded.type("loads[0].force[0]", "strong")
    loaded.field("loads[0].force[0]").locator(".message").wait_for()
    assert loaded.message("loads[0].force[0]") == (
        "loads[0].force[0] must be a number, got 'strong'. Write the bare number, in SI units."
    )
    loaded.open_part("loads[0].station")
    loaded.type("loads[0].station", "7")
    loaded.field("loads[0].station").locator(".message").wait_for()
    assert loaded.message("loads[0].station") == (
        "loads[0].station must be at most 0.5 (the length of the link), got 7."
    )
    assert saved(loaded).record.loads[0].station is None


def test_a_table_is_text_of_numbers(loaded):
    loaded.open_part("loads[0].factor.<new>")
    before = loaded.number
    loaded.press("loads[0].factor.<new>")
    loaded.wait_for_picture(before)
    assert loaded.text(TABLE) == "times, values\n0, 0\n0.25, 1\n0.5, 1"
    before = loaded.number
    loaded.type_table(TABLE, "times, values\n0, 0\n0.1, 2\n0.4, 0")
    loaded.wait_for_picture(before)
    project = saved(loaded)
    assert project.record.loads[0].factor.values == (0.0, 2.0, 0.0)
    assert_shows(loaded, project)
    loaded.type_table(TABLE, "times, values\n0, 0\n-0.1, 2")
    loaded.field(TABLE).locator(".message").wait_for()
    assert loaded.message(TABLE) == (
        "loads[0].factor.times[1] must be at least 0 (the previous time), got -0.1."
    )


def test_a_wall_is_on_the_screen_and_another_surface_replaces_it(window):
    window.plain()
    free = window.pixels(".picture .arm canvas")
    window.open_group("Contacts")
    before = window.number
    window.press("contacts.<new>")
    window.wait_for_picture(before)
    wall = window.pixels(".picture .arm canvas")
    assert np.abs(wall - free).max() > 20
    window.choose("contacts[0].surface.kind", "round")
    assert np.abs(window.pixels(".picture .arm canvas") - wall).max() > 20
    window.type("contacts[0].stiffness", "-1")
    window.field("contacts[0].stiffness").locator(".message").wait_for()
    assert window.message("contacts[0].stiffness") == (
        "contacts[0].stiffness must be greater than 0, got -1."
    )
    assert saved(window).record.contacts[0].surface.kind == "round"


def test_all_drives_are_in_the_list_under_titles(window):
    page = window.page
    window.field("drive.kind").locator(".q-select").click()
    title = page.get_by_role("option", name="joint control", exact=True)
    title.wait_for()
    assert title.get_attribute("aria-disabled") == "true"
    page.get_by_role("option", name="LQG", exact=True).click()
    window.field("drive.preview").wait_for()
    window.wait_until_idle()
    project = saved(window)
    assert project.record.drive.kind == "lqg"
    assert_shows(window, project)


def test_instruments_and_motors(window):
    window.choose("drive.kind", "joint PD")
    window.open_group("Hardware")
    window.press("hardware.<new>")
    window.open_part("hardware.motors.<new>")
    window.press("hardware.motors.<new>")
    window.press("hardware.instruments.<new>")
    window.set("hardware.instruments[0].noise", "0.001")
    window.wait_until_idle()
    hardware = saved(window).record.hardware
    assert [(item.signal, item.noise) for item in hardware.instruments] == [
        ("joint_angle", 0.001),
        ("joint_rate", 0.0),
    ]
    assert hardware.motors == fa.Motors()


def test_a_script_reproduces_loads_and_contacts(loaded, tmp_path):
    loaded.open_group("Contacts")
    before = loaded.number
    loaded.press("contacts.<new>")
    loaded.wait_for_picture(before)
    name, content = loaded.save("Export", "Python script")
    path = tmp_path / name
    path.write_bytes(content)
    expected = fa.run_scenario(saved(loaded).scenario)
    np.testing.assert_array_equal(runpy.run_path(str(path))["result"].tip, expected.tip)


STUDY = SCENARIO.replace("motion: ", "motions:\n  line: ").replace("drive: ", "drives:\n  rigid: ")


def test_plants_of_a_study_are_copied_renamed_changed_and_removed(window, tmp_path):
    path = tmp_path / "plants.yaml"
    path.write_text(STUDY, encoding="utf-8")
    page, before = window.page, window.number
    window.open(path)
    window.wait_for_picture(before)
    page.get_by_role("button", name="Copy the plant").click()
    page.locator(".choice", has_text="as believed 2").wait_for()
    page.get_by_role("button", name="Rename the plant").click()
    box = page.get_by_label("name of the plant")
    box.fill("heavy")
    box.press("Enter")
    page.locator(".choice", has_text="heavy").wait_for()
    window.set("plant.payload_factor", "3")
    project = saved(window, "Save the study")
    assert {name: plant.payload_factor for name, plant in project.record.plants.items()} == {
        "as believed": 1.0,
        "heavy": 3.0,
    }
    window.plain()
    heavy = scene_of(project.chosen(plant="heavy"))
    np.testing.assert_allclose(window.tip(heavy["view"]), heavy["links"][0][-1][-1], atol=0.008)
    page.get_by_role("button", name="Remove the plant").click()
    window.wait_until_idle()
    assert list(saved(window, "Save the study").record.plants) == ["as believed"]
    page.get_by_role("button", name="Remove the plant").click()
    page.get_by_text("plants must be a mapping with at least one name").wait_for()


def test_the_keyboard_adds_and_removes_a_load(window):
    page = window.page
    window.open_group("Loads")
    window.field(NEW_LOAD).locator("button").focus()
    before = window.number
    page.keyboard.press("Enter")
    window.wait_for_picture(before)
    page.locator('[data-path^="loads[0]."] :focus').wait_for()
    window.field("loads[0].<remove>").locator("button").focus()
    before = window.number
    page.keyboard.press("Enter")
    window.wait_for_picture(before)
    page.locator(f'[data-path="{NEW_LOAD}"] button:focus').wait_for()
    assert saved(window).record.loads == ()


def test_two_windows_have_their_own_loads(new_window):
    one, two = new_window(), new_window()
    for window, force in ((one, "-10"), (two, "15")):
        window.open_group("Loads")
        window.press(NEW_LOAD)
        window.set(FORCE, force)
    for window, force in ((one, -10.0), (two, 15.0)):
        project = saved(window)
        assert project.record.loads[0].force[1] == force
        assert_shows(window, project)


def test_rapid_changes_of_a_load_end_with_the_picture_of_the_last(loaded):
    page = loaded.page
    loaded.field(FORCE).locator(".q-slider__track-container").focus()
    for k in range(200):
        page.keyboard.press("ArrowRight" if k % 5 else "ArrowLeft")
    loaded.wait_until_idle()
    project = saved(loaded)
    assert project.record.loads[0].force[1] == loaded.value(FORCE)
    assert_shows(loaded, project)


def test_lists_and_tables_fit_on_a_narrow_screen(new_window):
    window = new_window(360, 740)
    page = window.page
    window.open_group("Loads")
    window.press(NEW_LOAD)
    window.open_part("loads[0].factor.<new>")
    window.press("loads[0].factor.<new>")
    window.field(TABLE).locator("textarea").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    for path in (FORCE, TABLE, "loads[0].<remove>", LENGTH):
        box = window.field(path).bounding_box()
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= 360.0
