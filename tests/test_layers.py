"""Imports point one way, and heavy or foreign packages stay behind their doors."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# What a module of each room may import of `upplied`; the rooms are in the order of the layers.
FOUNDATION = {
    "errors", "extras", "records", "config", "checks", "geometry", "cameras", "overlap", "photographed",
    "files", "threads", "provenance", "public",
}  # fmt: skip
ALLOWED = {
    "errors": set(),
    "extras": {"errors"},
    "records": {"errors"},
    "config": {"errors"},
    "cameras": {"errors", "records"},
    "overlap": {"geometry", "records"},
    "photographed": {"geometry", "overlap", "records"},
    "checks": {"errors", "records", "config"},
    "geometry": {"errors", "extras", "records", "config", "checks", "threads", "geometry"},
    "threads": set(),
    "files": set(),
    "public": set(),
    "provenance": set(),
    "planning": FOUNDATION | {"planning"},
    "samples": FOUNDATION | {"planning", "samples"},
    "simulate": FOUNDATION | {"planning"},
    "proof": FOUNDATION | {"planning", "proof"},
    "inputs": FOUNDATION | {"inputs"},
    "catalog": FOUNDATION | {"catalog"},
    "outputs": FOUNDATION | {"outputs", "inputs", "samples", "catalog", "planning", "proof"},
    "recommend": FOUNDATION | {"planning", "catalog", "recommend"},
    "fleet": FOUNDATION
    | {"planning", "simulate", "proof", "recommend", "inputs", "catalog", "outputs", "fleet"},
    "findings": FOUNDATION | {"planning", "proof", "inputs", "catalog", "outputs", "fleet", "findings"},
    "web": FOUNDATION | {"planning", "simulate", "proof", "catalog", "outputs", "fleet", "findings", "web"},
    "__main__": {"cli"},
    "cli": FOUNDATION
    | {
        "planning",
        "samples",
        "simulate",
        "proof",
        "recommend",
        "inputs",
        "catalog",
        "outputs",
        "fleet",
        "findings",
        "web",
        "cli",
    },
}
# The rooms of planning in the order of the method: each may use those before it.
ROOMS = (
    "constants",
    "geometry",
    "surface",
    "visibility",
    "correspondence",
    "airspace",
    "demonstration",
    "carry",
    "trajectory",
    "measures",
    "plan",
)
# The only rooms or modules that may import a package; None means nowhere in `upplied`.
DOORS = {
    "prefect": (),
    "open3d": ("geometry",),
    "cyclopts": ("cli",),
    "deltalake": ("catalog",),
    "mcap": ("inputs", "outputs"),
    "pickle": (),
}
FOREIGN_TO_PLANNING = {"pathlib", "pyarrow", "pandas", "mcap", "prefect", "deltalake", "os", "io", "shutil"}


def modules() -> list[Path]:
    return sorted((ROOT / "upplied").rglob("*.py"))


def room_of(path: Path) -> str:
    first = path.relative_to(ROOT / "upplied").parts[0]
    return first.removesuffix(".py")


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Full names of what a module imports anywhere in it, but for what only type checkers see."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    unseen = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    modules: list[str] = []
    for node in ast.walk(tree):
        if id(node) in unseen:
            continue
        if isinstance(node, ast.Import):
            modules += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            modules += (f"{node.module}.{alias.name}" for alias in node.names)
    return tuple(modules)


def named(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", modules(), ids=named)
def test_imports_point_one_way(path: Path):
    room = room_of(path)
    if room == "__init__":
        return  # the public names, loaded when asked for
    for name in imports(path):
        parts = name.split(".")
        assert name.split(".")[:2] != ["upplied", "flows"] or room == "cli", "only commands start flows"
        if (
            parts[0] == "upplied"
            and len(parts) > 1
            and (ROOT / "upplied" / parts[1]).exists() | (ROOT / "upplied" / f"{parts[1]}.py").exists()
        ):
            assert parts[1] in ALLOWED[room] | {room}, f"{room} imports {name}"
        elif parts[0] in DOORS:
            assert room in DOORS[parts[0]], f"{name} is imported outside {DOORS[parts[0]]}"


@pytest.mark.parametrize("path", sorted((ROOT / "upplied" / "planning").rglob("*.py")), ids=named)
def test_rooms_of_planning_use_those_before_them(path: Path):
    room = path.relative_to(ROOT / "upplied" / "planning").parts[0].removesuffix(".py")
    if room == "__init__":
        return
    used = {name.split(".")[2] for name in imports(path) if name.startswith("upplied.planning.")}
    assert used <= set(ROOMS[: ROOMS.index(room) + 1]), f"{room} may use the rooms before it alone"


def test_the_method_goes_from_room_to_room_and_not_back():
    """What `plan_transfer` is made of asks the rooms in their order: one pass from flight to plan."""
    tree = ast.parse((ROOT / "upplied" / "planning" / "plan.py").read_text(encoding="utf-8"))
    room_of_name = {
        alias.name: str(node.module).split(".")[2]
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("upplied.planning.")
        for alias in node.names
    }
    method = [
        node
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name in ("_begun", "_on_pair", "decided", "_planned")
    ]
    calls = [
        node
        for function in method
        for node in ast.walk(function)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    ]
    called = sorted((call.lineno, call.func.id) for call in calls if call.func.id in room_of_name)
    entered = [room_of_name[name] for _, name in called]
    assert len(entered) > 8 and entered == sorted(entered, key=ROOMS.index), called


@pytest.mark.parametrize(
    "path", sorted((ROOT / "upplied" / "planning" / "trajectory").rglob("*.py")), ids=named
)
def test_the_trajectory_takes_from_the_room_before_it_what_was_carried_and_calls_nothing_there(path: Path):
    used = [name for name in imports(path) if name.startswith("upplied.planning.carry.")]
    records = {name.rsplit(".", 1)[1] for name in used}
    assert all(name[0].isupper() for name in records), records


def test_outputs_know_the_rules_of_the_air_and_no_other_room_of_planning():
    """Missions are flown by the rules that plans are made by; nothing else of planning is needed."""
    used = {
        ".".join(name.split(".")[:3])
        for path in (ROOT / "upplied" / "outputs").rglob("*.py")
        for name in imports(path)
        if name.startswith("upplied.planning")
    }
    assert used <= {"upplied.planning.airspace", "upplied.planning.surface"}


# Rooms after the plan that ask `scene_of`, the surface that was scanned alone, and what for; all others ask
# `supposed_scene.scene_for`, which knows what was never scanned as well.
SCANNED_ALONE = {
    "fleet/editing.py": "samples of a structure",
    "fleet/flight_logs.py": "samples, and what a real flight kept clear of and saw: it is its own evidence",
    "outputs/logs.py": "a picture of what is known",
    "outputs/mission_drawing.py": "how high above the ground, and what real photos looked at: what is there",
    "outputs/missions/transits.py": "samples of a structure",
    "outputs/reports.py": "the demonstration, round the structure that it was flown on",
    "proof/required_zones.py": "samples of a structure, and its parts",
}


def test_rooms_after_the_plan_count_what_was_never_scanned():
    asking = {
        str(path.relative_to(ROOT / "upplied"))
        for room in ("outputs", "fleet", "web", "proof", "cli")
        for path in (ROOT / "upplied" / room).rglob("*.py")
        if any(name == "upplied.geometry.scene.scene_of" for name in imports(path))
    }
    assert asking == set(SCANNED_ALONE)


def test_no_module_circle_in_any_room():
    graph = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): {
            ".".join(name.split(".")[:length]) for name in imports(path) for length in range(2, 6)
        }
        for path in modules()
        if path.name != "__init__.py"
    }
    order = TopologicalSorter({name: used & set(graph) - {name} for name, used in graph.items()})
    assert set(order.static_order()) == set(graph)  # raises CycleError, which names the modules of the circle


@pytest.mark.parametrize("path", sorted((ROOT / "upplied" / "planning").rglob("*.py")), ids=named)
def test_planning_knows_no_files(path: Path):
    assert not {name.split(".")[0] for name in imports(path)} & FOREIGN_TO_PLANNING
    calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)]
    assert not [
        call for call in calls if isinstance(call.func, ast.Name) and call.func.id in ("open", "print")
    ]


def test_the_public_names_are_what_they_say_and_no_others():
    import upplied

    assert set(upplied.__all__) == set(upplied._PUBLIC) | {"__version__"}
    for name in upplied.__all__:
        assert getattr(upplied, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'plan'"):
        _ = upplied.plan


def test_every_room_has_its_rule():
    assert {room_of(path) for path in modules()} - {"__init__"} <= set(ALLOWED)


@pytest.mark.parametrize(
    ("statement", "unwanted"),
    [
        ("import upplied", ("open3d", "prefect", "numba", "pyarrow")),
        ("import upplied.cli", ("open3d", "prefect", "numba", "numpy", "pandas")),
        ("import upplied.catalog", ("open3d", "prefect", "numba")),
        ("from upplied import open_catalog", ("open3d", "prefect", "numba", "scipy")),
        ("import upplied.fleet", ("open3d", "prefect", "numba", "pyarrow")),
        ("import upplied.fleet.planner", ("open3d", "prefect", "mcap", "upplied.inputs", "upplied.outputs")),
        (
            "from upplied.geometry.scene import open3d; open3d()",
            ("dash", "plotly", "pydantic", "IPython", "pandas"),
        ),
    ],
)
def test_what_an_import_must_not_load(statement: str, unwanted: tuple[str, ...]):
    code = f"{statement}; import sys; print([name for name in {unwanted} if name in sys.modules])"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "[]"


def test_a_catalog_is_built_from_its_schema_up() -> None:
    above = {"schema": ("store", "verbs"), "store": ("verbs",)}
    for room, others in above.items():
        for path in (ROOT / "upplied" / "catalog" / room).glob("*.py"):
            text = path.read_text(encoding="utf-8")
            assert not [name for name in others if f"upplied.catalog.{name}" in text.split('"""')[2]], path
