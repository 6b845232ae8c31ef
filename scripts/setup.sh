#!/usr/bin/env bash
# Finds what beamid is built with and installs what is missing: by apt where there is apt.
#
#     scripts/setup.sh             what the program and the tests need
#     scripts/setup.sh pictures    that, and numpy, matplotlib and Plotly for pictures and reports
#     scripts/setup.sh browser     that, and Chromium with Playwright for scripts/tests
#     scripts/setup.sh studio      that, and the Python package with the page `beamid studio`
#     scripts/setup.sh mpi         that, and Open MPI with mpi4py for scripts/ensemble_mpi.py
#     scripts/setup.sh files       lists the files of the system that a build uses
#     scripts/setup.sh flags       what a linker needs beside the library
#     scripts/setup.sh packages NAME...    what the program needs, and these Python packages in .venv
#
# Needed are gfortran, SUNDIALS 6.4 to 7 with its Fortran modules, MINPACK, LAPACK, BLAS and fpm 0.12.
# SUNDIALS_ROOT names a prefix whose libraries come first, and is remembered until it names /usr;
# FPM_FC another compiler.
set -euo pipefail

checkout=$(dirname "$(dirname "$(realpath "${BASH_SOURCE[0]}")")")
packages=(gfortran libsundials-fortran-dev libsundials-dev liblapack-dev libblas-dev minpack-dev)
fpm_version=0.12.0
plotting=('numpy>=1.24' 'matplotlib>=3.6' 'plotly>=6')
browsing=('pytest' 'playwright>=1.40')
compiler=${FPM_FC:-gfortran}
binding=$checkout/external/sundials
venv=$checkout/.venv
root=${SUNDIALS_ROOT:-$(cat "$binding/root" 2>/dev/null || echo /usr)}
root=$(realpath -m "$root")

say() { echo "setup: $*" >&2; }
fail() { say "$*" && exit 1; }
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
   say "installing by apt, a minute or more: $*"
   log=$({ as_root "${apt[@]}" update || true
      as_root "${apt[@]}" install -y --no-install-recommends "$@"; } 2>&1) && return
   echo "$log" >&2
   return 1
}

# first PATTERN: the folder below the prefix of the first file of this name.
first() {
   local file
   file=$(find -L "$root" -maxdepth 5 -name "$1" 2>/dev/null | head -n 1)
   [[ -z $file ]] || dirname "$(realpath "$file")"
}

# Sets `modules`, the folder of SUNDIALS' Fortran modules, `version`, and `search`, options for the
# linker.
find_sundials() {
   local libraries
   modules=/usr/include/sundials/fortran search=
   if [[ $root != /usr ]]; then
      modules=$(first fcvode_mod.mod)
      libraries=$(first 'libsundials_fcvode_mod.*')
      search="-L$libraries -Wl,-rpath,$libraries"
   fi
   version=6
   [[ ! -f $modules/fsundials_core_mod.mod ]] || version=7
}

# named KEY MANIFEST...: the names in a list of the manifests.
named() {
   local key=$1
   shift
   cat "$@" | tr '\n' ' ' | grep -o "$key = \[[^]]*]" | grep -o '"[^"]*"' | tr -d '"'
}

# links OPTION...: links a program that uses all that a build uses. Sets `opened`, the linker's list of
# files, or `reason`.
links() {
   local folder status=0
   folder=$(mktemp -d)
   printf '%s\n' 'use fcvode_mod, only: FCVode' 'external lmdif, lmder, dsbgvd, dgemm' \
      'call lmdif; call lmder; call dsbgvd; call dgemm' 'end' >"$folder/probe.f90"
   opened=$("$compiler" "-I$modules" -J "$folder" -o "$folder/probe" "$folder/probe.f90" "$@" \
      -Wl,-t 2>&1) || status=1
   rm -r "$folder"
   [[ $status == 0 ]] || reason=$(grep -iE 'error|cannot find|undefined' <<<"$opened" | head -n 3)
   return $status
}

# join_without_mpi ARCHIVE...: makes one library, in the folder of the binding, of static libraries of
# SUNDIALS and of external/sundials-7/no_mpi.c. Each of Debian's archives contains what it uses of the
# others. Files of an upgraded package keep their old time of modification, not that of change (ctime).
join_without_mpi() {
   local made=$binding/libsundials_no_mpi.a source=$checkout/external/sundials-7/no_mpi.c object
   local status=0
   mkdir -p "$binding"
   [[ ! -f $made || -n $(find "$@" "$source" -cnewer "$made") ||
      $(cat "$binding/root" 2>/dev/null) != "$root" ]] || return 0
   object=$(mktemp --suffix=.o)
   cc -r -nostdlib -fPIC -o "$object" "$source" \
      -Wl,--whole-archive,--allow-multiple-definition "$@" &&
      objcopy --wildcard --localize-symbol='MPI_*' --localize-symbol='ompi_*' "$object" &&
      rm -f "$made" && ar rcs "$made" "$object" &&
      (links "-L$binding" "${libraries[@]}" -lsundials_no_mpi) || { rm -f "$made" && status=1; }
   rm "$object"
   return $status
}

# Whether all that a build uses is there. Sets `libraries`, the options for the linker, and `joined`,
# the name of the library without MPI that takes the place of SUNDIALS' own (no_mpi.c says why).
libraries_work() {
   local archives core theirs
   have "$compiler" || { reason="no compiler $compiler"; return 1; }
   find_sundials
   [[ -f $modules/fcvode_mod.mod ]] || {
      reason="no Fortran modules of SUNDIALS (fcvode_mod.mod) in $root"
      return 1
   }
   mapfile -t libraries < <(named link "$checkout/fpm.toml" | sed 's/^/-l/')
   mapfile -t theirs < <(named link "$checkout/external/sundials-$version/fpm.toml")
   # shellcheck disable=SC2086
   links $search "${libraries[@]}" "${theirs[@]/#/-l}" || return 1
   joined=
   core=$(grep -m 1 '/libsundials_core\.so$' <<<"$opened") || core=
   if [[ -f ${core%.so}.a ]] && readelf -d "$core" | grep -q 'NEEDED.*\[libmpi'; then
      archives=("${theirs[@]/#/${core%/*}/lib}")
      if join_without_mpi "${archives[@]/%/.a}"; then
         joined=sundials_no_mpi theirs=(sundials_no_mpi) search=-L$binding
      else
         say 'SUNDIALS cannot be separated from MPI, which delays each start of the program'
      fi
   fi
   libraries+=("${theirs[@]/#/-l}")
}

# The package `external/sundials`: the binding for the version found, and where its modules lie.
write_binding() {
   local manifest
   manifest=$(<"$checkout/external/sundials-$version/fpm.toml")
   if [[ -n $joined ]]; then
      manifest=${manifest/link = \[*external-/link = [\"$joined $search\"]$'\n'external-}
   else
      manifest=${manifest/sundials_cvode\"/sundials_cvode${search:+ $search}\"}
   fi
   [[ -d $binding ]] || mkdir "$binding"
   [[ -f $binding/fpm.toml && $(<"$binding/fpm.toml") == "$manifest" ]] ||
      echo "$manifest" >"$binding/fpm.toml"
   ln -sfn "../sundials-$version/src" "$binding/src"
   ln -sfn "$modules" "$binding/modules"
   echo "$root" >"$binding/root"
}

makes_venvs() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# Puts Python packages into .venv, which is made when missing.
pip_install() {
   local python=python3
   if ! "$venv/bin/python" -m pip --version &>/dev/null; then
      makes_venvs "$python" || python=/usr/bin/python3
      makes_venvs "$python" || apt_install python3-venv || return 1
      makes_venvs "$python" && "$python" -m venv --clear "$venv" >&2 || return 1
   fi
   say "installing into .venv: $*"
   "$venv/bin/python" -m pip -q --disable-pip-version-check install "$@" >&2
}

# Copies the executable from the wheel; where it brings libraries it finds them at ../fpm.libs, so
# they come along.
install_fpm() {
   local prefix=$1 lib=$1/lib/fpm-$fpm_version site
   shift
   [[ ! -e $prefix/bin/fpm ]] || return 0
   site=("$venv"/lib/python*/site-packages)
   "$@" install -D -m 755 -t "$lib/fpm" "${site[0]}/fpm/fpm" &&
      { [[ ! -d ${site[0]}/fpm.libs ]] ||
         "$@" install -D -m 755 -t "$lib/fpm.libs" "${site[0]}"/fpm.libs/*; } &&
      "$@" mkdir -p "$prefix/bin" &&
      "$@" ln -s "../lib/fpm-$fpm_version/fpm/fpm" "$prefix/bin/fpm" &&
      say "installed fpm $fpm_version as $prefix/bin/fpm"
}

wanted=${1:-}
[[ $wanted =~ ^(pictures|browser|studio|mpi|files|flags|packages|)$ ]] || {
   say "found '$wanted', expected nothing, 'pictures', 'browser', 'studio', 'mpi', 'files', 'flags'" \
      "or 'packages'"
   exit 2
}

if ! libraries_work; then
   found=$reason
   [[ $root == /usr ]] && apt_install "${packages[@]}" && libraries_work || {
      say "found: $found"
      say 'expected: gfortran, SUNDIALS 6.4 to 7 with Fortran modules, MINPACK, LAPACK, BLAS;' \
         'SUNDIALS_ROOT names another prefix than /usr, FPM_FC another compiler'
      fail "on Debian or Ubuntu: sudo apt-get update && sudo apt-get install ${packages[*]}"
   }
fi
write_binding

if [[ $wanted == flags ]]; then
   echo "$search ${libraries[*]} -fopenmp"
   exit
fi
if [[ $wanted == files ]]; then
   grep -E '^/.*\.(so|a)$' <<<"$opened"
   named external-modules "$binding/fpm.toml" | sed "s|.*|$modules/&.mod|"
   exit
fi

# shellcheck source=scripts/fpm.sh
source "$checkout/scripts/fpm.sh"
if ! find_fpm; then
   pip_install "fpm==$fpm_version" && find_fpm ||
      fail "missing: fpm $fpm_version or newer, on PATH or, with Python 3 and venv, by pip"
fi
if [[ $fpm == "$venv"/* ]]; then
   prefix=/usr/local
   if ! may_be_root || ! install_fpm "$prefix" as_root; then
      prefix=~/.local
      install_fpm "$prefix" || say "$prefix/bin/fpm cannot be made; the scripts use $fpm"
   fi
   is_fpm fpm || say "to call fpm yourself: export PATH=\"$prefix/bin:\$PATH\""
fi

if [[ $wanted =~ ^(pictures|browser)$ ]] &&
   ! "$venv/bin/python" -c 'import numpy, matplotlib, plotly' 2>/dev/null; then
   pip_install "${plotting[@]}" || fail "pictures need Python 3 with venv and ${plotting[*]}"
fi
# Playwright drives the Chromium of the system; it needs no browser of its own.
if [[ $wanted == browser ]]; then
   have chromium || have google-chrome || apt_install chromium fonts-dejavu-core ||
      fail 'missing: Chromium, on Debian sudo apt-get install chromium'
   "$venv/bin/python" -c 'import pytest, playwright' 2>/dev/null || pip_install "${browsing[@]}" ||
      fail "the tests of the reports need Python 3 with venv and ${browsing[*]}"
fi
if [[ $wanted == studio ]]; then
   pip_install "$checkout/python[studio]" || fail 'the page needs Python 3.10 or newer with venv'
   say "start the page by $venv/bin/beamid studio"
fi
if [[ $wanted == mpi ]] && ! { have mpiexec && /usr/bin/python3 -c 'import mpi4py' 2>/dev/null; }; then
   apt_install openmpi-bin python3-mpi4py ||
      fail 'missing: on Debian or Ubuntu sudo apt-get install openmpi-bin python3-mpi4py'
fi
if [[ $wanted == packages ]]; then
   pip_install "${@:2}" || fail "expected Python 3 with venv, and ${*:2} from pip"
fi
