"""The gallery: each script and notebook of examples/ with what it prints and draws, run by the
build."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import repeat
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
KEPT = ROOT / "build" / "gallery"
OUTPUT = "output.txt"
LIMIT_S = 600.0
FIRST = ("slip_margin_loop", "own_hand", "record_replay_plot")
"""Of the examples; the others follow by name."""


def page(app: Any) -> str:
    """All examples: what they show, their text, their output and their pictures."""
    scripts = sorted(
        [*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")],
        key=lambda script: (script.stem not in FIRST, script.stem),
    )
    first = _section(scripts[0], app)  # alone: it compiles what the others need as well
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        others = pool.map(_section, scripts[1:], repeat(app))
        return "\n\n".join([first, *others])


def program(example: Path) -> str:
    """An example as a script. The text of a notebook is its docstring and comments; a cell that
    ends with a value prints it."""
    text = example.read_text("utf-8")
    if example.suffix == ".py":
        return text
    title, *cells = json.loads(text)["cells"]
    parts = [f'"""{"".join(title["source"]).removeprefix("# ")}\n"""']
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append("\n".join(f"# {line}" for line in source.splitlines()))
            continue
        last = ast.parse(source).body[-1]
        if isinstance(last, ast.Expr) and not isinstance(last.value, ast.Call):
            lines = source.splitlines()
            value = "\n".join(lines[last.lineno - 1 :])
            source = "\n".join([*lines[: last.lineno - 1], f"print({value})"])
        parts.append(source)
    return "\n\n".join(parts) + "\n"


def _section(script: Path, app: Any) -> str:
    text = program(script)
    tree = ast.parse(text)
    title, _, rest = (ast.get_docstring(tree) or "").partition("\n")
    code = "\n".join(text.splitlines()[tree.body[0].end_lineno :]).strip()
    parts = [f"## {title.rstrip('.')}", rest.strip(), f"`examples/{script.name}`:",
             f"```python\n{code}\n```"]  # fmt: skip
    if app.config.run_examples:
        parts += _output(script, app)
    return "\n\n".join(filter(None, parts))


def _output(script: Path, app: Any) -> list[str]:
    """What a script prints, and the pictures that it leaves in its folder. Both are kept under
    build/gallery, and made again where a file of the packages or the examples has changed."""
    kept = KEPT / f"{script.stem}-{_digest()}"
    if not (kept / OUTPUT).exists():
        for old in KEPT.glob(f"{script.stem}-*"):
            shutil.rmtree(old)
        if (missing := _run(script, kept)) is not None:
            return [f"Not run in this build: {missing}."]
    parts = [f"Output:\n\n```text\n{(kept / OUTPUT).read_text('utf-8').strip()}\n```"]
    for picture in sorted(kept.glob("*.png")):
        place = os.path.relpath(picture, app.srcdir)
        parts.append(f"![{picture.stem} of {script.name}]({place})")
    return parts


def _run(script: Path, kept: Path) -> str | None:
    """Run a script and keep what it made; the library that is missing, if one is."""
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=KEPT) as name:
        folder = Path(name)
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        file = script
        if script.suffix != ".py":
            file = folder / f"{script.stem}.py"
            file.write_text(program(script), "utf-8")
        done = subprocess.run(
            [sys.executable, str(file)], cwd=folder, capture_output=True, text=True, check=False,
            timeout=LIMIT_S, env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "agg"},
        )  # fmt: skip
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:] or ["no output"]
            if "ModuleNotFoundError" in last[0]:
                return last[0].partition(": ")[2]
            raise RuntimeError(f"{script.name}: ended with {done.returncode}: {last[0]}")
        kept.mkdir()
        for picture in folder.glob("*.png"):
            shutil.copy(picture, kept)
        (kept / OUTPUT).write_text(done.stdout, "utf-8")  # last: a folder with it is complete
    return None


@cache
def _digest() -> str:
    """Of all files that an example may read."""
    digest = hashlib.sha256()
    for folder in ("topology", "bus", "skin", "examples"):
        for file in sorted((ROOT / folder).rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                digest.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]
