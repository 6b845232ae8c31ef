#!/usr/bin/env bash
# Sets up, builds the release and becomes the program: its arguments, output and exit status.
# Without arguments: reproduce table-4.1.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
"$checkout/scripts/setup.sh"
# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
find_fpm
build release

[[ $# -gt 0 ]] || set -- reproduce table-4.1
exec "$checkout/$(paths release run beamid | tail -n 1)" "$@"
