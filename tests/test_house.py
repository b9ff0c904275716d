"""The house: arrows one way, registries complete, one room for each heavy thing, every option documented."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import camtorque
import pytest
from camtorque import laws
from camtorque.cli import build_parser
from camtorque.commands import COMMANDS
from camtorque.ingest.formats import FORMATS
from camtorque.report.write import FIGURES

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(inspect.getfile(camtorque)).parent
FILES = sorted(path for path in PACKAGE.rglob("*.py"))

LEFT = {"compiled", "config", "grid_choice", "hashes", "jsonable", "limits", "process", "progress", "records",
        "results", "stacks", "units", "version"}  # fmt: skip
ROOMS = ["signal", "ingest", "align", "mechanism", "laws", "fit", "report", "design"]
FLOWS = ["rehearsal", "run", "campaign", "compare", "finished_fit", "predict_from", "design_from", "plan", "studies"]
FACES = [
    "arrays",
    "frames",
    "api",
    "export",
    "growing",
    "watch",
    "lmfit_minimizer",
    "lmfit_fit",
    "commands",
    "cli",
    "__main__",
    "__init__",
]
ORDER = ["left", *ROOMS, *FLOWS, *FACES]
HEAVY = {"matplotlib", "weasyprint", "xarray", "openpyxl", "pyarrow", "asammdf"}
ONLY_SHOWN = {
    "CERTIFICATE_COLUMNS": "writes the table of certificates of docs/recording_toml.md",
    "BASES": "writes the legend of docs/thresholds.md",
    "reducer_override": "called by pickle",
    "leastsq": "called by lmfit",
}
"""Used by nothing else in the package, and why it is there."""
LONGEST_FUNCTION, LONGEST_FILE = 40, 350
LONG = {
    "laws.chamber.integrate": "one compiled time step with its derivatives: its parts would hand on a hundred names",
    "laws.driveline.compliances": "one compiled pass over the harmonics: a compliance and its thirteen derivatives",
    "laws.torque.torque_columns": "torque and its five derivatives at an angle share nearly all of their terms",
    "fit.result.fitted_torque": "fills one record: a line a field",
    "laws.chamber": "rows, balance and derivative of one law, which are one file by intention",
}
"""Functions and files beyond these lines, without their docstrings, and why they are not parted."""
ONLY_WRITTEN = {
    "seen": "where a range of plausible values comes from",
    "section_torque": "tests hold the balance of every lobe by it",
    **dict.fromkeys(("identifiable", "confounded_with"), "result.json holds a parameter whole"),
    **dict.fromkeys(("error_label", "cost_label", "note", "given_cost"), "a study is written whole"),
}
"""Fields that nothing in the package reads by name, and why they are there."""
LAZY = {"numba", "dask", "distributed", "dask_jobqueue", "pinocchio", "mujoco", *HEAVY}
"""Heavy packages that may be imported inside a function: optional ones, and numba by `camtorque.compiled`."""


def room_of(module: str) -> str:
    name = module.split(".")[1] if "." in module else "__init__"
    return "left" if name in LEFT else name


def module_name(path: Path) -> str:
    parts = ["camtorque", *path.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(tree: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    for node in nodes(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            yield node.module or "", node


def modules_used(tree: ast.AST, names: set[str]) -> Iterator[str]:
    """Yield the modules of the package that are imported; ``from package import module`` means the module."""
    for name, node in imports(tree):
        inner = [f"{name}.{alias.name}" for alias in getattr(node, "names", [])]
        if name in names and not (inner and all(item in names for item in inner)):
            yield name
        yield from (item for item in inner if item in names)


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(tree: ast.AST) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree))


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_a_room_never_imports_one_to_its_right(path: Path) -> None:
    own = room_of(module_name(path))
    assert own in ORDER, f"{own} has no place in the order of the rooms"
    for name, _ in imports(parsed(path)):
        if name.startswith("camtorque."):
            assert ORDER.index(room_of(name)) <= ORDER.index(own), f"{own} imports {name}"


def test_the_page_of_the_architecture_names_every_room() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert not [name for name in (*LEFT, *ORDER[1:-1]) if f"`{name}`" not in text and f"`{name}/`" not in text]


def test_no_import_cycle_between_modules() -> None:
    names = {module_name(path) for path in FILES}
    graph: dict[str, set[str]] = {}
    for path in FILES:
        own = module_name(path)
        graph[own] = {name for name in modules_used(parsed(path), names) if name != own}
    done: set[str] = set()

    def visit(name: str, above: tuple[str, ...]) -> None:
        assert name not in above, " -> ".join((*above, name))
        if name not in done:
            for other in graph[name]:
                visit(other, (*above, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def test_a_name_is_imported_from_the_file_that_defines_it() -> None:
    trees = {module_name(path): parsed(path) for path in FILES if path.name != "__init__.py"}
    own = {module: {name for _, name in names_defined(module, tree)} for module, tree in trees.items()}
    for module, tree in trees.items():
        for _, (source, name) in names_imported(module, tree):
            assert name in own.get(source, {name}), f"{module} imports {name} from {source}"


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_imports_inside_functions_are_heavy_optional_packages(path: Path) -> None:
    if path.name == "cli.py":
        return  # a refusal is known by its class, which `--help` does without
    for node in nodes(parsed(path)):
        if isinstance(node, ast.FunctionDef):
            for name, _ in imports(node):
                assert name.split(".")[0] in LAZY, f"{node.name} imports {name}"


@pytest.mark.parametrize(("package", "room"), [("matplotlib", "report")])
def test_heavy_packages_live_in_one_room(package: str, room: str) -> None:
    users = {
        room_of(module_name(path))
        for path in FILES
        for name, _ in imports(parsed(path))
        if name.split(".")[0] == package
    }
    assert users <= {room, "studies"}
    assert room in users


def test_only_the_command_line_prints() -> None:
    for path in FILES:
        calls = [n for n in nodes(parsed(path)) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
        if path.name != "cli.py":
            assert not [call.lineno for call in calls if call.func.id == "print"], path.name


@pytest.mark.parametrize("path", FILES, ids=module_name)
def test_every_public_thing_has_a_docstring(path: Path) -> None:
    tree = parsed(path)
    assert ast.get_docstring(tree), "module docstring"
    for node in nodes(tree):
        public = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
        if public and node in tree.body:
            assert ast.get_docstring(node), node.name


def test_long_functions_and_files_say_why() -> None:
    long = set()
    for path in FILES:
        text, name = path.read_text(encoding="utf-8"), module_name(path).removeprefix("camtorque.")
        if text.count("\n") > LONGEST_FILE:
            long.add(name)
        for node in nodes(parsed(path)):
            if isinstance(node, ast.FunctionDef) and length(node) > LONGEST_FUNCTION:
                long.add(f"{name}.{node.name}")
    assert not long - set(LONG), "part it, or say why not in LONG"


def length(node: ast.FunctionDef) -> int:
    """Return the lines of a function without its docstring."""
    lines = (node.end_lineno or node.lineno) - node.lineno + 1
    return lines - (ast.get_docstring(node, clean=False) or "").count("\n") - 1


def test_every_effect_has_its_file_and_every_parameter_its_row() -> None:
    stems = {path.stem for path in (PACKAGE / "laws").glob("*.py")}
    for name, law in laws.LAWS.items():
        assert law.rows, f"{name} has no parameters"
    shared = {"coupling": "driveline"}
    assert {shared.get(name, name) for name in laws.LAWS} <= stems
    assert len(laws.ROWS) == sum(len(law.rows) for law in laws.LAWS.values()), "a parameter name repeats"


def test_every_figure_function_is_in_the_registry() -> None:
    drawn = {spec.draw for spec in FIGURES.values()}
    for module in ("curve_figures", "fit_figures"):
        source = __import__(f"camtorque.report.{module}", fromlist=["x"])
        for name, function in inspect.getmembers(source, inspect.isfunction):
            takes_run = list(inspect.signature(function).parameters) == ["result"]
            own = function.__module__ == source.__name__ and not name.startswith("_")
            if own and takes_run and inspect.signature(function).return_annotation in ("Curves", "Rows", "Rows | None"):
                assert function in drawn, f"{module}.{name} is drawn nowhere"


def test_every_option_and_command_is_in_the_readme() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    parser = build_parser()
    actions = next(action for action in parser._actions if hasattr(action, "choices") and action.choices)
    for name, command in actions.choices.items():
        assert f"camtorque {name}" in text
        for action in command._actions:
            for option in action.option_strings:
                assert option in text or option in ("-h", "--help"), f"{name} {option}"
    assert set(actions.choices) == set(COMMANDS)


def test_the_contract_is_the_one_that_the_documents_name() -> None:
    text = (ROOT / "docs" / "result_schema.md").read_text(encoding="utf-8")
    assert '"camtorque.result/1"' in text
    assert "campaign.json" in text


def test_everything_in_the_package_is_reachable() -> None:
    names = {module_name(path): path for path in FILES}
    loaded = {
        *(f"camtorque.commands.{name}" for name in COMMANDS),
        *(f"camtorque.ingest.{f.module}" for f in FORMATS.values()),
    }
    todo, seen = ["camtorque", "camtorque.__main__", *loaded], set[str]()
    while todo:
        name = todo.pop()
        if name in seen:
            continue
        seen.add(name)
        todo += modules_used(parsed(names[name]), set(names))
        todo += [above for above in names if name.startswith(f"{above}.")]  # importing a module runs those above it
    assert not sorted(set(names) - seen), "neither a command nor the public face reaches these"


Name = tuple[str, str]
"""Module of the package and name in it; the module is empty for methods and for what is inside a function."""


def names_defined(module: str, tree: ast.Module) -> Iterator[Name]:
    """Yield the functions, methods and classes of a file, and its constants."""
    for node in nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield module if node in tree.body else "", node.name
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        inside = [name for target in targets if target is not None for name in nodes(target)]
        yield from ((module, name.id) for name in inside if isinstance(name, ast.Name))


def names_imported(module: str, tree: ast.Module) -> Iterator[tuple[Name, Name]]:
    """Yield what a file imports from the package: its name there and where it comes from."""
    for node in nodes(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (((module, a.asname or a.name), (node.module or "", a.name)) for a in node.names)


def names_used(trees: dict[str, ast.Module]) -> Iterator[Name]:
    """Yield what the files call, read or hand on, by where it was defined; importing is not using.

    An attribute of anything but a module may be that of any class, or of a module that is chosen by its name.
    """
    imported = {here: there for module, tree in trees.items() for here, there in names_imported(module, tree)}

    def origin(name: Name) -> Name:
        return name if imported.get(name, name) == name else origin(imported[name])

    for module, tree in trees.items():
        for node in nodes(tree):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                yield origin((module, node.id))
            elif isinstance(node, ast.Attribute):
                of = ".".join(origin((module, node.value.id))) if isinstance(node.value, ast.Name) else ""
                yield origin((of, node.attr)) if of in trees else ("", node.attr)


def test_everything_that_has_a_name_is_used() -> None:
    trees = {module_name(path): parsed(path) for path in FILES}
    pages = " ".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.html"))
    used = set(names_used(trees))
    anywhere = {name for _, name in used} | set(re.findall(r"\w+", pages))
    face = {*camtorque.__all__, *dir(camtorque.Recording), "_repr_html_"}
    unused = {
        name for module, tree in trees.items() for where, name in names_defined(module, tree)
        if (not {(where, name), ("", name)} & used if where else name not in anywhere)
    }  # fmt: skip
    assert {name for name in unused - face if not name.endswith("__")} == set(ONLY_SHOWN)


def test_every_field_is_read() -> None:
    trees = [parsed(path) for path in FILES]
    pages = " ".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.html"))
    read = {n.attr for t in trees for n in nodes(t) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Load)}
    classes = [node for tree in trees for node in nodes(tree) if isinstance(node, ast.ClassDef)]
    fields = {item.target.id for c in classes for item in c.body
              if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)}  # fmt: skip
    assert fields - read - set(re.findall(r"\.(\w+)", pages)) == set(ONLY_WRITTEN)


def test_every_test_that_the_page_of_faults_names_is_there() -> None:
    page = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    known = {
        node.name
        for path in (ROOT / "tests").rglob("test_*.py")
        for node in nodes(parsed(path))
        if isinstance(node, ast.FunctionDef)
    }
    named = set(re.findall(r"`(test_\w+)`", page))
    assert len(named) > 10
    assert not named - known
    assert all((ROOT / path).exists() for path in re.findall(r"`((?:tests|benchmarks)/[\w/.]*)`", page))
