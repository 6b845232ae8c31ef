#!/usr/bin/env bash
# Installs the program, its library with a file for pkg-config, the scripts that draw, the manual page
# and what shells complete.
#
#     scripts/install.sh PREFIX      PREFIX/bin/beamid and so on; /usr/local, ~/.local, ...
set -euo pipefail

if [[ $# != 1 || $1 == -* ]]; then
   echo "install.sh: found ${*:-nothing}, expected one folder, as in install.sh ~/.local" >&2
   exit 2
fi
checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
mkdir -p "$1"
prefix=$(realpath "$1")
"$checkout/scripts/setup.sh"
# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
find_fpm
build release
log=$(mktemp)
trap 'rm -f "$log"' EXIT
options_of release
(cd "$checkout" && "$fpm" install "${profile_options[@]}" --prefix "$prefix" --no-rebuild </dev/null \
   >"$log" 2>&1) || { cat "$log" >&2 && exit 1; }

share=$prefix/share
program=$prefix/bin/beamid
mkdir -p "$prefix/lib/pkgconfig" "$share/man/man1" "$share/bash-completion/completions" \
   "$share/zsh/site-functions"
version=$("$program" version)
flags=$("$checkout/scripts/setup.sh" flags)
# The library that scripts/setup.sh makes where SUNDIALS is built with MPI.
if [[ $flags == *-lsundials_no_mpi* ]]; then
   cp "$checkout/external/sundials/libsundials_no_mpi.a" "$prefix/lib/"
   flags=${flags/-L$checkout\/external\/sundials /}
fi
cat >"$prefix/lib/pkgconfig/beamid.pc" <<END
prefix=$prefix
Name: beamid
Description: physical parameters of a flexible beam from an accelerometer record
Version: ${version#beamid }
Cflags: -I\${prefix}/include
Libs: -L\${prefix}/lib -lbeamid $flags
END
"$program" help man >"$share/man/man1/beamid.1"
"$program" help bash >"$share/bash-completion/completions/beamid"
"$program" help zsh >"$share/zsh/site-functions/_beamid"
"$checkout/scripts/copy_scripts.sh" "$share/beamid/scripts"
echo "$program"
