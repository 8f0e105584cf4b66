"""Import rules between rooms (docs/decisions/002)."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.helpers.statements import statements

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("pipeline", "commands", "maps", "stages", "runner", "afford", "schemas", "benchmarks", "tests")
MAY_IMPORT = {
    "schemas": {"schemas"},
    "afford": {"schemas", "afford"},
    "stages": {"schemas", "afford"},
    "runner": {"runner"},
    "maps": {"schemas", "afford", "stages", "runner", "maps"},
    "commands": {"schemas", "afford", "stages", "runner", "maps", "commands"},
    "pipeline": {"afford", "runner", "maps", "commands"},
}
HEAVY = ("torch", "cv2", "trimesh", "pybullet", "mujoco", "gymnasium", "rerun", "numpy", "pyarrow", "av", "numba", "matplotlib")


def sources(room: str) -> list[Path]:
    return [ROOT / "pipeline.py"] if room == "pipeline" else sorted((ROOT / room).rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text())


@cache
def imported(path: Path, *, runtime_only: bool = True) -> set[str]:
    """Full names of everything a file imports, also inside functions; without imports for type checkers when `runtime_only`."""
    tree = parsed(path)
    skipped = set()
    if runtime_only:
        for node in statements(tree):
            if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
                skipped.update(id(child) for statement in node.body for child in statements(statement))
    names = set()
    for node in statements(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_imports_of_a_room_are_in_the_table(room: str) -> None:
    """No file imports to its right in schemas <- afford <- stages <- maps <- commands <- pipeline; runner imports none of them."""
    for path in sources(room):
        found = {name.split(".")[0] for name in imported(path)} & set(ROOMS)
        assert found <= MAY_IMPORT[room], f"{path.relative_to(ROOT)} imports {sorted(found - MAY_IMPORT[room])}"


@pytest.mark.parametrize("room", ROOMS)
def test_imported_names_exist(room: str) -> None:
    """Modules and their attributes, also in scripts that no test runs."""
    for path in sources(room):
        missing = {name for name in imported(path, runtime_only=False) if name.split(".")[0] in ROOMS and not there(name)}
        assert not missing, f"{path.relative_to(ROOT)} imports {sorted(missing)}"


def there(name: str) -> bool:
    """Return true if a full name is that of a file, a folder, or a top-level name of a file."""
    path = ROOT.joinpath(*name.split("."))
    if path.is_dir() or path.with_suffix(".py").is_file():
        return True
    homes = [file for file in (path.parent.with_suffix(".py"), path.parent / "__init__.py") if file.is_file()]
    return any(path.name in outermost(home) for home in homes)


@cache
def outermost(path: Path) -> set[str]:
    """Names that a file defines or imports outside functions and classes."""
    names = set[str]()
    nodes = list[ast.AST](ast.parse(path.read_text()).body)
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names.update(alias.asname or alias.name for alias in node.names)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        else:
            nodes += ast.iter_child_nodes(node)
    return names


def test_stages_never_import_each_other() -> None:
    """A stage reaches another one only through the graph."""
    for path in sources("stages"):
        assert not {name for name in imported(path) if name.split(".")[0] == "stages"}, path.name


HOMES = {"pybullet": ("afford/common/bullet.py",),
         "mujoco": ("afford/grasping/sim/mujoco_world.py", "afford/grasping/hand/mjcf.py"),
         "rerun": ("afford/recording",), "mujoco_warp": (), "warp": ()}  # fmt: skip


@pytest.mark.parametrize(("package", "home"), HOMES.items())
def test_one_home_for_each_simulator_and_for_the_viewer(package: str, home: tuple[str, ...]) -> None:
    """Check that each simulator and the viewer have one home.

    pybullet is imported in one file, mujoco in that of its world and in the reader of its models, rerun in one folder.
    Packages of an extra are never imported by a statement (`registry.extra`).
    """
    for room in MAY_IMPORT:
        for path in sources(room):
            if package in {name.split(".")[0] for name in imported(path)}:
                assert path.relative_to(ROOT).as_posix().startswith(home), path


def test_one_home_for_the_extra_engine() -> None:
    """One file imports mujoco_warp and warp."""
    users = {path.relative_to(ROOT).as_posix() for room in MAY_IMPORT for path in sources(room) if '"gpu")' in path.read_text()}
    assert users == {"afford/grasping/sim/warp_worlds.py"}


@pytest.mark.parametrize("package", ["torch", "cv2", "numpy", "mcap", "trimesh", "pybullet", "gymnasium", "rerun"])
def test_declared_packages_are_used(package: str) -> None:
    """Each of the eight packages that the project stands on has an importer outside the tests."""
    users = [path for room in MAY_IMPORT for path in sources(room) if package in {n.split(".")[0] for n in imported(path)}]
    assert users, f"nothing imports {package}"


def test_torchvision_is_nowhere() -> None:
    """No file imports torchvision, or a package that imports it; it breaks with the pinned torch."""
    banned = {"torchvision", "timm", "segmentation_models_pytorch", "open_clip", "lerobot", "sam2", "ptlflow"}
    for room in ROOMS:
        for path in sources(room):
            found = {name.split(".")[0] for name in imported(path, runtime_only=False)} & banned
            assert not found, f"{path.relative_to(ROOT)} imports {sorted(found)}"
    pinned = "".join(path.read_text().lower() for path in sorted(ROOT.glob("constraints*.txt")))
    assert not any(line.split("==")[0].replace("-", "_") in banned for line in pinned.splitlines())
    assert "torch==2.13.0\n" in pinned


def loaded_by(statements: str) -> set[str]:
    """Modules that are loaded after the statements."""
    code = f"import sys\n{statements}\nprint(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split())


def test_importing_the_map_loads_nothing_heavy() -> None:
    """Check that `--help` is quick.

    `import pipeline` and the command line load no heavy package, no stage and no map. All maps together load no heavy package.
    """
    found = loaded_by("import pipeline, commands.cli")
    assert not found & set(HEAVY) and not [name for name in found if name.startswith(("stages", "maps"))]
    every = ", ".join(".".join(path.relative_to(ROOT).with_suffix("").parts) for path in sources("maps") if path.stem != "__init__")
    found = loaded_by(f"import {every}")
    assert not found & set(HEAVY) and "stages.twohands.model_train" in found


SYSTEMS = ("extraction", "twohands", "surface", "grasping", "rgbd", "synthetic")
GROUNDS = ("common", "codecs", "render", "dataset", "models", "training", "recording")
FIXED = {"afford": {*GROUNDS, *SYSTEMS}, "stages": {*SYSTEMS, "recording"},
         "tests": {*SYSTEMS, "recording", "runner", "commands", "common", "helpers", "toy_domain"}}  # fmt: skip
LOOSE = {"afford": {"__init__.py", "environments.py", "shadows.py"}, "stages": {"__init__.py"}, "tests": {"conftest.py"}}
"""files that may lie outside of a system"""


@pytest.mark.parametrize("place", FIXED)
def test_rooms_are_those_of_the_design(place: str) -> None:
    """The six systems and their common ground, and no loose file."""
    rooms = {path.name for path in (ROOT / place).iterdir() if path.is_dir() and any(path.rglob("*.py"))}
    files = {path.name for path in (ROOT / place).glob("*.py")}
    assert rooms == FIXED[place] and files == LOOSE[place], (rooms ^ FIXED[place], files ^ LOOSE[place])


def test_a_file_of_stages_is_a_stage() -> None:
    """One file, one stage: `Params` and one public function, `run`; each name occurs once in all systems."""
    files = [path for path in sources("stages") if path.stem != "__init__"]
    for path in files:
        body = ast.parse(path.read_text()).body
        assert "Params" in {node.name for node in body if isinstance(node, ast.ClassDef)}, path
        assert "run" in {node.name for node in body if isinstance(node, ast.FunctionDef)}, path
    assert len({path.stem for path in files}) == len(files)


def arrows(root: Path, registries: bool = True) -> dict[Path, set[Path]]:
    """File -> files of ours that it imports, for types as well, or that it names in a registry ("module:attribute")."""
    found = [path for room in ("afford", "commands", "maps", "runner", "schemas", "stages") for path in (root / room).rglob("*.py")]
    files = {path.relative_to(root).with_suffix("").as_posix().replace("/", "."): path for path in found}
    modules = files | {name.removesuffix(".__init__"): path for name, path in files.items() if name.endswith(".__init__")}
    reached = {path: imported(path, runtime_only=False) | (named(path) if registries else set()) for path in files.values()}
    return {path: {modules[name] for name in names if name in modules} for path, names in reached.items()}


def named(path: Path) -> set[str]:
    """Modules that a file names as strings, "module:attribute"."""
    texts = {node.value for node in ast.walk(parsed(path)) if isinstance(node, ast.Constant)}
    return {text.partition(":")[0] for text in texts if isinstance(text, str) and ":" in text and " " not in text}


def circles(graph: dict[Path, set[Path]]) -> list[list[Path]]:
    """Groups of nodes that reach each other."""
    sorter = TopologicalSorter(graph)
    try:
        sorter.prepare()
    except CycleError as error:
        return [error.args[1]]
    return []


def folders(graph: dict[Path, set[Path]]) -> dict[Path, set[Path]]:
    """The same arrows between folders; a package's own `__init__` hands nothing down."""
    out: dict[Path, set[Path]] = {}
    for path, targets in graph.items():
        ends = {target.parent for target in targets if target.name != "__init__.py" or target.parent != path.parent.parent}
        out.setdefault(path.parent, set()).update(ends - {path.parent})
    return out


def test_imports_have_no_circle() -> None:
    """Neither files nor folders import each other in a circle.

    Entries of registries count between folders; within one, a registry may be beside the Protocol of its entries. An
    `__init__` counts as its package.
    """
    files = {path: targets for path, targets in arrows(ROOT, registries=False).items() if path.name != "__init__.py"}
    assert not circles({path: targets - {path} for path, targets in files.items()})
    assert not circles(folders(arrows(ROOT)))


def test_planted_circle_and_planted_wrong_import_are_found(tmp_path: Path) -> None:
    """The rules for folders, and the contracts of the linter, fail on what they forbid."""
    for room in ("afford", "stages", "schemas", "maps", "commands", "runner"):
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    assert linted(tmp_path).returncode == 0
    low = tmp_path / "afford" / "common" / "masks.py"
    low.write_text(low.read_text() + "\n\ndef cheat():\n    import afford.grasping.env.grasp_worlds\n")
    assert circles(folders(arrows(tmp_path)))
    done = linted(tmp_path)
    assert done.returncode == 1 and "afford.common.masks" in done.stdout


def linted(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the import linter on a copy of the project."""
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_map_reaches_the_command_line_only_as_a_program() -> None:
    """`import pipeline` imports no verb: `commands` is imported inside of functions."""
    body = ast.parse((ROOT / "pipeline.py").read_text()).body
    outside = [node for node in body if not isinstance(node, ast.FunctionDef)]
    names = {name for node in outside if not is_main(node) for name in imports_of(node)}
    assert not {name for name in names if name.split(".")[0] == "commands"}


def is_main(node: ast.AST) -> bool:
    """Return true for the statement `if __name__ == "__main__":`."""
    return isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)


def imports_of(node: ast.AST) -> set[str]:
    """Modules that a statement imports."""
    found = [child for child in ast.walk(node) if isinstance(child, ast.Import | ast.ImportFrom)]
    return {child.module or "" if isinstance(child, ast.ImportFrom) else child.names[0].name for child in found}


def test_the_targets_are_given_to_the_command_line() -> None:
    """`pipeline` loads no command before it is called, and no command loads `pipeline`, so that neither stands above the other."""
    assert not [name for name in loaded_by("import pipeline") if name.split(".")[0] == "commands"]
    every = ", ".join(f"commands.{path.stem}" for path in sources("commands") if path.stem != "__init__")
    assert "pipeline" not in loaded_by(f"import {every}")


def test_planted_import_fails_the_rules(tmp_path: Path) -> None:
    """A planted wrong import is found: an import inside a function counts, one for type checkers does not."""
    cheat = tmp_path / "cheat.py"
    hidden = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import torch\n"
    cheat.write_text(hidden + "def f():\n    import stages.extraction.mask_densify\n")
    assert "stages.extraction.mask_densify" in imported(cheat)
    assert "torch" not in imported(cheat)
