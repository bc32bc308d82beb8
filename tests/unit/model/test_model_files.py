"""Reading files: every problem with its place, scenarios with arm files, hostile content."""

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from model_bad_files import BAD_ARMS, BROKEN_FILES

from flexarm.base.errors import InputError, ModelError
from flexarm.model import (
    ArmSpec,
    Link,
    Payload,
    load_arm_spec,
    load_scenario,
    locate_scenario,
    locate_study,
)
from flexarm.model.wording import path_of, path_text

ARM = "flexarm: 1\narm:\n  links:\n    - {length: 2, flexural_rigidity: 1e2, mass_per_length: 5}\n"
SPEC = ArmSpec(links=[Link(length=2, flexural_rigidity=100, mass_per_length=5)])


def problems_of(load, path):
    """Return the problems of a file as "line: message"."""
    with pytest.raises(ModelError) as caught:
        load(path)
    return [str(problem).removeprefix(f"{path}:") for problem in caught.value.problems]


@pytest.mark.parametrize("name", BAD_ARMS)
def test_every_problem_of_a_bad_arm_has_its_line(name, tmp_path):
    text, problems = BAD_ARMS[name]
    (tmp_path / "arm.yaml").write_text(text)
    reported = problems_of(load_arm_spec, tmp_path / "arm.yaml")
    if problems is not None:
        assert reported == problems
    assert len(set(reported)) == len(reported)


def test_hundreds_of_problems_are_kept_and_some_are_printed(tmp_path):
    (tmp_path / "arm.yaml").write_text(BAD_ARMS["too many links"][0])
    with pytest.raises(ModelError) as caught:
        load_arm_spec(tmp_path / "arm.yaml")
    assert "arm.links must have 1 to 256 entries, got 300." in {
        str(problem).split(": ", 1)[1] for problem in caught.value.problems
    }
    assert len(caught.value.problems) == 601  # two for each link, one for their number
    assert str(caught.value).splitlines()[50:] == ["... and 551 more problems."]


@pytest.mark.thorough_cases("deep lists-load_arm_spec", "deep lists-load_scenario")
@pytest.mark.parametrize("load", [load_arm_spec, load_scenario])
@pytest.mark.parametrize("name", BROKEN_FILES)
def test_unreadable_files_give_one_clear_error(name, load, tmp_path):
    content, message = BROKEN_FILES[name]
    path = tmp_path / "arm.yaml"
    path.write_bytes(content)
    with pytest.raises(ModelError) as caught:
        load(path)
    if message is not None:
        assert str(caught.value).startswith(f"{path}{message}")
        one_problem = {problem.value for problem in caught.value.problems}
        assert len(one_problem) == 1
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


def test_list_that_contains_itself_is_rejected(tmp_path):
    (tmp_path / "arm.yaml").write_text("flexarm: 1\narm: &a\n  links: [*a]\n")
    assert problems_of(load_arm_spec, tmp_path / "arm.yaml")[0] == (
        "2: arm.links[0] is an alias of a value that contains it."
    )


def test_tabs_are_explained(tmp_path):
    (tmp_path / "arm.yaml").write_bytes(BROKEN_FILES["tab"][0])
    with pytest.raises(ModelError, match=r"Indent with spaces\.$"):
        load_arm_spec(tmp_path / "arm.yaml")


def test_missing_files_and_folders_are_rejected(tmp_path):
    (tmp_path / "robot.yaml").write_text(ARM)
    for load in (load_arm_spec, load_scenario):
        with pytest.raises(ModelError) as caught:
            load(tmp_path / "robt.yaml")
        assert str(caught.value) == (
            f"{tmp_path / 'robt.yaml'}: the file does not exist. "
            f"Did you mean {str(tmp_path / 'robot.yaml')!r}?"
        )
        with pytest.raises(ModelError, match="the file is a directory"):
            load(tmp_path)
        with pytest.raises(ModelError, match="the file does not exist"):
            load(tmp_path / "nowhere" / "arm.yaml")
        with pytest.raises(InputError, match=r"arm\\x00\.yaml"):
            load("arm\0.yaml")


def test_byte_order_marks_windows_lines_and_text_paths_are_accepted(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + ARM.replace("\n", "\r\n").encode())
    assert load_arm_spec(str(path)) == SPEC


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e5", 1e5),
        ("70e9", 70e9),
        ("1.5E-3", 1.5e-3),
        ("+2", 2.0),
        (".5", 0.5),
        ("2.", 2.0),
        ("010", 10.0),
        ("0x10", 16.0),
        ("0o10", 8.0),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text, value, tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM.replace("length: 2", f"length: {text}"))
    assert load_arm_spec(tmp_path / "arm.yaml").links[0].length == value


def test_numbers_with_thousands_of_digits_are_not_finite(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM.replace("length: 2", f"length: {'9' * 5000}"))
    assert problems_of(load_arm_spec, tmp_path / "arm.yaml") == [
        "4: arm.links[0].length must be a finite number, got inf."
    ]


def test_scenario_may_name_an_arm_file_beside_it(tmp_path):
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "long.yaml").write_text(ARM)
    (tmp_path / "arms" / "main.yaml").write_text("flexarm: 1\narm: long.yaml\nrun: {}\n")
    (tmp_path / "run.yaml").write_text("flexarm: 1\narm: arms/main.yaml\nrun: {duration: 1}\n")
    assert load_scenario(tmp_path / "run.yaml").arm == SPEC
    assert load_arm_spec(tmp_path / "run.yaml") == SPEC


def test_problems_are_reported_in_their_file(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM.replace("length: 2", "length: -2") + "runs: 3\n")
    (tmp_path / "run.yaml").write_text(
        "flexarm: 1\nrun: {duration: 0}\narm: arm.yaml\ninitial: {joint_rate: [0, 0]}\n"
    )
    with pytest.raises(ModelError) as caught:
        load_scenario(tmp_path / "run.yaml")
    reported = [str(problem).removeprefix(f"{tmp_path}/") for problem in caught.value.problems]
    assert sorted(reported) == [
        "arm.yaml:4: arm.links[0].length must be greater than 0, got -2.",
        "arm.yaml:5: runs is not a known key. Did you mean 'run'?",
        "run.yaml:2: run.duration must be greater than 0, got 0.",
        ("run.yaml:4: initial.joint_rate must have length 1, one value for each joint, got 2."),
    ]


def test_named_arm_files_that_cannot_be_read_are_rejected(tmp_path):
    (tmp_path / "run.yaml").write_text("flexarm: 1\nrun: {duration: 0}\narm: arm.yaml\n")
    with pytest.raises(ModelError) as caught:
        load_scenario(tmp_path / "run.yaml")
    assert str(caught.value).splitlines() == [
        f"{tmp_path}/run.yaml:2: run.duration must be greater than 0, got 0.",
        (f"{tmp_path}/arm.yaml: the file does not exist. It is named in {tmp_path}/run.yaml:3."),
    ]
    (tmp_path / "arm.yaml").write_text("flexarm: 1\narm: run.yaml\n")
    assert problems_of(load_arm_spec, tmp_path / "arm.yaml") == [
        f"{tmp_path}/run.yaml:3: arm refers to itself through a circle of files."
    ]


def test_circular_references_of_files_are_rejected(tmp_path, monkeypatch):
    """Paths are relative to the file that contains them, not to the working directory."""
    (tmp_path / "arms").mkdir()
    (tmp_path / "run.yaml").write_text("flexarm: 1\nrun: {duration: 1}\narm: arms/arm.yaml\n")
    (tmp_path / "arms" / "arm.yaml").write_text("flexarm: 1\narm: ../arms/../run.yaml\n")
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / "run.yaml", "run.yaml", "arms/../run.yaml"):
        with pytest.raises(ModelError) as caught:
            load_scenario(path)
        (problem,) = caught.value.problems
        assert problem.where.endswith("arm.yaml:2")
        assert "refers to itself through a circle of files." in str(problem)


def test_scenario_file_of_the_manual(tmp_path):
    (tmp_path / "run.yaml").write_text(
        ARM.replace(
            "  links:\n", "  gravity: [0, 0]\n  payload: {mass: 2, offset: 0.1}\n  links:\n"
        )
        + "motion: {kind: line, start: [1, 0.5], end: [0.5, 1], duration: 1.0}\n"
        "drive: {kind: rigid_inverse_dynamics}\n"
        "run: {duration: 2.0, rate: 1000, integrator: auto}\n"
    )
    scenario = load_scenario(tmp_path / "run.yaml")
    assert scenario.arm == SPEC.replace(payload=Payload(mass=2, offset=(0.1, 0)))
    assert scenario.motion.kind == "line"
    assert scenario.drive.kind == "rigid_inverse_dynamics"
    assert (scenario.run.duration, scenario.run.rate) == (2.0, 1000.0)


def test_arm_file_is_not_a_scenario(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM)
    assert problems_of(load_scenario, tmp_path / "arm.yaml") == [
        (
            "1: the file has an arm only, so it is not a scenario. Add `run: {duration: 2}` to"
            " simulate it. `flexarm check`, `modes` and `linearize` read an arm alone."
        )
    ]


def test_arm_file_is_not_a_study(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM)
    assert problems_of(locate_study, tmp_path / "arm.yaml") == [
        (
            "1: the file has an arm only, so it is not a study. `flexarm check`, `modes` and"
            " `linearize` read an arm alone."
        )
    ]


def test_arm_can_be_read_if_other_parts_of_its_scenario_are_wrong(tmp_path):
    (tmp_path / "run.yaml").write_text(ARM + "run: {duration: -1}\n")
    assert load_arm_spec(tmp_path / "run.yaml") == SPEC


SOUND = {
    "arm": {
        "gravity": [0, -9.81],
        "theory": "linear",
        "payload": {"mass": 1, "inertia": 0.1, "offset": [0.1, 0]},
        "joints": [{"damping": 0.1}, {"mass": 1, "hub_inertia": 0.1}],
        "links": [
            {"length": 1, "flexural_rigidity": 1, "mass_per_length": 1, "elements": 3, "modes": 4},
            {
                "length": 2,
                "material": {"density": 1, "youngs_modulus": 1},
                "section": {"kind": "box", "width": 0.1, "height": 0.1, "thickness": 0.01},
                "damping": {"kind": "modal", "ratio": [0.1, 0.1]},
                "gauges": [{"station": 1, "distance": 0.1}],
            },
        ],
    },
    "motion": {"kind": "joint", "start": [0, 0], "end": [1, 1], "duration": 1},
    "drive": {"kind": "joint_pd", "proportional": 1, "derivative": [1, 1], "sample_time": 0.01},
    "initial": {"joint_angle": [0, 0], "joint_rate": [0, 0]},
    "run": {"duration": 1, "rate": 100, "rtol": 0.1, "step": 0.01},
}

PUSHED = SOUND | {
    "drive": {"kind": "torque", "rate": 10, "values": [[0, 0], [1, 1]]},
    "prescribed": [
        {"kind": "motion", "joint": 1},
        {"kind": "table", "joint": 2, "times": [0, 1], "angles": [0, 1], "ends": "free"},
    ],
    "loads": [
        {"link": 1, "force": [0, 1], "moment": 0.1, "station": 1},
        {
            "link": 2,
            "force": [0, 1],
            "spread": [0.5, 1],
            "frame": "link",
            "factor": {"times": [0, 1], "values": [0, 1]},
        },
    ],
    "base_acceleration": {"times": [0, 1], "values": [[0, 0], [0, 1]]},
    "events": [
        {"kind": "joint_angle", "joint": 1, "angle": 0.5, "direction": "rising", "terminal": True},
        {"kind": "tip_line", "point": [0, 1], "normal": [0, 1]},
    ],
    "initial": {"joint_angle": [0, 0], "equilibrium": True, "balance": True},
}


def leaves(content, path=()):
    """Yield the path of every value in nested mappings and lists that is neither."""
    if isinstance(content, dict | list):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in items:
            yield from leaves(value, (*path, key))
    elif path[-1] != "kind":  # a wrong kind hides all other problems
        yield path


def damaged(content, path, value):
    """Return nested mappings and lists with one value replaced."""
    if not path:
        return value
    items = content.items() if isinstance(content, dict) else enumerate(content)
    parts = {k: damaged(v, path[1:], value) if k == path[0] else v for k, v in items}
    return parts if isinstance(content, dict) else list(parts.values())


def key_path(path):
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).removeprefix(".")


@pytest.mark.thorough_cases("pushed")
@pytest.mark.parametrize("sound", [SOUND, PUSHED], ids=["moved", "pushed"])
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), value=st.sampled_from([".nan", "{}", "[[]]", "wrong"]))
def test_each_of_many_problems_is_reported_at_its_line(sound, data, value, tmp_path):
    places = data.draw(
        st.lists(st.sampled_from(sorted(leaves(sound), key=str)), unique=True, min_size=1)
    )
    content = sound
    for place in places:
        content = damaged(content, place, "@" + str(places.index(place)))
    text = "flexarm: 1\n" + yaml.safe_dump(content)
    lines = {}
    for i in reversed(range(len(places))):  # '@10' before '@1'
        before, _, after = text.partition(f"'@{i}'")
        lines[places[i]] = before.count("\n") + 1
        text = before + value + after
    (tmp_path / "run.yaml").write_text(text)
    reported = set(problems_of(load_scenario, tmp_path / "run.yaml"))
    for place in places:
        where = f"{lines[place]}: {key_path(place)}"
        inside = [
            problem for problem in reported if problem.startswith((f"{where} must", f"{where}."))
        ]
        # A pair of numbers is one value to the reader, which rejects it as a whole.
        whole = f": {key_path(place[:-1])} must be a list of two numbers"
        assert inside or any(whole in problem for problem in reported), (where, reported)


@pytest.mark.parametrize("sound", [SOUND, PUSHED], ids=["moved", "pushed"])
def test_undamaged_file_is_valid(sound, tmp_path):
    (tmp_path / "run.yaml").write_text("flexarm: 1\n" + yaml.safe_dump(sound))
    assert load_scenario(tmp_path / "run.yaml").drive.kind == sound["drive"]["kind"]


def test_key_paths_are_parsed():
    for path in {*leaves(SOUND), *leaves(PUSHED)}:
        assert path_of(path_text(path)) == path


def test_scenario_keeps_the_lines_of_its_keys(tmp_path):
    (tmp_path / "arm.yaml").write_text(ARM)
    (tmp_path / "run.yaml").write_text(
        "flexarm: 1\narm: arm.yaml\nrun:\n  duration: 1\n  rate: 10\n"
    )
    scenario, where = locate_scenario(tmp_path / "run.yaml")
    assert scenario == load_scenario(tmp_path / "run.yaml")
    assert where(("run", "rate")) == f"{tmp_path / 'run.yaml'}:5"
    assert where(("arm", "links", 0, "length")) == f"{tmp_path / 'arm.yaml'}:4"
    assert where(("run", "step")) == f"{tmp_path / 'run.yaml'}:3"  # the nearest existing parent


FLOW = "{flexarm: 1, arm: {links: [{length: 2, flexural_rigidity: 100, mass_per_length: 5}]}}"
LONG = {
    "block": "\n" * 100_000 + ARM,
    "flow": "\n" * 100_000 + f"  {FLOW}",
    "in braces": "{" + "\n" * 100_000 + FLOW[1:],
    "indented": " " * 100_000 + FLOW,
}


@pytest.mark.parametrize("name", LONG)
def test_arm_file_with_much_blank_space_is_read(name, tmp_path):
    # The search for the key `flexarm` must be linear in the number of blank characters.
    (tmp_path / "arm.yaml").write_text(LONG[name])
    (tmp_path / "run.yaml").write_text("flexarm: 1\nrun: {duration: 1}\narm: arm.yaml\n")
    assert load_scenario(tmp_path / "run.yaml").arm == SPEC
