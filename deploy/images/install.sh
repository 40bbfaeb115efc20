#!/bin/sh
# Install into $PREFIX (/opt/duralab) what an image holds: `install.sh FOLDER[EXTRA] …` for distributions of this
# repository, with all that they need; `install.sh PACKAGE` for one of requirements.lock alone. Every package that comes
# from outside has the version and a hash of the lock. `install.sh --tools` puts uv and what builds wheels in $TOOLS first.
set -eu
cd "$(dirname "$0")/../.."
prefix=${PREFIX:-/opt/duralab}
tools=${TOOLS:-/opt/tools}

if [ "$1" = --tools ]; then
    python3 -m venv "$tools"
    # uv by its hash, by pip; the rest by uv.
    awk '/^[^ ]/ { wanted = /^uv==/ } wanted' requirements.lock >"$tools/uv.lock"
    "$tools/bin/pip" install --quiet --disable-pip-version-check --no-deps --require-hashes --requirement "$tools/uv.lock"
    "$tools/bin/uv" pip install --quiet --python "$tools/bin/python" --verify-hashes --constraint requirements.lock \
        editables hatchling
    exit 0
fi

"$tools/bin/uv" venv --quiet --no-project --python "$(command -v python3)" "$prefix"
install() {
    "$tools/bin/uv" pip install --quiet --python "$prefix/bin/python" --only-binary :all: --compile-bytecode \
        --verify-hashes --constraint requirements.lock "$@"
}
if [ ! -f "${1%%\[*}/pyproject.toml" ]; then
    install "$1"
    exit 0
fi
wheels=$(mktemp -d)
folders=$(python3 deploy/images/closure.py "$@")
for folder in $folders; do
    "$tools/bin/uv" build --quiet --wheel --no-build-isolation --python "$tools/bin/python" --out-dir "$wheels" "$folder"
done
# By their paths: a package of the same name elsewhere is never looked for.
ls "$wheels"/*.whl >"$wheels/requirements.txt"
for asked in "$@"; do
    case $asked in
    *\[*) echo "duralab[${asked#*\[} @ file://$(ls "$wheels"/duralab-[0-9]*.whl)" >>"$wheels/requirements.txt" ;;
    esac
done
install --requirement "$wheels/requirements.txt"
rm -rf "$wheels"
