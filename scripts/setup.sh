#!/usr/bin/env bash
# Make .venv from requirements.lock and install the workspace's distributions editable.
# Does nothing when neither the lock, a pyproject.toml, this script nor the Python has changed since. PYTHON chooses the Python.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if [ -z "${PYTHON:-}" ]; then
    for PYTHON in python3 python3.13 python3.12 python3.11 python3; do
        if "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then break; fi
    done
fi
if ! found=$("$PYTHON" -c 'import platform; print(platform.python_version())' 2>/dev/null); then
    echo "Duralab needs Python 3.11 or later and $PYTHON does not run; install one, or name it: make PYTHON=python3.11." >&2
    exit 1
fi
if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "Duralab needs Python 3.11 or later and $PYTHON is $found; install one, or name it: make PYTHON=python3.11." >&2
    exit 1
fi
export PYTHON

manifests=(proto/pyproject.toml libs/*/pyproject.toml services/*/pyproject.toml duralab/pyproject.toml)
distributions=("${manifests[@]%/pyproject.toml}")
stamp=.venv/.duralab-setup
wanted=$("$PYTHON" - requirements.lock scripts/setup.sh "${manifests[@]}" <<'PY'
import hashlib, pathlib, sys
digest = hashlib.sha256(sys.version.encode() + sys.base_prefix.encode())
for name in sys.argv[1:]:
    digest.update(name.encode() + pathlib.Path(name).read_bytes())
print(digest.hexdigest())
PY
)
if [ "$(cat "$stamp" 2>/dev/null)" = "$wanted" ] && [ -x .venv/bin/python ]; then
    exit 0
fi

echo "Setting up .venv with Python $found from requirements.lock (once, until it changes) ..."
started=$SECONDS
rm -f "$stamp"
# An environment of the same Python is brought up to date; any other is made anew.
if [ "$(.venv/bin/python -c 'import platform; print(platform.python_version())' 2>/dev/null)" != "$found" ]; then
    scripts/uv.sh venv --quiet --clear --no-project --no-python-downloads --python "$PYTHON" .venv
fi
install=(--quiet --python .venv/bin/python)
# Compiled now: where Python must not write beside what it reads (PYTHONDONTWRITEBYTECODE, as in many containers), every
# service would compile all that it imports at each start, half of the time or more that its imports take.
scripts/uv.sh pip sync "${install[@]}" --compile-bytecode --require-hashes requirements.lock
scripts/uv.sh pip install "${install[@]}" --no-deps --no-build-isolation "${distributions[@]/#/--editable=./}"
.venv/bin/python -m compileall -q -j 0 "${distributions[@]}" tests benchmarks studies
echo "$wanted" >"$stamp"
echo "Set up in $((SECONDS - started)) s."
