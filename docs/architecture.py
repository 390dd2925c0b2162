# SPDX-License-Identifier: Apache-2.0
"""Draws docs/architecture.md, the picture of the folders, from the imports in the sources.

    python docs/architecture.py

An arrow points from a room to one that it imports. Arrows that follow from others are left out:
with a to b and b to c, a to c is not drawn. Dashed: inside functions only, so it loads when used.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path

PACKAGE = "stickslip_ros"
PAGE = Path(__file__).parent / "architecture.md"
_HEAD = """# The folders, drawn from their imports

The physics moves an axis; a simulation asks it; recordings keep it; measurements are held against
it; ROS, emulated controllers and a command line reach it. [How to work here](../CONTRIBUTING.md)
says what each folder is for. An arrow points from a folder to one that it imports; arrows that
follow from others are left out. Dashed: imported inside functions only. `python
docs/architecture.py` writes this page, and `make lint` says when that is due.

"""

#: Rooms by room.
Arrows = Mapping[str, set[str]]


def _imports(tree: ast.AST) -> Iterator[tuple[str, bool]]:
    """Yield the full names that a tree imports, and whether inside a function."""
    waiting = [(tree, False)]
    while waiting:
        node, late = waiting.pop()
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((f"{node.module}.{alias.name}", late) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, late) for alias in node.names)
        if isinstance(node, ast.expr) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        ):
            continue  # nothing is loaded
        late = late or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        waiting += ((child, late) for child in ast.iter_child_nodes(node))


def arrows(sources: Path) -> tuple[Arrows, Arrows]:
    """Return which rooms each room imports, at once and inside functions only."""
    rooms = {path.parent.name for path in sources.glob("*/__init__.py")}
    at_once: dict[str, set[str]] = defaultdict(set)
    late: dict[str, set[str]] = defaultdict(set)
    for file in sources.glob("*/**/*.py"):
        room = file.relative_to(sources).parts[0]
        for name, inside in _imports(ast.parse(file.read_text(encoding="utf-8"))):
            package, _, rest = name.partition(".")
            target = rest.partition(".")[0]
            if package == PACKAGE and target in rooms - {room}:
                (late if inside else at_once)[room].add(target)
    return at_once, {room: found - at_once[room] for room, found in late.items()}


def reach(start: str, graph: Arrows) -> set[str]:
    """Return every room that can be reached from one."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        for room in graph.get(waiting.pop(), set()) - found:
            found.add(room)
            waiting.append(room)
    return found


def needed(graph: Arrows) -> dict[str, set[str]]:
    """Return the graph without the arrows that follow from others."""
    return {
        room: {one for one in targets if not any(one in reach(by, graph) for by in targets - {one})}
        for room, targets in graph.items()
    }


def drawn(sources: Path) -> str:
    """Return the page."""
    at_once, late = arrows(sources)
    lines = ["graph TD"]
    for room, targets in sorted(needed(at_once).items()):
        lines += [f"    {room} --> {target}" for target in sorted(targets)]
    for room, targets in sorted(late.items()):
        known = reach(room, at_once)
        lines += [f"    {room} -.-> {target}" for target in sorted(targets - known)]
    return _HEAD + "```mermaid\n" + "\n".join(lines) + "\n```\n"


if __name__ == "__main__":
    PAGE.write_text(drawn(PAGE.parent.parent / PACKAGE), encoding="utf-8")
