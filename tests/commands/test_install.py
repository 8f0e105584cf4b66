"""Editable install: imports from any folder, the console script, gymnasium's names, hashed pins, clear refusals."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.helpers.install_scripts import of_install

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
PINS = ("constraints.txt", "constraints-dev.txt", "constraints-film.txt", "constraints-gpu.txt", "constraints-ray.txt")
NAMES = ("afford", "commands", "maps", "pipeline", "runner", "schemas", "stages")


def python(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python of this environment in a folder, with the project on its path only through the install."""
    return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"})


def test_the_project_is_importable_from_any_folder(tmp_path: Path) -> None:
    """The top-level names come from this checkout."""
    code = f"import importlib; print(*(importlib.import_module(name).__file__ for name in {NAMES}), sep='\\n')"
    found = python(tmp_path, "-c", code)
    assert found.returncode == 0, found.stderr
    assert all(Path(line).is_relative_to(ROOT) for line in found.stdout.split())


def test_gymnasium_makes_the_environment_by_its_name(tmp_path: Path) -> None:
    """An empty folder, no import of the project, and no arguments."""
    code = "import gymnasium; print(len(gymnasium.make('afford/AffordanceGrasp-v0').reset(seed=0)[0]))"
    found = python(tmp_path, "-c", code)
    assert found.returncode == 0, found.stderr
    assert int(found.stdout) > 0


def test_gymnasium_alone_stays_light(tmp_path: Path) -> None:
    """Importing gymnasium registers names and loads nothing of the project; neither does Python's start."""
    names = "[name for name in sys.modules if name.split('.')[0] in ('afford', 'schemas', 'torch', 'mujoco', 'trimesh')]"
    found = python(tmp_path, "-c", f"import sys; a = {names}; import gymnasium; print(a, sorted({names}))")
    assert found.stdout.strip() == "[] []", found.stderr


def test_the_console_script_is_the_pipeline(tmp_path: Path) -> None:
    """The same words and exit codes from another folder, and the same store."""
    for words in (("--help",), ("--version",), ("params", "mask_densify"), ("run", "nothing"), ("status", "dataset")):
        found = [subprocess.run([*command, *words], cwd=tmp_path, capture_output=True, text=True)
                 for command in ([BIN / "afford"], [sys.executable, ROOT / "pipeline.py"])]  # fmt: skip
        script, pipeline = ((one.returncode, squeezed(one.stdout), squeezed(one.stderr)) for one in found)
        assert script == pipeline, words


def squeezed(text: str) -> str:
    """Text without the name of the program and blanks."""
    return "".join(text.replace("pipeline.py", "afford").split())


@pytest.mark.parametrize("call", [("-c", "import afford"), ("-m", "pipeline", "--help")])
def test_a_folder_that_hides_the_project_is_named(tmp_path: Path, call: tuple[str, ...]) -> None:
    """One sentence with both places. A folder without code hides nothing, and is not on the path of the console script."""
    (tmp_path / "schemas").mkdir()
    assert python(tmp_path, *call).returncode == 0
    (tmp_path / "schemas" / "__init__.py").touch()
    refused = python(tmp_path, *call)
    assert refused.returncode == 1
    assert f"{tmp_path / 'schemas'} hides the `schemas` of afford, which lies in {ROOT}" in refused.stderr.splitlines()[-1]
    assert call[0] == "-c" or refused.stderr.count("\n") == 1
    assert subprocess.run([BIN / "afford", "--version"], cwd=tmp_path, capture_output=True).returncode == 0
    assert python(tmp_path, "-c", "import gymnasium").returncode == 0


def test_other_rooms_hide_only_the_command_line(tmp_path: Path) -> None:
    """A user's own `commands` does not affect the library."""
    (tmp_path / "commands.py").touch()
    assert python(tmp_path, "-c", "import afford").returncode == 0
    refused = python(tmp_path, "-m", "pipeline", "--help")
    assert refused.returncode == 1 and refused.stderr.startswith("error: ") and "hides the `commands`" in refused.stderr


def test_pins_have_hashes_except_torch() -> None:
    """The form of `pip --require-hashes`: == and at least one sha256 per line; torch has its own file."""
    install = of_install("constraints")
    for name in PINS:
        entries = install.parse((ROOT / name).read_text())
        assert entries
        for lines in entries.values():
            assert re.fullmatch(r"[\w.-]+==[\w.+]+(?: ;[^\n\\]+)? \\\n(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", lines), lines
    assert [line for line in (ROOT / "constraints-torch.txt").read_text().splitlines() if line[0] != "#"] == ["torch==2.13.0"]
    assert not [name for name in PINS if "torch==" in (ROOT / name).read_text()]


def test_dependencies_are_pinned() -> None:
    """Those of users in constraints.txt, those of each extra in its own file or among those of users."""
    install, project = of_install("constraints"), tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    everybody = set(install.read("")) | {"torch"}
    wanted = {"": project["dependencies"], **project["optional-dependencies"]}
    assert set(wanted) == set(install.GROUPS)
    for group, lines in wanted.items():
        names = {re.split(r"[=<>;!\[ ]", line)[0].lower().replace("_", "-") for line in lines}
        beside = {"dev": ("film", "ray")}.get(group, ())  # the Makefile installs these with dev's
        assert names <= everybody.union(*(install.read(one) for one in (group, *beside))), group


def test_installed_versions_are_the_pinned_ones() -> None:
    """Checks every installed package of users."""
    command = [sys.executable, "-m", "pip", "list", "--format=json", "--disable-pip-version-check"]
    message = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    here = {one["name"].lower().replace("_", "-"): one["version"] for one in json.loads(message)}
    install = of_install("constraints")
    pins = {name: install.pin(lines).partition("==")[2] for name, lines in install.read("").items() if name != "setuptools"}
    assert {name: here[name] for name in pins if name in here} == {name: version for name, version in pins.items() if name in here}


@pytest.mark.parametrize(("machine", "message"), [
    (((3, 11), "Linux", "x86_64", True, False), []),
    (((3, 12), "Linux", "x86_64", True, False), ["pybullet has no wheel for Python 3.12"]),
    (((3, 13), "Linux", "x86_64", False, True), ["a C++ compiler, which is missing: install g++ first", "torch may bring CUDA"]),
    (((3, 11), "Linux", "aarch64", True, False), ["pybullet has no wheel", "embreex has no build for aarch64"]),
    (((3, 12), "Darwin", "arm64", True, True), [])])  # fmt: skip
def test_packages_without_a_wheel_are_reported_first(machine: tuple, message: list[str]) -> None:  # type: ignore[type-arg]  # a call's arguments
    """A sentence each, before pip starts."""
    found = of_install("preflight").notes(*machine)
    assert len(found) == len(message) and all(word in line for word, line in zip(message, found, strict=True))


def test_a_python_that_is_too_new_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """One sentence with advice."""
    assert of_install("preflight").main((3, 14), "Linux", "x86_64", True, False) == 1
    assert "expected Python 3.11 to 3.13, got 3.14" in capsys.readouterr().err


def test_an_editable_install_is_the_only_one(tmp_path: Path) -> None:
    """A copy in site-packages would search its store and pages there."""
    for build in ("build_wheel", "build_sdist"):
        with pytest.raises(SystemExit, match="pip install --editable"):
            getattr(of_install("backend"), build)(str(tmp_path))


def test_setup_files_name_no_package_index() -> None:
    """No file of the set-up names the host of a package index."""
    for path in (*ROOT.glob("constraints*.txt"), ROOT / "Makefile", ROOT / "pyproject.toml", *(ROOT / "install").glob("*.py")):
        assert not re.search(r"https?://(?!127\.0\.0\.1)", path.read_text()), path.name
