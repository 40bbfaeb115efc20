#!/usr/bin/env bash
# Install all distributions with the lowest versions of their direct dependencies, and run the tests that are given: `make lowest`.
# The tools of the tests have the versions of the lock.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

environment=.tools/lowest
python=${PYTHON:-.venv/bin/python}
distributions=(proto libs/*/ services/*/)
tools=()
for tool in hypothesis pytest pytest-timeout pytest-xdist rainflow rpc3-file; do
    tools+=("$(awk -v tool="$tool" '$1 ~ "^" tool "==" { print $1 }' requirements.lock)")
done
scripts/uv.sh venv --quiet --no-project --clear --python "$python" "$environment"
install=(scripts/uv.sh pip install --quiet --python "$environment/bin/python")
editables=()
for folder in "${distributions[@]}"; do
    if [ -f "$folder/pyproject.toml" ]; then
        editables+=("--editable=./${folder%/}")
    fi
done
"${install[@]}" --resolution lowest-direct "${editables[@]}" "--editable=./duralab[fmu,formats,lab,sweeps]" "${tools[@]}"
"$environment/bin/python" scripts/bounds.py
OMP_NUM_THREADS=1 "$environment/bin/python" -m pytest -q --numprocesses=2 --dist=loadfile -p no:cacheprovider -m "not long" "$@"
