#!/usr/bin/env bash
# Builds the library with its interface for C as shared libraries, and the program that uses the same
# library. Copies both.
#
#     scripts/library.sh FOLDER      FOLDER/libbeamid_c.so, the libraries that it needs, and the
#                                    program FOLDER/beamid
set -euo pipefail

if [[ $# != 1 || $1 == -* ]]; then
   echo "library.sh: found ${*:-nothing}, expected one folder" >&2
   exit 2
fi
checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
mkdir -p "$1"
folder=$(realpath "$1")
"$checkout/scripts/setup.sh"
# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
find_fpm
checkout=$checkout/python/library
sources=(src ../../src ../../app)
build release
newest=$(ls -t "$checkout"/build/gfortran_*/libbeamid_c.so | head -n 1)
cp "${newest%/*}"/lib*.so "$folder/"
# fpm names a program that it finds by itself after the package.
program=$(ls -t "$checkout"/build/gfortran_*/app/beamid_c | head -n 1)
cp "$program" "$folder/beamid"
