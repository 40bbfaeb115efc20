"""Build all distributions into dist/ and try them in empty environments: `make dist`.

The sources are copied, and the copy gets the version of `version.py` and exact pins between the distributions, so that
an installation never mixes releases. Each wheel is built from its sdist.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from version import ROOT, version

DIST: Final = ROOT / "dist"
PYTHONS: Final = ("3.11", "3.12", "3.13", "3.14")
CAMPAIGN: Final = "front_axle_demo"
_UV: Final = str(ROOT / "scripts" / "uv.sh")
_NO_WHEEL: Final = re.compile(
    r"(\S+?)(?:[=<>~!]\S*)? has no wheels with a matching|(\S+?)(?:[=<>~!]\S*)? has no usable wheels"
)


@dataclass(frozen=True)
class Trial:
    """Result of installing and running the lab on one Python; `reason` says why it was skipped or failed."""

    python: str
    reason: str = ""
    skipped: bool = False
    install_minutes: float = 0.0
    run_minutes: float = 0.0


def manifests() -> list[Path]:
    """Return the pyproject.toml of every distribution."""
    return sorted(
        [
            ROOT / "proto/pyproject.toml",
            *ROOT.glob("libs/*/pyproject.toml"),
            *ROOT.glob("services/*/pyproject.toml"),
            ROOT / "duralab/pyproject.toml",
        ]
    )


def released_manifest(text: str, release: str) -> str:
    """Return the pyproject.toml for an sdist: with the version, and all other distributions pinned to it.

    Raises
    ------
    ValueError
        The manifest does not take its version from `version.py`.
    """
    if 'dynamic = ["version"]\n' not in text:
        raise ValueError('a pyproject.toml has no `dynamic = ["version"]`; take the version from scripts/version.py.')
    text = text.replace(
        'dynamic = ["version"]\n', f'version = "{release}"\nreadme = "README.md"\nlicense-files = ["LICENSE"]\n'
    )
    text = re.sub(r"(?m)^\[tool\.hatch\.version\]\n(?:[^\[\n].*\n)*\n?", "", text)
    project = tomllib.loads(text)["project"]
    extras = project.get("optional-dependencies", {})
    for key in ("dependencies", *extras):
        text = re.sub(
            rf"(?m)^{key} = \[.*\]$",
            lambda line: re.sub(r'"(duralab[a-z-]*)((?:\[[a-z,]+\])?)"', rf'"\1\2=={release}"', line[0]),
            text,
        )
    return text


def stage(folder: Path, into: Path, release: str) -> None:
    """Copy the files of one distribution that belong to the repository, with its released manifest and the licence."""
    listed = _output("git", "-C", str(ROOT), "ls-files", "-z", "--", str(folder.relative_to(ROOT))).split("\0")
    for name in filter(None, listed):
        source = ROOT / name
        target = into / source.relative_to(folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)
    manifest = into / "pyproject.toml"
    manifest.write_text(released_manifest(manifest.read_text(encoding="utf-8"), release), encoding="utf-8")
    shutil.copy(ROOT / "LICENSE", into / "LICENSE")


def build(release: str) -> None:
    """Build sdist and wheel of every distribution into an empty dist/, with the sums of all files."""
    shutil.rmtree(DIST, ignore_errors=True)
    DIST.mkdir()
    # Use the commit's time in every archive, so that the same commit gives the same bytes.
    environment = {
        **os.environ,
        "SOURCE_DATE_EPOCH": _output("git", "-C", str(ROOT), "log", "-1", "--format=%ct").strip(),
    }
    with tempfile.TemporaryDirectory(prefix="duralab-dist-") as scratch:
        for manifest in manifests():
            folder = Path(scratch) / manifest.parent.name
            stage(manifest.parent, folder, release)
            _run(
                _UV,
                "build",
                "--quiet",
                "--no-build-isolation",
                "--python",
                sys.executable,
                "--out-dir",
                str(DIST),
                str(folder),
                env=environment,
            )
    # uv creates this file against accidental commits; dist/ is already ignored.
    (DIST / ".gitignore").unlink(missing_ok=True)
    sdists, wheels = sorted(DIST.glob("*.tar.gz")), sorted(DIST.glob("*.whl"))
    count = len(manifests())
    if not len(sdists) == len(wheels) == count:
        raise SystemExit(f"dist/ has {len(sdists)} sdists and {len(wheels)} wheels of {count} distributions.")
    size = sum(path.stat().st_size for path in (*sdists, *wheels)) / 1e6
    _say(f"Built {count} sdists and {count} wheels of {release} into dist/, {size:.1f} MB.")


def write_sums() -> None:
    """Write the SHA-256 of every file of dist/ into dist/SHA256SUMS."""
    files = sorted(path for path in DIST.iterdir() if path.name != "SHA256SUMS")
    lines = (f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files)
    (DIST / "SHA256SUMS").write_text("".join(lines), encoding="ascii")


def interpreters() -> dict[str, str]:
    """Return the path of each Python of PYTHONS on this machine: on PATH, or of pyenv."""
    found = {}
    for python in PYTHONS:
        candidates = [f"/usr/bin/python{python}", f"/usr/local/bin/python{python}"]
        candidates += sorted(map(str, Path.home().glob(f".pyenv/versions/{python}.*/bin/python{python}")))
        candidates += filter(None, [shutil.which(f"python{python}")])
        for candidate in candidates:
            if _answers(candidate, python):
                found[python] = candidate
                break
    return found


def try_client(release: str, python: str, scratch: Path) -> None:
    """Install `duralab` alone: it must have no simulator, answer, and name the extra that runs a lab."""
    program = _environment(f"duralab=={release}", python, scratch / "client")
    if (program.parent.parent / "lib" / f"python{_minor(python)}" / "site-packages" / "pydrake").exists():
        raise SystemExit("`duralab` alone installed Drake; only duralab[lab] may.")
    _check_version(program, release)
    done = _in_empty_folder([str(program), "run", CAMPAIGN, "--out", "out"], scratch)
    if done.returncode == 0 or "pip install 'duralab[lab]'" not in done.stderr or "Traceback" in done.stderr:
        raise SystemExit(
            f"`duralab run` without the lab must name duralab[lab] in one sentence; it said: {done.stderr}"
        )
    _say(f"`duralab` alone, Python {_minor(python)}: no Drake; `duralab run` says: {done.stderr.strip()}")


def try_lab(release: str, python: str, scratch: Path, *, sbom: bool) -> Trial:
    """Install `duralab[lab]` into an empty environment, run the shipped campaign, and time both."""
    minor = _minor(python)
    started = time.monotonic()
    try:
        program = _environment(f"duralab[lab]=={release}", python, scratch / f"lab-{minor}")
    except subprocess.CalledProcessError as error:
        said = " ".join(str(error.stderr).split())
        no_wheel = _NO_WHEEL.search(said)
        reason = f"no wheel of {no_wheel[1] or no_wheel[2]} for it" if no_wheel else said[-400:]
        return Trial(minor, reason, skipped=no_wheel is not None)
    installed = time.monotonic()
    _check_version(program, release)
    out = scratch / f"run-{minor}"
    done = _in_empty_folder([str(program), "run", CAMPAIGN, "--out", str(out)], scratch)
    ended = time.monotonic()
    if done.returncode != 0 or not (out / "report.html").is_file():
        return Trial(minor, f"duralab run: exit code {done.returncode}, {done.stderr.strip()[-400:]}")
    if sbom:
        target = DIST / f"duralab-{release}.cdx.json"
        bill = ("environment", "--output-reproducible", "--of", "JSON", "--output-file", str(target))
        _run(str(ROOT / ".venv/bin/cyclonedx-py"), *bill, str(program.with_name("python")))
    return Trial(minor, "", False, (installed - started) / 60.0, (ended - installed) / 60.0)


def try_tool(release: str, python: str, scratch: Path) -> None:
    """Start the command without an installation, as uvx does."""
    started = time.monotonic()
    command = [_UV, "tool", "run", "--quiet", "--python", python, "--find-links", str(DIST)]
    done = _in_empty_folder([*command, "--from", f"duralab=={release}", "duralab", "--version"], scratch)
    if done.returncode != 0 or done.stdout.strip() != f"duralab {release}":
        raise SystemExit(f"uvx --from duralab did not start: {done.stderr.strip()[-400:] or done.stdout}")
    _say(f"`uvx --from duralab duralab --version` from the wheels: {time.monotonic() - started:.1f} s.")


def try_pipx(release: str, python: str, scratch: Path) -> None:
    """Start the command as `pipx run` does, with pipx from the index."""
    started = time.monotonic()
    wheel = next(DIST.glob(f"duralab-{release}-*.whl"))
    command = [_UV, "tool", "run", "--quiet", "--python", python, "pipx", "run", "--python", python]
    places = {"PIPX_HOME": str(scratch / "pipx"), "PIPX_DEFAULT_BACKEND": "pip"}
    options = ["--pip-args", f"--find-links {DIST} --only-binary :all:", "--spec", str(wheel)]
    done = _in_empty_folder([*command, *options, "duralab", "--version"], scratch, **places)
    if done.returncode != 0 or done.stdout.strip() != f"duralab {release}":
        raise SystemExit(f"pipx run duralab did not start: {done.stderr.strip()[-400:] or done.stdout}")
    _say(f"`pipx run --spec {wheel.name} duralab --version`: {time.monotonic() - started:.1f} s.")


def report(trials: Iterable[Trial]) -> str:
    """Return a table of all trials."""
    lines = ["Python  install     run  result", "        minutes minutes"]
    for trial in trials:
        if trial.reason:
            lines.append(f"{trial.python:<7} {'':7} {'':7} {'skipped' if trial.skipped else 'FAILED'}: {trial.reason}")
        else:
            lines.append(f"{trial.python:<7} {trial.install_minutes:7.1f} {trial.run_minutes:7.1f} passed")
    return "\n".join(lines)


def _environment(requirement: str, python: str, folder: Path) -> Path:
    """Install a requirement from dist/ into an empty environment, its dependencies from the index; return `duralab`."""
    _run(_UV, "venv", "--quiet", "--no-project", "--clear", "--python", python, str(folder))
    installing = (
        "--quiet",
        "--python",
        str(folder / "bin/python"),
        "--only-binary",
        ":all:",
        "--find-links",
        str(DIST),
    )
    _run(_UV, "pip", "install", *installing, requirement)
    return folder / "bin" / "duralab"


def _check_version(program: Path, release: str) -> None:
    said = _output(str(program), "--version").strip()
    if said != f"duralab {release}":
        raise SystemExit(f"{program} --version says {said!r}; it was built as {release}.")


def _in_empty_folder(command: Sequence[str], scratch: Path, **more: str) -> subprocess.CompletedProcess[str]:
    # No module of the repository may be found through the environment or the working directory.
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV", "DURALAB"))}
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        return subprocess.run(command, cwd=folder, env=kept | more, capture_output=True, text=True, check=False)


def _answers(program: str, python: str) -> bool:
    try:
        return _output(program, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip() == python
    except (OSError, subprocess.CalledProcessError):
        return False


def _minor(program: str) -> str:
    return _output(program, "-c", "import sys; print('%d.%d' % sys.version_info[:2])").strip()


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _run(*command: str, env: dict[str, str] | None = None) -> None:
    subprocess.run(command, check=True, env=env, capture_output=True, text=True)


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main() -> int:
    """Build, try, and print a table; 1 if a trial failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build-only", action="store_true", help="build without trying")
    parser.add_argument("--pythons", nargs="+", choices=PYTHONS, default=PYTHONS, help="Pythons to try")
    arguments = parser.parse_args()
    release = version()
    build(release)
    if arguments.build_only:
        write_sums()
        return 0
    present = {minor: path for minor, path in interpreters().items() if minor in arguments.pythons}
    if not present:
        raise SystemExit(f"No Python of {', '.join(arguments.pythons)} is on this machine; install one.")
    trials = []
    with tempfile.TemporaryDirectory(prefix="duralab-trial-") as scratch:
        oldest = next(iter(present.values()))
        try_client(release, oldest, Path(scratch))
        try_tool(release, oldest, Path(scratch))
        try_pipx(release, oldest, Path(scratch))
        for minor in arguments.pythons:
            if minor not in present:
                trials.append(Trial(minor, "not on this machine", skipped=True))
            else:
                trials.append(try_lab(release, present[minor], Path(scratch), sbom=present[minor] == oldest))
    write_sums()
    _say(report(trials))
    return 1 if any(trial.reason and not trial.skipped for trial in trials) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except subprocess.CalledProcessError as fault:
        sys.exit(
            f"{' '.join(map(str, fault.cmd))} ended with {fault.returncode}: {(fault.stderr or '').strip()[-2000:]}"
        )
