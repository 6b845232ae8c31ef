#!/usr/bin/env bash
# Runs every test program; the last line is the sum.
#
#     scripts/test.sh [release]  as the program is built to be used
#     scripts/test.sh debug      with every check that the compiler can build in
#     scripts/test.sh long       release, and with it what takes too long for every day
#     scripts/test.sh sanitized  the tests of bad input, with a program that checks every access to
#                                memory, undefined behaviour and leaks
#     scripts/test.sh coverage   with counters of the lines executed (scripts/coverage.sh)
#     scripts/test.sh perturbed [SEED [debug]]    release or debug, with the last bits of results of
#                                the mathematics library and of BLAS changed (scripts/perturb.c)
set -euo pipefail

# fpm puts these flags in front of the profile's own. Not trapped: invalid and overflow, which
# comparing a NaN and reading 1e999 raise, and tests do both. -Og lengthens the build by a quarter and
# shortens the tests by a third.
checks='-Og -fcheck=all -finit-real=snan -ffpe-trap=zero'
# Checks of null pointers and alignment would double the time of the build, and the address sanitizer
# stops at a null pointer as well.
sanitizers='-g1 -fsanitize=address,undefined -fno-sanitize=null,alignment -fno-sanitize-recover=all'
profile=${1:-release} flags=() seed= most=1 sanitized=
case $profile in
debug | release) ;;
long)
   profile=release
   export BEAMID_LONG_TESTS=yes
   ;;
sanitized)
   # A status that the program never has marks a finding.
   profile=release sanitized=yes
   export ASAN_OPTIONS=exitcode=99 UBSAN_OPTIONS=exitcode=99:print_stacktrace=1
   ;;
coverage)
   # Threads share the counters.
   profile=debug flags=(--flag '-Og --coverage -fprofile-update=atomic')
   ;;
perturbed)
   seed=${2:-1} profile=${3:-release} most=3
   ;;
esac
if [[ ! $profile =~ ^(debug|release)$ || ! $seed =~ ^[0-9]*$ || $# -gt $most ]]; then
   echo "usage: test.sh [release|debug|long|sanitized|coverage|perturbed [SEED [debug|release]]]," \
      "not '$*'" >&2
   exit 2
fi
[[ $profile == release || ${#flags[@]} != 0 ]] || flags=(--flag "$checks")

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
"$checkout/scripts/setup.sh"
# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
find_fpm
cd "$checkout"

passed=0 failed=0 skipped=0
logs=$(mktemp -d)
library=$(mktemp --suffix=.so)
trap 'rm -rf "$logs" "$library"' EXIT
export preload='' logs
if [[ -n $seed ]]; then
   cc -O2 -shared -fPIC scripts/perturb.c -o "$library" -ldl -lm
   preload="env PERTURB_SEED=$seed LD_PRELOAD=$library${LD_PRELOAD:+:$LD_PRELOAD}"
fi
# As many programs run at a time as there are processors. Threads that wait leave theirs to others.
export OMP_WAIT_POLICY=passive

# Runs one test program, and prints its output in one piece when it has ended.
run_suite() {
   local status=0 log=$logs/${1##*/}
   # shellcheck disable=SC2086
   $preload "$1" </dev/null >"$log" 2>&1 || status=$?
   echo "$status" >"$log.status"
   flock "$logs" cat "$log"
}
export -f run_suite

# Adds the counts in the closing line of one program. No such line, or a bad exit status after a clean
# one, is a failure.
add_counts() {
   local log=$logs/${1##*/} status closing counts
   status=$(cat "$log.status" || echo none)
   closing=$(grep -Eax '.+: [0-9]+ passed, [0-9]+ failed, [0-9]+ skipped' "$log") || true
   closing=${closing##*$'\n'}
   read -ra counts <<<"$(tr -cd '0-9 ' <<<"${closing##*: }")"
   passed=$((passed + ${counts[0]:-0}))
   failed=$((failed + ${counts[1]:-0}))
   skipped=$((skipped + ${counts[2]:-0}))
   if [[ -z $closing || ($status != 0 && ${counts[1]} == 0) ]]; then
      failed=$((failed + 1))
      echo "FAIL  ${1##*/}: exit status $status, closing line: ${closing:-none}"
   fi
}

program=("$profile" "${flags[@]}") chosen=''
if [[ -n $sanitized ]]; then
   program=(debug --flag "$sanitizers") chosen='/test_(bad_.*|mutations|csv|namelist|records)$'
fi
if build "$profile" "${flags[@]}" --tests && { [[ -z $sanitized ]] || build "${program[@]}"; }; then
   BEAMID_PROGRAM=$checkout/$(paths "${program[0]}" run beamid "${program[@]:1}" | tail -n 1)
   export BEAMID_PROGRAM
   mapfile -t tests < <(paths "$profile" test "${flags[@]}" | grep -E "$chosen")
   printf '%s\n' "${tests[@]}" | xargs -P "$(nproc)" -I{} bash -c 'run_suite "$1"' bash {}
   for test in "${tests[@]}"; do
      add_counts "$test"
   done
   [[ $((passed + failed)) -gt 0 ]] || { failed=1 && echo "FAIL  no check ran"; }
else
   failed=1
   echo "FAIL  the build in profile $profile"
fi

[[ $skipped == 0 ]] && rest= || rest=", $skipped skipped"
echo "$passed passed, $failed failed$rest"
[[ $failed == 0 ]]
