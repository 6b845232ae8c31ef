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
   "$share/zsh/site-functions" "$share/beamid/scripts"
version=$("$program" version)
cat >"$prefix/lib/pkgconfig/beamid.pc" <<END
prefix=$prefix
Name: beamid
Description: physical parameters of a flexible beam from an accelerometer record
Version: ${version#beamid }
Cflags: -I\${prefix}/include
Libs: -L\${prefix}/lib -lbeamid $("$checkout/scripts/setup.sh" flags)
END
"$program" help man >"$share/man/man1/beamid.1"
"$program" help bash >"$share/bash-completion/completions/beamid"
"$program" help zsh >"$share/zsh/site-functions/_beamid"
for script in cases channels clocks ensemble_mpi fit_page labview page plot_along plot_convergence plot_design plot_fit \
   plot_intervals plot_modes plot_paper plot_record plot_studies plotting program report roller_beam signals text_tables \
   to_csv; do
   cp "$checkout/scripts/$script.py" "$share/beamid/scripts/"
done
echo "$program"
