"""Do the tests notice a wrong sign? Mutation score of the rooms on a random sample.

cosmic-ray makes the mutants (arithmetic, comparisons, numbers, conditions, loops); each is put into a copy of the
repository and the tests of its room are run until one fails. Left out are data (parameter rows), annotations,
decorators, and operators that a float does not have: any call would notice those. `NAMED` are mutants that once
survived; they have to be killed. Compiled functions stay cached but for those that depend on the file, which numba does
not notice itself.

    pip install cosmic-ray
    python benchmarks/mutation_score.py --each 12 --seed 1 --write docs/mutation_score.md
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import parso
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path("pipeline/camtorque")
LINKED = ("raw_examples", "calibration", "docs", "README.md", "benchmarks", "reports", "mkdocs.yml", "CHANGELOG.md")
LEFT_OUT = re.compile(
    "RemoveDecorator|Variable|ExceptionReplacer|Shift|BitXor|Invert|Mod|FloorDiv|Pow_|_Pow|_Is"
    "|_(Add|Sub|Mul|Div)_Bit|_Bit(And|Or)_(Add|Sub|Mul|Div)"
)
TESTS = {
    "laws": ("laws",),
    "mechanism": ("mechanism", "laws/test_laws_registry.py"),
    "align": ("align",),
    "fit": ("fit", "compare"),
    "design": ("design",),
    "report": ("report",),
    "campaign": ("campaign",),
}
"""Room -> tests that have to notice, below `tests`."""
SLOW = ("test_laws_walkthrough.py", "test_mechanism_engines.py", "test_align_any_input.py")
LIMIT = 180
"""A run of tests that takes more time of the processor [s] does not end by itself: the mutant is noticed."""

NAMED = (
    ("bearing friction with the other sign (law)", "laws/friction.py", "(at.lever, at.lever_by)",
     "(-at.lever, -at.lever_by)"),
    ("bearing friction with the other sign (mechanism)", "mechanism/torque.py", "rubbing = along", "rubbing = -along"),
    ("pin friction without the ratio of speeds", "laws/friction.py",
     "on_contact(-at.lever * at.spin, -(at.lever_by * at.spin + at.lever * at.spin_by))",
     "on_contact(at.lever, at.lever_by)"),
    ("column of the spring's preload is zero", "laws/spring.py", "(at.preload,", "(0.0 * at.preload,"),
    ("leakage with the square of the gap", "laws/leakage.py", "cubed = gap * gap * gap", "cubed = gap * gap"),
    ("blind prediction with its own fitted end", "fit/leftout.py", "if one.id != item.name", "if one.id"),
    ("intervals are not widened", "fit/uncertainty.py", "inflation = max(1.0, ", "inflation = max(1.0, 0.0 * "),
)  # fmt: skip
"""What, file, text, what stands there instead."""


@dataclass(frozen=True)
class Mutant:
    """What was changed, where, and the file as it is then."""

    what: str
    path: str
    line: int
    text: str


def data_lines(source: str) -> set[int]:
    """Return the lines of parameter rows and of annotations in signatures and classes."""
    tree, lines = ast.parse(source), set[int]()
    for node in ast.walk(tree):
        named = isinstance(node, ast.Assign) and str(getattr(node.targets[0], "id", "")).endswith("ROWS")
        if named or (isinstance(node, ast.AnnAssign) and node.value is None):
            assert isinstance(node, ast.stmt)
            lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        if isinstance(node, ast.FunctionDef):
            lines.update(range(node.lineno, node.body[0].lineno))
    return lines


def places(source: str) -> dict[tuple[int, int], list[tuple[str, int]]]:
    """Return line and column -> operators that change something there, each with its occurrence in the file."""
    data, found = data_lines(source), dict[tuple[int, int], list[tuple[str, int]]]()
    nodes = list(_walk(parso.parse(source)))
    for name in operator_names():
        operator, count = get_operator(name), 0
        if LEFT_OUT.search(name):
            continue
        for node in nodes:
            for start, _ in operator().mutation_positions(node):
                if start[0] not in data:
                    found.setdefault(start, []).append((name, count))
                count += 1
    return found


def _walk(node: parso.tree.NodeOrLeaf) -> Iterator[parso.tree.NodeOrLeaf]:
    yield node
    for child in getattr(node, "children", ()):
        yield from _walk(child)


def sample(room: str, count: int, rng: np.random.Generator) -> Iterator[Mutant]:
    """Yield mutants of a room: places drawn evenly over its files, then one of the operators at each."""
    sources = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / PACKAGE / room).glob("*.py"))}
    everywhere = [(path, start, each) for path, text in sources.items() for start, each in places(text).items()]
    for index in rng.choice(len(everywhere), count, replace=False):
        path, (line, _), operators = everywhere[index]
        name, occurrence = operators[rng.integers(len(operators))]
        mutated = mutate_code(sources[path], get_operator(name)(), occurrence)
        before = sources[path].splitlines()[line - 1].strip()
        after = mutated.splitlines()[line - 1].strip()
        if mutated != sources[path]:
            yield Mutant(f"`{before}` -> `{after}`", f"{room}/{path.name}", line, mutated)


def named() -> Iterator[Mutant]:
    """Yield the mutants of `NAMED`."""
    for what, path, old, new in NAMED:
        source = (ROOT / PACKAGE / path).read_text(encoding="utf-8")
        if source.count(old) != 1:
            raise SystemExit(f"{path}: {old!r} stands there {source.count(old)} times, expected once")
        yield Mutant(what, path, source[: source.index(old)].count("\n") + 1, source.replace(old, new))


def dependents() -> dict[str, set[str]]:
    """Return file below the package -> files that import it, itself and theirs included."""
    uses: dict[str, set[str]] = {}
    for path in (ROOT / PACKAGE).rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        modules = {
            f"{n.module}.{a.name}" for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom) for a in n.names
        }
        uses[str(path.relative_to(ROOT / PACKAGE))] = modules
    heads = {name: "camtorque." + name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in uses}
    users = {
        name: {other for other, used in uses.items() if any(u == head or u.startswith(f"{head}.") for u in used)}
        for name, head in heads.items()
    }
    result = {}
    for name in uses:
        known, new = {name}, {name}
        while new:
            new = set[str]().union(*(users[item] for item in new)) - known
            known |= new
        result[name] = known
    return result


def forget(cache: Path, names: set[str]) -> None:
    """Delete the compiled functions of files."""
    for name in names:
        room, stem = Path(name).parent.name or PACKAGE.name, Path(name).stem
        for path in cache.glob(f"{room}_*/{stem}.*.nb?"):
            path.unlink()


def run(tree: Path, cache: Path, mutant: Mutant | None, room: str) -> str:
    """Return the first failing test, empty where none fails."""
    own = sorted((tree / "tests").glob(f"{room}/test_*_{Path(mutant.path).stem if mutant else ''}.py"))
    tests = list(dict.fromkeys([*own, *(tree / "tests" / name for name in TESTS[room])]))
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-o", "addopts=", *map(str, tests)]
    command += [f"--ignore-glob=*{name}" for name in SLOW]
    environment = {**os.environ, "PYTHONPATH": str(tree / "pipeline"), "NUMBA_CACHE_DIR": str(cache)}
    environment |= {"OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        command, cwd=tree, env=environment, capture_output=True, text=True, check=False,
        preexec_fn=_limited if mutant else None,
    )  # fmt: skip
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return "no end"
    printed = done.stdout
    lines = [line for line in printed.splitlines() if line.startswith(("FAILED tests", "ERROR tests"))]
    return lines[0].split(" - ")[0].split("::", 1)[-1] if lines else printed.strip()[-80:]


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))


def campaign(mutants: list[Mutant], base: Path) -> Iterator[tuple[Mutant, str]]:
    """Yield every mutant with the test that noticed it."""
    tree, warm, cache = base / "tree", base / "warm", base / "cache"
    warm.mkdir()  # tests that compile nothing write nothing there
    for name in ("pipeline", "tests"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tree)
    for name in LINKED:
        (tree / name).symlink_to(ROOT / name)
    depends = dependents()
    rooms = set[str]()
    for mutant in mutants:
        room = mutant.path.split("/")[0]
        failed = "" if room in rooms else run(tree, warm, None, room)
        if failed:
            raise SystemExit(f"the tests of {room} fail without a mutant: {failed}")
        rooms.add(room)
        shutil.rmtree(cache, ignore_errors=True)
        shutil.copytree(warm, cache)
        forget(cache, depends[mutant.path])
        path = tree / PACKAGE / mutant.path
        clean = path.read_text(encoding="utf-8")
        path.write_text(mutant.text, encoding="utf-8")
        yield mutant, run(tree, cache, mutant, room)
        path.write_text(clean, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=12, help="mutants of each room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="+", default=list(TESTS), choices=list(TESTS))
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    known = [mutant for mutant in named() if mutant.path.split("/")[0] in arguments.rooms]
    drawn = [mutant for room in arguments.rooms for mutant in sample(room, arguments.each, rng)]
    mutants = sorted([*known, *drawn], key=lambda mutant: arguments.rooms.index(mutant.path.split("/")[0]))
    start, rows = time.monotonic(), []
    with tempfile.TemporaryDirectory() as folder:
        for mutant, killer in campaign(mutants, Path(folder)):
            rows.append((mutant, killer))
            print(f"{mutant.path}:{mutant.line} {mutant.what}: {killer or 'SURVIVED'}", flush=True)
    noticed = [mutant for mutant, killer in rows if killer]
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    summary = (
        f"{sum(m in drawn for m in noticed)} of {len(drawn)} drawn mutants noticed, "
        f"{sum(m in known for m in noticed)} of {len(known)} named ones; "
        f"{(spent.ru_utime + spent.ru_stime) / 60.0:.0f} minutes of processor, "
        f"{(time.monotonic() - start) / 60.0:.0f} of the clock."
    )
    print(summary)
    if arguments.write:
        table = [
            f"| `{m.path}:{m.line}` | {m.what.replace('|', chr(92) + '|')} | {k or '**nothing**'} |" for m, k in rows
        ]
        head = ["# Mutation score", "", summary, "", "| where | change | noticed by |", "|---|---|---|"]
        arguments.write.write_text("\n".join([*head, *table, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
