#!/usr/bin/env bash
# Measures which lines of src/ the tests execute: builds program and tests with counters, runs every
# test and prints a row for each file, the least covered first. The last line is the total. The exit
# status is that of the tests.
#
# A file without executable statements has no row. A process that ends by a signal does not write its
# counters.
#
#     scripts/coverage.sh          takes no argument
set -euo pipefail

[[ $# == 0 ]] || { echo "coverage: found $1, expected no argument" >&2; exit 2; }
cd "$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")"
scripts/setup.sh packages gcovr==8.8
compiler=${FPM_FC:-gfortran}
table=$(mktemp)
trap 'rm -f "$table"' EXIT

mkdir -p build
find build -name '*.gcda' -delete
status=0
scripts/test.sh coverage || status=$?

# The counters lie beside the objects of this build; other folders may hold notes of older sources.
mapfile -t folders < <(find build -name '*.gcda' -printf '%h\n' | sort -u)
if [[ ${#folders[@]} == 0 ]]; then
   echo 'coverage: no program has written counters' >&2
   exit 1
fi
# The kernels of some tests run more than 2**32 times, which gcovr takes for an error of gcov.
.venv/bin/gcovr --root . --filter src/ --merge-mode-functions separate --csv "$table" \
   --gcov-suspicious-hits-threshold 0 \
   --gcov-executable "${compiler%gfortran*}gcov${compiler##*gfortran}" "${folders[@]}"

# The columns used are file, lines, lines covered and their share.
tail -n +2 "$table" | LC_ALL=C sort -t , -k 4,4g -k 1,1 | LC_ALL=C awk -F , '
   { printf "%6.1f %%  %4d of %4d lines  %s\n", 100*$3/($2 > 0 ? $2 : 1), $3, $2, $1
     lines += $2; covered += $3 }
   END { printf "coverage: %.1f %% of %d lines in %d files\n", 100*covered/(lines > 0 ? lines : 1), \
      lines, NR }'
exit $status
