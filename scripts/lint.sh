#!/usr/bin/env bash
# Runs the linters: Fortitude on the Fortran sources, ruff and mypy on the Python files. Prints the
# number of findings on the last line; the exit status is 1 if there are any.
#
# The rules are in fpm.toml, ruff.toml and mypy.ini. pip installs the linters into .venv. Their
# versions are fixed, because a new version may bring new rules.
set -euo pipefail

linters=(fortitude-lint==0.10.0 mypy==2.4.1 ruff==0.17.6)

cd "$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")"
installed=$(.venv/bin/python -m pip --disable-pip-version-check freeze 2>/dev/null) || installed=
missing=()
for linter in "${linters[@]}"; do
   grep -Fqx "$linter" <<<"$installed" || missing+=("$linter")
done
# The types of the package are those of numpy.
grep -q '^numpy==' <<<"$installed" || missing+=('numpy>=1.24')
[[ ${#missing[@]} == 0 ]] || scripts/setup.sh packages "${missing[@]}"

findings=0
log=$(mktemp)
trap 'rm -f "$log"' EXIT

# lint PATTERN COMMAND...: runs a linter and counts the lines of its output that match the pattern. A
# linter that fails without such a line counts as one finding.
lint() {
   local pattern=$1 status=0 found
   shift
   "$@" 2>&1 | tee "$log" || status=$?
   found=$(grep -cE "$pattern" "$log") || true
   [[ $found != 0 || $status == 0 ]] || found=1
   findings=$((findings + found))
}

lint ': (error|fatal|warning)\[' .venv/bin/fortitude check --quiet --output-format concise \
   src app test example python/library external/sundials-6 external/sundials-7
lint ':[0-9]+:[0-9]+: ' .venv/bin/ruff check --output-format concise python scripts
lint ':[0-9]+: error: ' .venv/bin/mypy
# A source file that grows beyond 400 lines holds more than one idea.
mapfile -t sources < <(find src app -name '*.f90')
lint ': more than' awk 'FNR == 401 { print FILENAME ": more than 400 lines" }' "${sources[@]}"

echo "lint: $findings findings"
[[ $findings == 0 ]]
