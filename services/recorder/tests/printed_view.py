"""What Rerun's own program reads in a view's file."""

import re
import subprocess


def run_rerun(program, environment, *arguments):
    """Return what the program prints."""
    return subprocess.run(
        [program, *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=120, check=True
    ).stdout


def rows_of(program, environment, entity, file):
    """Return how many rows an entity has."""
    printed = run_rerun(program, environment, "rrd", "print", "--entity", entity, file)
    return sum(int(count) for count in re.findall(r"with (\d+) rows", printed))


def legend_of(program, environment, entity, file):
    """Return the name that a curve has in the legend: the last that it was given."""
    printed = run_rerun(program, environment, "rrd", "print", "-vvv", "--entity", entity, file)
    rows = [line for line in printed.splitlines() if "row_" in line and "iteration" in line]
    names = [re.search(r"row_(\w+).*\[(iteration [^\]]*)\]", line) for line in rows]
    return max(name.groups() for name in names if name)[1]
