"""An arm of three links with a controller is built in a window, by mouse and by keyboard."""

from __future__ import annotations

import numpy as np
import pytest
from studio_server import assert_shows

from flexarm.view.studio.state import open_bytes

pytestmark = pytest.mark.thorough

COPY, MOVE, REMOVE = (f"arm.links[1].<{word}>" for word in ("copy", "move", "remove"))


def saved(window):
    name, content = window.save("Save", "Save the scenario")
    return open_bytes(content, name)


@pytest.mark.parametrize("way", ["mouse", "keyboard"])
def test_an_arm_of_three_links_with_a_controller_is_built(new_window, way):
    window = new_window()

    def press(path):
        button = window.field(path).locator("button")
        if way == "mouse":
            button.click()
        else:
            button.focus()
            button.press("Enter")
        window.wait_until_idle()

    press(COPY)
    window.open_group("Link 3")
    window.set("arm.links[2].length", "0.3")
    window.choose("motion.kind", "joint")
    window.choose("drive.kind", "joint PD")
    project = saved(window)
    assert [link.length for link in project.record.arm.links] == [0.6, 0.5, 0.3]
    assert project.record.drive.kind == "joint_pd"
    assert len(project.record.motion.end) == 3
    assert_shows(window, project)
    before = window.pixels()
    press(MOVE)
    assert [link.length for link in saved(window).record.arm.links] == [0.6, 0.3, 0.5]
    assert np.abs(window.pixels()[: len(before)] - before).max() > 100
    press(REMOVE)
    assert [link.length for link in saved(window).record.arm.links] == [0.6, 0.5]
    for _ in range(2):
        window.page.get_by_role("button", name="Undo").click()
        window.wait_until_idle()
    assert saved(window).record == project.record
