#!/usr/bin/env bash
# Finds what beamid is built with and installs what is missing: by apt where there is apt.
#
#     scripts/setup.sh [pictures]     `pictures`: numpy and matplotlib too, for the plotting scripts
#
# Needed: gfortran, SUNDIALS 6.4 to 7 with its Fortran modules, MINPACK, LAPACK, BLAS, fpm 0.12.
# SUNDIALS_ROOT names a prefix in which libraries are looked for first; FPM_FC the compiler.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
packages=(gfortran libsundials-fortran-dev libsundials-dev liblapack-dev libblas-dev minpack-dev)
fpm_version=0.12.0
plotting=('numpy>=1.24' 'matplotlib>=3.6')
compiler=${FPM_FC:-gfortran}
venv=$checkout/.venv
binding=$checkout/external/sundials

say() { echo "setup: $*" >&2; }
give_up() { say "$*" && exit 1; }
have() { command -v "$1" >/dev/null; }

# Root rights: at hand, or by sudo (which may ask for a password only at a terminal).
may_be_root() {
   [[ $(id -u) == 0 ]] || { have sudo && { [[ -t 0 ]] || sudo -n true 2>/dev/null; }; }
}
as_root() {
   if [[ $(id -u) == 0 ]]; then "$@"; else sudo "$@"; fi
}

apt_install() {
   local apt=(env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300) log
   have apt-get && may_be_root || return 1
   say "installing by apt, some minutes: $*"
   log=$({ as_root "${apt[@]}" update || true
      as_root "${apt[@]}" install -y --no-install-recommends "$@"; } 2>&1) && return
   echo "$log" >&2
   return 1
}

# The folder with SUNDIALS' Fortran modules, and the options that find its libraries.
find_sundials() {
   local root=${SUNDIALS_ROOT:-} file
   modules=/usr/include/sundials/fortran search=
   if [[ -n $root ]]; then
      file=$(find -L "$root" -maxdepth 5 -name fcvode_mod.mod 2>/dev/null | head -n 1)
      modules=$(realpath -m "${file%/*}")
      file=$(find -L "$root" -maxdepth 4 -name 'libsundials_fcvode_mod.*' 2>/dev/null | head -n 1)
      [[ -n $file ]] && search="-L$(realpath "${file%/*}") -Wl,-rpath,$(realpath "${file%/*}")"
   fi
   version=6
   [[ ! -f $modules/fsundials_core_mod.mod ]] || version=7
}

# Links a program against all that the build uses; what does not work is the reason.
libraries_work() {
   local libraries probe
   have "$compiler" || { reason="no compiler $compiler" && return 1; }
   find_sundials
   [[ -f $modules/fcvode_mod.mod ]] || {
      reason="no Fortran modules of SUNDIALS (fcvode_mod.mod) in ${SUNDIALS_ROOT:-$modules}"
      return 1
   }
   libraries=$(cat "$checkout"/fpm.toml "$checkout/external/sundials-$version/fpm.toml" |
      tr '\n' ' ' | grep -o 'link = [^]]*]' | grep -o '"[^"]*"' | tr -d '"' | sed 's/^/-l/')
   probe=$(mktemp -d)
   printf '%s\n' 'use fcvode_mod, only: FCVode' 'external lmdif, lmder, dsbgvd, dgemm' \
      'call lmdif; call lmder; call dsbgvd; call dgemm' 'end' >"$probe/probe.f90"
   # shellcheck disable=SC2086
   reason=$("$compiler" "-I$modules" -J "$probe" -o "$probe/probe" "$probe/probe.f90" $search \
      $libraries 2>&1) && { rm -r "$probe" && return; }
   rm -r "$probe"
   reason=$(grep -iE 'error|cannot find|undefined' <<<"$reason" | head -n 3)
   return 1
}

# The package `external/sundials`: the binding for the version that was found, and where it lies.
write_binding() {
   local manifest new
   manifest=$(<"$checkout/external/sundials-$version/fpm.toml")
   new=${manifest/sundials_fcvode_mod\"/sundials_fcvode_mod${search:+ $search}\"}
   if [[ ! -d $binding || -L $binding ]]; then
      rm -rf "$binding" && mkdir "$binding"
   fi
   [[ -f $binding/fpm.toml && $(<"$binding/fpm.toml") == "$new" ]] ||
      echo "$new" >"$binding/fpm.toml"
   [[ $(readlink "$binding/src") == "../sundials-$version/src" ]] ||
      ln -sfn "../sundials-$version/src" "$binding/src"
   [[ $(readlink "$binding/modules") == "$modules" ]] || ln -sfn "$modules" "$binding/modules"
}

makes_venvs() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# Puts Python packages into .venv, which is made when missing.
pip_install() {
   local python=python3
   if [[ ! -x $venv/bin/pip ]]; then
      makes_venvs "$python" || python=/usr/bin/python3
      makes_venvs "$python" || apt_install python3-venv || {
         say 'missing: Python 3 with venv, for' "$@"
         return 1
      }
      "$python" -m venv --clear "$venv" >&2 || return 1
   fi
   say "installing into .venv: $*"
   "$venv/bin/python" -m pip -q --disable-pip-version-check install "$@" >&2
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

case ${1:-} in
'') ;;
pictures) "$venv/bin/python" -c 'import numpy, matplotlib' 2>/dev/null ||
   pip_install "${plotting[@]}" || give_up "pictures need Python 3 with ${plotting[*]}" ;;
*) say "found '$1', expected nothing or 'pictures'" && exit 2 ;;
esac

if ! libraries_work; then
   first=$reason
   { [[ -z ${SUNDIALS_ROOT:-} ]] && apt_install "${packages[@]}" && libraries_work; } || {
      say "found: $first"
      say 'expected: gfortran, SUNDIALS 6.4 to 7 with Fortran modules, MINPACK, LAPACK and BLAS;' \
         'SUNDIALS_ROOT names another prefix than /usr, FPM_FC the compiler'
      give_up "on Debian or Ubuntu: sudo apt-get update && sudo apt-get install ${packages[*]}"
   }
fi
write_binding

# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
if ! find_fpm; then
   pip_install "fpm==$fpm_version" && find_fpm ||
      give_up "missing: fpm $fpm_version or newer, on PATH or by pip"
fi
if [[ $fpm == "$venv"/* ]]; then
   prefix=/usr/local
   if [[ -e $prefix/bin/fpm ]] || ! may_be_root || ! install_fpm "$prefix" as_root; then
      prefix=~/.local
      [[ -e $prefix/bin/fpm ]] || install_fpm "$prefix"
   fi
   is_fpm fpm || say "to call fpm yourself: export PATH=\"$prefix/bin:\$PATH\""
fi
