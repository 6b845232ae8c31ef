#!/usr/bin/env bash
# Builds the documentation as a site by mkdocs: out/site/index.html. The program generates the page of
# groups, keys and parameters; it is built first if it is missing or out of date. The exit status is 1
# if a link, an anchor or a page of the navigation is missing.
#
# pip installs mkdocs, its theme, and mkdocstrings for the page of the Python package into .venv; ruff
# breaks the lines of signatures. Their versions are fixed, because a new version may warn about
# something else. NO_MKDOCS_2_WARNING hides the theme's notice about its successor.
set -euo pipefail

packages=(mkdocs==1.6.1 mkdocs-material==9.8.2 mkdocstrings==1.0.8 mkdocstrings-python==2.0.11
   ruff==0.17.6)
page=docs/reference/case-file.md

cd "$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")"
installed=$(.venv/bin/python -m pip --disable-pip-version-check freeze 2>/dev/null) || installed=
missing=()
for package in "${packages[@]}"; do
   grep -Fqx "$package" <<<"$installed" || missing+=("$package")
done
[[ ${#missing[@]} == 0 ]] || scripts/setup.sh packages "${missing[@]}"

reference=$(scripts/run.sh help --markdown)
printf '%s\n' "$reference" >"$page"

# mkdocs tells warnings among much else. (With --quiet it neither tells nor counts them.)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict --config-file mkdocs.yml >"$log" 2>&1 || {
   cat "$log" >&2
   exit 1
}
echo out/site/index.html
