"""Compiled kernels are cached by the sources that they compile, verified before use, and collected."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from afford.common.kernel_cache import LOCATOR, SEALED, collect_kernels, folder_of, root_of, sources

ROOT = Path(__file__).resolve().parents[2]
KERNEL = """
import json, sys
from pathlib import Path
from afford.common.kernel_cache import use_kernel_cache
use_kernel_cache(Path({store!r}))
sys.path.insert(0, {code!r})
from pkg import kernel
print(json.dumps([kernel.scale(21), sum(kernel.scale.stats.cache_hits.values())]))
"""
FILES = {
    "pkg/__init__.py": "", "pkg/far.py": "FACTOR = 2\n", "pkg/other.py": "OTHER = 1\n",
    "pkg/helper.py": "import numba\nfrom . import far\n\n@numba.njit(inline='always')\ndef times(x):\n    return far.FACTOR * x\n",
    "pkg/kernel.py": "import numba\nfrom pkg.helper import times\n\n@numba.njit(cache=True)\ndef scale(x):\n    return times(x)\n"}


def write(folder: Path) -> tuple[Path, str]:
    """Write a project with a kernel that inlines a helper; (its folder, script that prints [result of the kernel, cache hits])."""
    for name, text in FILES.items():
        (folder / "code" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "code" / name).write_text(text)
    return folder / "code", KERNEL.format(store=str(folder / "store"), code=str(folder / "code"))


def edit(path: Path, old: str, new: str) -> None:
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder with code and a store with its compiled kernel, and the script."""
    folder = tmp_path_factory.mktemp("compiled")
    _, script = write(folder)
    assert output(script) == [42, 0]
    return folder, script


@pytest.fixture
def mine(compiled: tuple[Path, str], tmp_path: Path) -> tuple[Path, str]:
    """Copy of `compiled` that a test may edit."""
    shutil.copytree(compiled[0], tmp_path, dirs_exist_ok=True)
    return tmp_path, KERNEL.format(store=str(tmp_path / "store"), code=str(tmp_path / "code"))


@pytest.mark.parametrize("places", [(0.5,), pytest.param((3, 40), marks=pytest.mark.slow)], ids=str)
def test_a_flipped_byte_of_compiled_code_is_found_before_it_runs(places: tuple[float, ...], compiled: tuple[Path, str]) -> None:
    """Compiled kernels are verified. A damaged one is compiled again, and the next process loads it."""
    folder, script = compiled
    assert output(script) == [42, 1]
    files = sorted((folder / "store" / ".cache" / "numba").rglob("*.nb[ci]"))
    assert len(files) == 2
    for path, place in ((path, place) for path in files for place in places):
        data = bytearray(path.read_bytes())
        data[place if isinstance(place, int) else int(place * len(data))] ^= 4
        path.write_bytes(data)
        assert output(script) == [42, 0], (path.name, place)
    assert output(script) == [42, 1]


def test_an_edit_recompiles_the_kernels_that_compile_it_and_no_others(mine: tuple[Path, str]) -> None:
    """An unrelated module, a constant two imports away, a helper; after an undone edit, the old machine code is used again."""
    folder, script = mine
    edit(folder / "code/pkg/other.py", "1", "5")
    assert output(script) == [42, 1]
    edit(folder / "code/pkg/far.py", "2", "3")
    assert output(script) == [63, 0]
    edit(folder / "code/pkg/helper.py", "* x", "* x + 1")
    assert output(script) == [64, 0] and output(script) == [64, 1]
    edit(folder / "code/pkg/helper.py", "* x + 1", "* x")
    edit(folder / "code/pkg/far.py", "3", "2")
    assert output(script) == [42, 1]


def test_a_child_process_of_a_stage_shares_the_compiled_code(compiled: tuple[Path, str]) -> None:
    """The child inherits the places by its environment, and verifies the code."""
    folder, _ = compiled
    plain = (f"import json, sys; sys.path.insert(0, {str(folder / 'code')!r}); from pkg import kernel; "
             "print(json.dumps([kernel.scale(21), sum(kernel.scale.stats.cache_hits.values())]))")
    found = folder / "store/.cache/numba"
    assert output(plain, NUMBA_CACHE_DIR=str(found), **LOCATOR) == [42, 1]


def test_collection_deletes_folders_that_fit_no_source(mine: tuple[Path, str]) -> None:
    """Folders of an earlier version are deleted as well; the present ones stay, and recent ones if a number of days is given."""
    folder, script = mine
    edit(folder / "code/pkg/far.py", "2", "3")
    assert output(script) == [63, 0]
    numba = folder / "store/.cache/numba"
    (numba / f"{SEALED}{'0' * 32}").mkdir()
    before = sorted(path.name for path in numba.iterdir())
    assert collect_kernels(folder / "code", folder / "store", keep_days=1.0) == (0, 0)
    counted = collect_kernels(folder / "code", folder / "store", dry_run=True)
    assert counted[0] == 4 and sorted(path.name for path in numba.iterdir()) == before
    assert collect_kernels(folder / "code", folder / "store") == counted
    assert [path.name for path in numba.iterdir()] == [
        folder_of("pkg.kernel", folder / "code/pkg/kernel.py", False, float("inf"))]
    assert output(script) == [63, 1] and collect_kernels(folder / "code", folder / "store") == (0, 0)
    assert collect_kernels(folder / "code", folder / "no store") == (0, 0)


def test_code_that_is_edited_while_a_process_runs_has_a_folder_of_its_own(mine: tuple[Path, str]) -> None:
    """The process may have imported the file before the edit, and its machine code must serve no other process."""
    folder, script = mine
    late = script.replace("print(", f"print(end=Path({str(folder / 'code/pkg/far.py')!r}).write_text('FACTOR = 7') * '')\nprint(")
    early = late.replace("from pkg import kernel", "from pkg import far")  # the kernel is defined after the edit
    first, last = early.rpartition("print(json")[::2]
    assert output(f"{first}from pkg import kernel\nprint(json{last}") == [42, 0]
    assert output(script) == [147, 0] and output(script) == [147, 1]


def test_sources_are_those_that_run_on_import(tmp_path: Path) -> None:
    """Packages, relative imports and conditions; not imports of functions, unless the kernel is defined in one."""
    code = {"a/__init__.py": "", "a/one.py": "try:\n    from .two import x\nexcept ImportError:\n    import a.three\n",
            "a/two.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import a.never\nelse:\n    import os, b\n",
            "a/three.py": "def f():\n    import late\n", "a/never.py": "", "late.py": "", "b.py": "class C:\n    import a.one\n"}
    for name, text in code.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    found = {path.relative_to(tmp_path).as_posix() for path in sources(tmp_path / "a/one.py", tmp_path)}
    assert found == code.keys() - {"a/never.py", "late.py"}
    every = {path.relative_to(tmp_path).as_posix() for path in sources(tmp_path / "a/one.py", tmp_path, every=True)}
    assert every == code.keys() - {"a/never.py"}


def test_the_root_follows_from_the_name_of_the_module() -> None:
    """A script has its own folder."""
    place = Path("/x/y/pkg/part/kernel.py")
    assert root_of("pkg.part.kernel", place) == Path("/x/y") and root_of("kernel", place) == Path("/x/y/pkg/part")
    assert root_of("__main__", place) == Path("/x/y/pkg/part")
    assert root_of("pkg.part", place.with_name("__init__.py")) == Path("/x/y")


def output(script: str, **environment: str) -> Any:
    """Last line of a script's output as JSON, from its own process."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, "-c", script], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
