#!/usr/bin/env bash
# Sets up, builds the release and becomes the program: its arguments, output and exit status.
# Without arguments: reproduce table-4.1.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
"$checkout/scripts/setup.sh"

fpm=("$checkout"/.venv/lib/python*/site-packages/fpm/fpm)
fpm() { (cd "$checkout" && "${fpm[0]}" "$@" --profile release </dev/null 2>&1); }

if ! log=$(fpm build); then
   echo "$log" >&2
   exit 1
fi
# fpm itself says where the program of this profile is: the runner `echo` prints its path.
program=$checkout/$(fpm run beamid --runner echo | grep '^build/' | tail -n 1)

[[ $# -gt 0 ]] || set -- reproduce table-4.1
exec "$program" "$@"
