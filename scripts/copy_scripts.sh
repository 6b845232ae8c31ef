#!/usr/bin/env bash
# Copies the Python scripts that work without a checkout, and the files beside them that they read.
#
#     scripts/copy_scripts.sh FOLDER
set -euo pipefail

if [[ $# != 1 || $1 == -* ]]; then
   echo "copy_scripts.sh: found ${*:-nothing}, expected one folder" >&2
   exit 2
fi
mkdir -p "$1"
for file in "$(dirname "$(realpath "${BASH_SOURCE[0]}")")"/*; do
   case ${file##*/} in
   *.sh | *.c | benchmark.py | peers.py | reconstruct_record.py) ;;
   *) [[ ! -f $file ]] || cp "$file" "$1/" ;;
   esac
done
