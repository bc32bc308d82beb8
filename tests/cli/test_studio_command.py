"""``flexarm studio``: checks before the start. The other tests use a browser."""

import importlib.util
import socket

import pytest
from scenarios import GOOD
from typer.testing import CliRunner

from flexarm.cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, ["studio", "--no-browser", *map(str, arguments)])


def test_without_its_packages_the_error_names_the_extra(monkeypatch):
    found = importlib.util.find_spec
    for module in ("nicegui", "jinja2"):
        monkeypatch.setattr(
            "flexarm.cli.commands.studio.find_spec",
            lambda name, missing=module: None if name == missing else found(name),
        )
        done = invoke()
        assert done.exit_code == 2
        assert "is not installed. Install it with: pip install 'flexarm[studio]'." in done.stderr


@pytest.mark.thorough
def test_broken_file_is_rejected(tmp_path):
    pytest.importorskip("nicegui")
    path = tmp_path / "bad.yaml"
    path.write_text(GOOD.replace("length: 0.6", "length: -0.6"), encoding="utf-8")
    done = invoke(path)
    assert done.exit_code == 2
    assert "arm.links[0].length must be greater than 0, got -0.6." in done.stderr


def test_port_in_use_is_rejected():
    pytest.importorskip("nicegui")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        done = invoke("--port", other.getsockname()[1])
    assert done.exit_code == 2
    assert "cannot be used" in done.stderr
    assert "--port" in done.stderr


def test_address_of_another_machine_is_rejected():
    pytest.importorskip("nicegui")
    done = invoke("--host", "192.0.2.1")
    assert done.exit_code == 2
    assert "cannot be used" in done.stderr


@pytest.mark.parametrize(
    ("host", "shown", "warned"),
    [("127.0.0.1", "127.0.0.1", False), ("::1", "[::1]", False), ("0.0.0.0", "0.0.0.0", True)],
)
def test_printed_address_is_a_valid_one(monkeypatch, host, shown, warned):
    """It contains the token; an address of IPv6 has brackets in front of the port."""
    pytest.importorskip("nicegui")
    served = []
    monkeypatch.setattr("flexarm.view.studio.app.serve", lambda *options: served.extend(options))
    monkeypatch.setattr("flexarm.cli.commands.studio._check_address", lambda host, port: None)
    done = invoke("--host", host, "--port", 8123)
    assert done.exit_code == 0
    token = served[3]
    assert len(token) > 20
    assert f"studio at http://{shown}:8123/?token={token}\n" in done.stdout
    assert ("not encrypted" in done.stdout) == warned
