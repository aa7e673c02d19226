"""Counts of the source, and its import graph: ``python tests/helpers/source_tree.py`` prints them.

Lines of code are those that are neither blank nor comments nor docstrings (of fields and constants
too).  An import counts wherever it stands: at the top of a module, under ``TYPE_CHECKING``, or
within a function.
"""

import ast

from places import ROOT

PACKAGES = ("scene", "closure", "montecarlo", "compare")


def sources():
    """The modules of the four packages by dotted name, such as ``montecarlo.kernel.block``."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = ast.parse(path.read_text(), filename=str(path))
    return found


def docstring_lines(tree):
    """Numbers of the lines that docstrings stand on: every string that is a statement."""
    return {
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or 0) + 1)
    }


def import_graph(modules):
    """The modules of this project that each module imports."""
    graph = {name: set() for name in modules}
    for name, tree in modules.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("rattle."):
                source = str(node.module).removeprefix("rattle").removeprefix(".")
                targets = {f"{source}.{alias.name}".removeprefix(".") for alias in node.names}
                graph[name] |= targets & modules.keys()
                if targets - modules.keys():
                    graph[name] |= {source} & modules.keys()
    return graph


def circles(graph):
    """Sets of modules that import each other, directly or through others."""
    reach = {name: set(found) for name, found in graph.items()}
    for middle in graph:
        for name in graph:
            if middle in reach[name]:
                reach[name] |= reach[middle]
    joined = {
        frozenset(other for other in graph if other in reach[name] and name in reach[other])
        for name in graph
    }
    return [set(circle) for circle in joined if circle]


def rooms(graph, package):
    """The folders and single modules of a package, and which others of them each one imports."""
    inside = {
        name: ".".join(name.split(".")[:2]) for name in graph if name.startswith(f"{package}.")
    }
    found = {room: set() for room in inside.values()}
    for name, room in inside.items():
        found[room] |= {inside[target] for target in graph[name] & inside.keys()} - {room}
    return found


def rows():
    """For each package and for all: modules, lines, lines of code, lines of docstrings."""
    everything = []
    for package in PACKAGES:
        found = []
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text()
            documented = docstring_lines(ast.parse(text))
            lines = [line.strip() for line in text.splitlines()]
            code = sum(
                number not in documented and line != "" and not line.startswith("#")
                for number, line in enumerate(lines, 1)
            )
            found.append((1, len(lines), code, len(documented)))
        yield package, *map(sum, zip(*found, strict=True))
        everything += found
    yield "all", *map(sum, zip(*everything, strict=True))


def main():
    """Print the counts."""
    print(f"{'':12}{'modules':>8}{'lines':>8}{'code':>8}{'docstrings':>12}")
    for package, modules, lines, code, documented in rows():
        print(f"{package:12}{modules:8}{lines:8}{code:8}{documented:8} {documented / lines:3.0%}")
    print(f"{len(circles(import_graph(sources())))} import circles")


if __name__ == "__main__":
    main()
