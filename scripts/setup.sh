#!/usr/bin/env bash
# Installs what is missing, and only that: Debian packages, the environment .venv and fpm.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
fpm_version=0.12.0
packages=(gfortran libsundials-fortran-dev liblapack-dev libblas-dev minpack-dev)
requirements=("fpm==$fpm_version" 'numpy>=1.24' 'matplotlib>=3.6')

say() { echo "setup: $*" >&2; }
have() { command -v "$1" >/dev/null; }
works() { "$1" --version &>/dev/null; }

# Root rights: at hand, or by sudo (which may ask for a password only at a terminal).
may_be_root() {
   [[ $(id -u) == 0 ]] || { have sudo && { [[ -t 0 ]] || sudo -n true 2>/dev/null; }; }
}
as_root() {
   if [[ $(id -u) == 0 ]]; then "$@"; else sudo "$@"; fi
}

# The environment counts as complete once the stamp is there, which is written last.
venv=$checkout/.venv
stamp=$venv/complete
venv_ready() {
   [[ -f $stamp && $(<"$stamp") == "${requirements[*]}" ]] &&
      "$venv/bin/python" -c 'import fpm, numpy, matplotlib' 2>/dev/null
}
makes_venvs() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

install_packages() {
   local apt=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300)
   local install=(install -y --no-install-recommends "$@") log
   if have apt-get && may_be_root; then
      say "installing $*"
      log=$({ as_root "${apt[@]}" update || true; as_root "${apt[@]}" "${install[@]}"; } 2>&1) &&
         return
      echo "$log" >&2
   fi
   say "missing: $*; install with: sudo apt-get update && sudo apt-get ${install[*]}"
   exit 1
}

make_venv() {
   say "making the Python environment .venv (${requirements[*]})"
   "$1" -m venv --clear "$venv" >&2 &&
      "$venv/bin/python" -m pip -q --disable-pip-version-check install "${requirements[@]}" >&2 &&
      echo "${requirements[*]}" >"$stamp" && return
   say "could not make $venv with $1"
   exit 1
}

# Copies the executable from the wheel; it finds its libraries at ../fpm.libs, so they come along.
install_fpm() {
   local prefix=$1 lib=$1/lib/fpm-$fpm_version site
   shift
   site=("$venv"/lib/python*/site-packages)
   "$@" install -D -m 755 -t "$lib/fpm" "${site[0]}/fpm/fpm" &&
      "$@" install -D -m 755 -t "$lib/fpm.libs" "${site[0]}"/fpm.libs/* &&
      "$@" mkdir -p "$prefix/bin" &&
      "$@" ln -sfn "../lib/fpm-$fpm_version/fpm/fpm" "$prefix/bin/fpm" &&
      say "installed fpm $fpm_version as $prefix/bin/fpm"
}

missing=()
installed=$(dpkg-query -W -f '${Package} ${db:Status-Status}\n' "${packages[@]}" 2>/dev/null) || true
for package in "${packages[@]}"; do
   grep -qx "$package installed" <<<"$installed" || missing+=("$package")
done

python=python3
if ! venv_ready; then
   venv_missing=yes
   makes_venvs "$python" || python=/usr/bin/python3
   makes_venvs "$python" || missing+=(python3-venv)
fi

[[ ${#missing[@]} == 0 ]] || install_packages "${missing[@]}"
[[ -z ${venv_missing:-} ]] || make_venv "$python"

home=~/.local
if ! works fpm && ! works /usr/local/bin/fpm && ! works "$home/bin/fpm"; then
   prefix=/usr/local
   if ! may_be_root || ! install_fpm "$prefix" as_root; then
      prefix=$home
      install_fpm "$prefix"
   fi
   works fpm || say "to call fpm yourself: export PATH=\"\$PATH:$prefix/bin\""
fi
