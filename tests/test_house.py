"""The rules of the house: sizes, docstrings, pinned versions, no traces of a machine."""

import ast
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DISTRIBUTIONS = sorted(
    path.parent.relative_to(ROOT) for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("*/*/pyproject.toml")]
)
LONGEST_FILE, LONGEST_README = 350, 60
MACHINE_PATH = re.compile(r"(?<![\w.~}:/-])/(?:root|home|tmp|work|Users)/\w")
ARRAY = re.compile(r"NDArray|ndarray|ArrayLike")


def _tracked():
    """List the repository's own text files; outside of git there is nothing to compare with."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    if listed.returncode != 0:
        pytest.skip("this is not a git work tree")
    return sorted({ROOT / name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()})


def _own_python(paths):
    return [path for path in paths if path.suffix == ".py" and not path.name.endswith("_pb2.py")]


def _package_modules():
    for distribution in DISTRIBUTIONS:
        manifest = tomllib.loads((ROOT / distribution / "pyproject.toml").read_text())
        for package in manifest["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
            for path in sorted((ROOT / distribution / package).rglob("*.py")):
                if not path.stem.endswith("_pb2"):
                    yield path, ast.parse(path.read_text(encoding="utf-8"))


def _name(path):
    return str(path.relative_to(ROOT))


def _parameters(function):
    arguments = function.args
    return [
        argument
        for argument in [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        if argument.arg not in ("self", "cls")
    ]


def _takes_arrays(function):
    return any(p.annotation is not None and ARRAY.search(ast.unparse(p.annotation)) for p in _parameters(function))


def _section(docstring, title):
    """Return the body of a numpydoc section, empty where there is none."""
    match = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[^\n]*\n-{{3,}}\n|\Z)", docstring, flags=re.MULTILINE | re.DOTALL)
    return match.group(1) if match else ""


def test_all_ten_distributions_are_here():
    assert [str(path) for path in DISTRIBUTIONS] == [
        "duralab",
        "libs/labbus",
        "libs/loads",
        "libs/roads",
        "libs/spectra",
        "proto",
        "services/identifier",
        "services/iterator",
        "services/recorder",
        "services/rig_sim",
    ]


def test_no_file_needs_more_than_one_reading():
    lengths = {_name(path): path.read_text(encoding="utf-8").count("\n") for path in _own_python(_tracked())}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FILE} == {}


def test_every_module_and_everything_exported_says_what_it_is():
    missing = []
    definitions, exported = {}, set()
    for path, tree in _package_modules():
        if not ast.get_docstring(tree):
            missing.append(_name(path))
        package = path.relative_to(ROOT).parts[-2]
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                definitions[package, node.name] = ast.get_docstring(node)
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                exported |= {(package, name) for name in ast.literal_eval(node.value)}
    missing += [f"{package}.{name}" for package, name in exported if definitions.get((package, name), "alias") is None]
    assert sorted(missing) == []


def test_functions_on_arrays_document_every_parameter_and_what_they_return():
    incomplete = {}
    for path, tree in _package_modules():
        for node in tree.body:
            if not isinstance(node, ast.FunctionDef) or node.name.startswith("_") or not _takes_arrays(node):
                continue
            docstring = ast.get_docstring(node) or ""
            described = _section(docstring, "Parameters")
            lacking = [p.arg for p in _parameters(node) if not re.search(rf"^[\w, *]*\b{p.arg}\b", described, re.M)]
            returns = node.returns is not None and ast.unparse(node.returns) != "None"
            if returns and not (_section(docstring, "Returns") or _section(docstring, "Yields")):
                lacking.append("Returns")
            if lacking:
                incomplete[f"{_name(path)}:{node.name}"] = lacking
    assert incomplete == {}


@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=str)
def test_every_distribution_has_a_readme_of_a_screen_and_its_tests_beside_it(distribution):
    readme = ROOT / distribution / "README.md"
    assert readme.is_file(), f"{distribution} has no README.md"
    assert readme.read_text(encoding="utf-8").count("\n") <= LONGEST_README
    assert list((ROOT / distribution / "tests").glob("test_*.py")), f"{distribution} has no tests"


def test_no_file_knows_the_machine_it_was_written_on():
    found = {}
    for path in _tracked():
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError:
            continue  # pictures and other binary files
        hits = [number for number, line in enumerate(lines, start=1) if MACHINE_PATH.search(line)]
        if hits:
            found[_name(path)] = hits
    assert found == {}


def test_the_lock_pins_every_package_with_hashes_and_names_no_index():
    lock = (ROOT / "requirements.lock").read_text()
    entries = re.split(r"(?m)^(?=\S)", lock)[1:]
    assert len(entries) > 50
    assert [entry.splitlines()[0] for entry in entries if not re.match(r"[a-z0-9.-]+==\S+", entry)] == []
    assert [entry.splitlines()[0] for entry in entries if "--hash=sha256:" not in entry] == []
    assert re.findall(r"://|index-url|find-links", lock) == []


def test_set_up_goes_to_no_address():
    files = [ROOT / "Makefile", ROOT / "requirements.in", *(ROOT / "scripts").glob("*"), *(ROOT / ".ci").glob("*")]
    assert [_name(path) for path in files if path.is_file() and "://" in path.read_text(encoding="utf-8")] == []


def test_every_dependency_is_named_once_and_locked():
    asked = [
        line.strip().lower()
        for line in (ROOT / "requirements.in").read_text().splitlines()
        if line.strip() and not line.startswith("#")
    ]
    assert len(asked) == len(set(asked))
    locked = set(re.findall(r"(?m)^([a-z0-9.-]+)==", (ROOT / "requirements.lock").read_text()))
    assert sorted(set(asked) - locked) == []
    own, needed = set(), set()
    for distribution in DISTRIBUTIONS:
        project = tomllib.loads((ROOT / distribution / "pyproject.toml").read_text())["project"]
        own.add(project["name"])
        needed |= {name.lower() for name in project["dependencies"]}
    assert sorted(needed - own - set(asked)) == []


@pytest.mark.parametrize("script", [".ci/run", "scripts/setup.sh", "scripts/uv.sh"])
def test_scripts_can_be_run_and_are_well_formed(script):
    path = ROOT / script
    assert path.stat().st_mode & 0o111, f"{script} is not executable"
    checked = subprocess.run(["bash", "-n", path], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr
