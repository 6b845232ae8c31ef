#!/usr/bin/env bash
# Asks flang, LLVM's Fortran compiler, for a second opinion on the sources: its front end must
# accept every file of the program, of the library and of the interface for C. The check covers
# syntax and semantics; it builds nothing. It prints the messages of flang, and on the last line the
# numbers of files. The exit status is 1 if a file is rejected.
#
# A file is left out if it uses a module that no accepted file defines. The check is skipped if no
# flang is on PATH. On Debian and Ubuntu the package is flang-19.
set -euo pipefail

cd "$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")"
flang=
for name in flang-new-19 flang-19 flang; do
   [[ -n $flang ]] || flang=$(command -v "$name") || true
done
if [[ -z $flang ]]; then
   echo 'flang: skipped, no flang on PATH'
   exit
fi

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

# flang cannot read the installed modules of SUNDIALS, which gfortran has made.
sources=(external/sundials-6/interfaces/*.f90 external/sundials-6/src/sundials.f90)
mapfile -t -O ${#sources[@]} sources < <(find src app python/library/src -name '*.f90')

# Lines `file m module` for each module that a file defines, `file u module` for each that it uses.
# Intrinsic modules and that of OpenMP come with the compiler.
awk '{ line = tolower($0); sub(/!.*/, "", line) }
   line ~ /^ *module +[a-z0-9_]+ *$/ { split(line, word, " "); print FILENAME, "m", word[2] }
   line ~ /^ *use +[a-z]/ { sub(/^ *use +/, "", line); sub(/[ ,].*/, "", line)
      if (line != "omp_lib") print FILENAME, "u", line }' "${sources[@]}" >"$folder/modules"

# tsort takes pairs of files: the first defines a module that the second uses. A pair of equal names
# stands for a file that may use no other.
mapfile -t sorted < <(
   { printf '%s\n' "${sources[@]}" | sed 's/.*/& &/'
      awk 'NR == FNR { if ($2 == "m") home[$3] = $1; next }
         $2 == "u" && $3 in home && home[$3] != $1 { print home[$3], $1 }' \
         "$folder/modules" "$folder/modules"; } | tsort)

declare -A uses defines known
while read -r file kind module; do
   if [[ $kind == u ]]; then uses[$file]+=" $module"; else defines[$file]+=" $module"; fi
done <"$folder/modules"

accepted=0 rejected=() left_out=()
for file in "${sorted[@]}"; do
   absent=
   for module in ${uses[$file]:-}; do
      [[ -n ${known[$module]:-} || " ${defines[$file]:-} " == *" $module "* ]] || absent=$module
   done
   if [[ -n $absent ]]; then
      left_out+=("$file (uses $absent)")
   elif "$flang" -fsyntax-only -fopenmp -module-dir "$folder" "$file"; then
      accepted=$((accepted + 1))
      for module in ${defines[$file]:-}; do known[$module]=yes; done
   else
      rejected+=("$file")
   fi
done

[[ ${#rejected[@]} == 0 ]] || printf 'flang: rejected %s\n' "${rejected[@]}"
[[ ${#left_out[@]} == 0 ]] || printf 'flang: left out %s\n' "${left_out[@]}"
echo "flang: $accepted files accepted, ${#rejected[@]} rejected, ${#left_out[@]} left out"
[[ ${#rejected[@]} == 0 ]]
