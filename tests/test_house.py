"""The rules of the house: sizes, docstrings, pinned versions, no traces of a machine."""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from fnmatch import fnmatch
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DISTRIBUTIONS = sorted(
    path.parent.relative_to(ROOT) for path in [*ROOT.glob("*/pyproject.toml"), *ROOT.glob("*/*/pyproject.toml")]
)
MACHINE_PATH = re.compile(r"(?<![\w.~}:/-])/(?:root|home|tmp|work|Users)/\w")
ARRAY = re.compile(r"NDArray|ndarray|ArrayLike")
SHAPE = re.compile(r"[Ss]hape|\([\w ]+,|[Ss]ame")
PUBLIC_FOLDERS = {ROOT / "duralab" / "duralab" / folder for folder in ("formats", "target", "testing")}
"""Folders inside a package that users import from; of the others, one paragraph with shapes and units is enough."""
ELEMENTARY = {"services/rig_sim/rig_sim/compile/numeric.py"}
"""Modules of functions that a pocket calculator has: one line says what each is."""


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


@cache
def _package_modules():
    """Return path and syntax tree of every module; parsing them all takes seconds."""
    modules = []
    for distribution in DISTRIBUTIONS:
        manifest = tomllib.loads((ROOT / distribution / "pyproject.toml").read_text())
        for package in manifest["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
            for path in sorted((ROOT / distribution / package).rglob("*.py")):
                if not path.stem.endswith("_pb2"):
                    modules.append((path, ast.parse(path.read_text(encoding="utf-8"))))
    return modules


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


def test_all_distributions_are_here():
    assert [str(path) for path in DISTRIBUTIONS] == [
        "duralab",
        "libs/bus",
        "libs/drive_files",
        "libs/drive_map",
        "libs/gateway",
        "libs/loads",
        "libs/monitoring",
        "libs/recordings",
        "libs/roads",
        "libs/schedules",
        "libs/settings",
        "libs/spectra",
        "proto",
        "services/file_rig",
        "services/identifier",
        "services/iterator",
        "services/operator_page",
        "services/recorder",
        "services/rig_sim",
        "services/sequencer",
    ]


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


def _undescribed(function, *, raises=True):
    """Name what the docstring of a function lacks of Parameters, Returns and Raises."""
    docstring = ast.get_docstring(function) or ""
    described = _section(docstring, "Parameters")
    lacking = [p.arg for p in _parameters(function) if not re.search(rf"^[\w, *]*\b{p.arg}\b", described, re.M)]
    returns = function.returns is not None and ast.unparse(function.returns) != "None"
    if returns and _parameters(function) and not (_section(docstring, "Returns") or _section(docstring, "Yields")):
        lacking.append("Returns")
    if raises and _refuses(function) and not _section(docstring, "Raises"):
        lacking.append("Raises")
    return lacking


def _refuses(function):
    return any(isinstance(node, ast.Raise) and node.exc is not None for node in ast.walk(function))


def _undescribed_in_class(node):
    """Name what the docstring of a class lacks: of what makes it, where users make it, and of what it refuses."""
    docstring = ast.get_docstring(node) or ""
    described = _section(docstring, "Parameters") + _section(docstring, "Attributes")
    methods = {item.name: item for item in node.body if isinstance(item, ast.FunctionDef)}
    fields = [item for item in node.body if isinstance(item, ast.AnnAssign)]
    if "__init__" in methods:
        names = [p.arg for p in _parameters(methods["__init__"])]
    else:
        is_dataclass = any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list)
        told = {a.target.id for a, b in pairwise(node.body) if a in fields and isinstance(b, ast.Expr)}
        names = [field.target.id for field in fields if is_dataclass and field.target.id not in told]
    lacking = [name for name in names if not re.search(rf"^[\w, *]*\b{name}\b", described, re.M)]
    if "__init__" in methods and re.search(r"\bmade by\b|never directly", docstring, re.I):
        lacking = []
    makers = [methods[name] for name in ("__init__", "__post_init__") if name in methods]
    if any(_refuses(maker) for maker in makers) and not _section(docstring, "Raises"):
        lacking.append("Raises")
    return lacking


@cache
def _exported():
    """Return the definitions of what users import: of several of one name, the one nearest to the package."""
    exports, definitions, found = {}, {}, []
    for path, tree in _package_modules():
        for node in tree.body:
            is_face = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
            if is_face and (path.parent in PUBLIC_FOLDERS or not (path.parent.parent / "__init__.py").is_file()):
                exports[path.parent] = ast.literal_eval(node.value)
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                definitions.setdefault(node.name, []).append((path, node))
    for package, names in exports.items():
        for name in names:
            inside = [(path, node) for path, node in definitions.get(name, []) if package in path.parents]
            if inside:
                found.append(min(inside, key=lambda one: len(one[0].parts)))
    return found


def test_what_packages_export_tells_the_shapes_of_arrays():
    silent = []
    for path, node in _exported():
        if not isinstance(node, ast.FunctionDef) or not _takes_arrays(node) or _name(path) in ELEMENTARY:
            continue
        docstring = ast.get_docstring(node) or ""
        entries = re.split(r"(?m)^(?=\S)", _section(docstring, "Parameters"))
        for parameter in _parameters(node):
            if re.match(r"(np\.)?(NDArray|ndarray|ArrayLike)", ast.unparse(parameter.annotation or node.args)):
                told = [entry for entry in entries if re.match(rf"[\w, *]*\b{parameter.arg}\b", entry)]
                silent += [f"{_name(path)}:{node.name}.{parameter.arg}" for entry in told if not SHAPE.search(entry)]
        returns_array = re.match(r"(np\.)?(NDArray|ndarray)", ast.unparse(node.returns or node.args))
        if returns_array and not SHAPE.search(_section(docstring, "Returns")):
            silent.append(f"{_name(path)}:{node.name} -> ")
    assert silent == []


def test_what_packages_export_documents_parameters_results_and_refusals():
    incomplete = {}
    for path, node in _exported():
        if _name(path) in ELEMENTARY:
            continue
        lacking = _undescribed_in_class(node) if isinstance(node, ast.ClassDef) else _undescribed(node)
        if lacking:
            incomplete[f"{_name(path)}:{node.name}"] = lacking
    assert incomplete == {}


def test_the_methods_of_the_sdk_document_parameters_results_and_refusals():
    """Some point to the method they call; decoding a message is for this project's own code."""
    incomplete = {}
    sdk = ROOT / "duralab"
    own = {n.name: (path, n) for path, tree in _package_modules() for n in tree.body if isinstance(n, ast.ClassDef)}
    classes = [(path, node) for path, node in _exported() if isinstance(node, ast.ClassDef) and sdk in path.parents]
    classes += [own[base.id] for _, node in classes for base in node.bases if getattr(base, "id", "") in own]
    for path, node in classes:
        for method in node.body:
            if not isinstance(method, ast.FunctionDef | ast.AsyncFunctionDef) or not _parameters(method):
                continue
            internal = method.name.startswith(("_", "from_message", "read_from"))
            if internal or re.search(r"see `(Lab|Identifier)\.\w+`", ast.get_docstring(method) or ""):
                continue
            if lacking := _undescribed(method):
                incomplete[f"{_name(path)}:{node.name}.{method.name}"] = lacking
    assert incomplete == {}


def test_every_folder_says_what_it_is():
    """Folders of several files by a README or a package's docstring, packages by both."""
    files = [path.relative_to(ROOT) for path in _tracked()]
    counted = Counter(parent for path in files for parent in path.parents)
    near = {"", "deploy", "docs", "examples", "libs", "scripts", "services", "tests"}
    folders = {
        folder
        for folder, count in counted.items()
        if count > 1 and folder.name and not folder.name.startswith(".") and folder.parent.as_posix().strip(".") in near
    }
    packages = {
        path.parent for path in files if path.suffix == ".py" and (ROOT / path.parent / "__init__.py").is_file()
    }
    silent = []
    for folder in sorted(folders | packages):
        readme, package = ROOT / folder / "README.md", ROOT / folder / "__init__.py"
        documented = package.is_file() and ast.get_docstring(ast.parse(package.read_text(encoding="utf-8")))
        if not (readme.is_file() or documented):
            silent.append(folder.as_posix())
    assert silent == []


@pytest.mark.parametrize("folder", ["benchmarks", "examples", "scripts", "studies", "tests"])
def test_a_readme_with_a_table_of_files_names_those_that_are_there_and_no_others(folder):
    text = (ROOT / folder / "README.md").read_text(encoding="utf-8")
    named = [name.rstrip("/") for name in re.findall(r"[\w*./-]+", text) if re.search(r"\.\w+$|/$", name)]
    there = {path.relative_to(ROOT / folder).as_posix() for path in _tracked() if path.is_relative_to(ROOT / folder)}
    there = {name for name in there if "/" not in name and name not in ("README.md", "conftest.py")}
    assert sorted(name for name in there if not any(fnmatch(name, pattern) for pattern in named)) == []
    rows = "".join(re.findall(r"^\| ?`[^|]*\|", text, re.M))
    listed = re.findall(r"`([\w*/-]+(?:\.[\w*]+|/))`", rows)
    assert [name for name in listed if not list((ROOT / folder).glob(name.rstrip("/")))] == []


@pytest.mark.parametrize("distribution", DISTRIBUTIONS, ids=str)
def test_every_distribution_has_a_readme_and_its_tests_beside_it(distribution):
    readme = ROOT / distribution / "README.md"
    assert readme.is_file(), f"{distribution} has no README.md"
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


def test_no_file_has_the_marks_of_an_unfinished_merge():
    # Of all languages: no linter here reads the scripts of pages.
    marks = ["git", "grep", "--name-only", "-I", "-E", "^(<{7}|>{7}) "]
    assert subprocess.run(marks, cwd=ROOT, capture_output=True, text=True, check=False).stdout.split() == []


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


def test_no_lock_file_names_an_address():
    locks = [path for path in _tracked() if re.search(r"lock", path.name)]
    assert ROOT / "requirements.lock" in locks
    assert [_name(path) for path in locks if "://" in path.read_text(encoding="utf-8")] == []


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
        needed |= {re.split(r"[\[<>=~!;]", name)[0].lower() for name in project["dependencies"]}
    assert sorted(needed - own - set(asked)) == []


@pytest.mark.parametrize("script", [".ci/run", "scripts/lowest.sh", "scripts/setup.sh", "scripts/uv.sh"])
def test_scripts_can_be_run_and_are_well_formed(script):
    path = ROOT / script
    assert path.stat().st_mode & 0o111, f"{script} is not executable"
    checked = subprocess.run(["bash", "-n", path], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr


def test_no_import_runs_up_or_in_a_circle_and_no_folder_is_a_heap():
    counted = subprocess.run([sys.executable, ROOT / "scripts/house.py"], capture_output=True, text=True, check=False)
    assert (counted.returncode, counted.stderr) == (0, ""), counted.stdout
    assert re.search(r"^duralab +\d+ +\d+ +\d+ +\d+ +0 +0$", counted.stdout, re.M), counted.stdout
