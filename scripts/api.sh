#!/usr/bin/env bash
# Pages on the library's procedures, made by FORD from the sources: out/api/index.html.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
cd "$checkout"
[[ -x .venv/bin/ford ]] || scripts/setup.sh packages 'ford>=7'
log=$(mktemp)
trap 'rm -f "$log"' EXIT
.venv/bin/ford README.md >"$log" 2>&1 || { cat "$log" >&2 && exit 1; }
echo out/api/index.html
