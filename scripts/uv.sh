#!/usr/bin/env bash
# Run uv: the one on PATH, else one that pip installs into .tools/uv, with the version and the hashes of the lock.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

if command -v uv >/dev/null && uv --version >/dev/null 2>&1; then
    exec uv "$@"
fi

own=.tools/uv
if ! cmp -s requirements.lock "$own/requirements.lock"; then
    rm -rf "$own"
    mkdir -p "$own"
    awk '/^[^ ]/ { wanted = /^uv==/ } wanted' requirements.lock >"$own/uv.lock"
    if ! "${PYTHON:-python3}" -m pip --version >/dev/null 2>&1; then
        echo "Neither uv nor pip for ${PYTHON:-python3} is here; install one of them (Debian: apt install python3-pip)." >&2
        exit 1
    fi
    "${PYTHON:-python3}" -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --require-hashes --no-deps \
        --target "$own" --requirement "$own/uv.lock"
    cp requirements.lock "$own/requirements.lock"
fi
exec "$own/bin/uv" "$@"
