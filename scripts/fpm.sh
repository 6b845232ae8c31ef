# shellcheck shell=bash
# Which fpm serves, and a build that says what it is doing; sourced by scripts that set `checkout`.

# fpm 0.12 or newer (another program of this name has no line `Version:`).
is_fpm() {
   local words
   words=$("$1" --version 2>/dev/null) || return 1
   [[ $words =~ Version:\ +([0-9]+)\.([0-9]+) ]] || return 1
   [[ ${BASH_REMATCH[1]} -gt 0 || ${BASH_REMATCH[2]} -ge 12 ]]
}

# Sets `fpm` to the one on PATH or in .venv.
find_fpm() {
   for fpm in fpm /usr/local/bin/fpm ~/.local/bin/fpm \
      "$checkout"/.venv/lib/python*/site-packages/fpm/fpm; do
      ! is_fpm "$fpm" || return 0
   done
   return 1
}

# Folders of the sources that a build takes.
sources=(src app test example)

# fpm leaves in the library what a source that is no longer there once gave to it.
forget_moved_sources() {
   local list=$checkout/build/sources
   mkdir -p "$checkout/build"
   (cd "$checkout" && find "${sources[@]}" -name '*.f90' | LC_ALL=C sort) >"$list.new"
   if [[ ! -f $list ]] || [[ -n $(LC_ALL=C comm -23 "$list" "$list.new") ]]; then
      rm -rf "$checkout"/build/gfortran_*
   fi
   mv "$list.new" "$list"
}

# fpm 0.12 spells the include folder of a dependency differently until build/cache.toml exists. With
# another spelling the flags differ, and a second build would compile every source again.
resolve_dependencies() {
   local said
   [[ ! -f $checkout/build/cache.toml ]] || return 0
   said=$(cd "$checkout" && "$fpm" update </dev/null 2>&1) || {
      printf 'fpm update failed:\n%s\n' "$said" >&2
      return 1
   }
}

# Reads fpm's output and reports the progress of a build on standard error: in a terminal on one line
# that is overwritten, elsewhere with a new line every half minute. The remaining time is an
# extrapolation from the share of the files that are compiled.
show_progress() {
   local line percent message shown=-30
   SECONDS=0
   while IFS= read -r line; do
      [[ $line =~ ^\[\ *([0-9]+)%\] ]] || continue
      percent=${BASH_REMATCH[1]}
      [[ -t 2 || $((SECONDS - shown)) -ge 30 ]] || continue
      shown=$SECONDS
      message="building, $1 profile: $percent %"
      # Before that the share says nothing about the time.
      [[ $percent -lt 5 || $SECONDS -lt 5 ]] ||
         message+=", about $((SECONDS * (100 - percent) / percent + 1)) s remain"
      if [[ -t 2 ]]; then printf '\r%s\033[K' "$message" >&2; else echo "$message" >&2; fi
   done
   [[ ! -t 2 || $shown -lt 0 ]] || printf '\r\033[K' >&2
}

# fpm's options for a profile. Its release profile compiles with -O3 -funroll-loops, which it puts
# behind all other flags. With -O2 a free decay is fitted in three quarters of the time, and the
# program is built in two thirds of the time and is smaller by a third. Procedures and
# data have sections of their own, so that the linker leaves out what nothing uses: gfortran writes a
# copy and a final procedure for every type, and few of them are called. The program is smaller by
# another seventh. fpm replaces FPM_LDFLAGS by --link-flag, so that the options include it.
options_of() {
   local leave_out=-Wl,--gc-sections
   profile_options=(--profile "$1")
   [[ $1 == release ]] || return 0
   [[ $(uname) != Darwin ]] || leave_out=-Wl,-dead_strip
   profile_options=(--flag "-O2 -ffunction-sections -fdata-sections -Wimplicit-interface -fPIC \
-fmax-errors=1 -fcoarray=single" --link-flag "$leave_out${FPM_LDFLAGS:+ $FPM_LDFLAGS}")
}

# Runs `fpm build` with the options, and keeps what it prints in the file `log`.
run_fpm_build() {
   (cd "$checkout" && "$fpm" build "${profile_options[@]}" "$@" </dev/null 2>&1) | tee "$log" |
      show_progress "$profile"
}

# What gfortran says of a module file that is missing, or older than the source of its module.
stale_module="Mismatch in components of derived type|Cannot open module file|not found in module"

# Deletes the objects and module files of the project, not those of its dependencies, in the folder in
# which fpm compiled last.
forget_objects() {
   local newest folder source name
   newest=$(ls -t "$checkout"/build/gfortran_*/*/*.o.log "$checkout"/build/gfortran_*/*/.*.o.log \
      2>/dev/null | head -n 1) || true
   folder=${newest%/*}
   [[ -n $folder ]] || return 0
   for source in "${sources[@]}"; do
      rm -f "$folder/${source//\//_}"_*
   done
   (cd "$checkout" && find "${sources[@]}" -name '*.f90' -exec \
      sed -nE 's/^ *module +([a-zA-Z]\w*) *$/\L\1/p' {} +) |
      while IFS= read -r name; do rm -f "${folder%/*}/$name.mod"; done
}

# build PROFILE [FLAG...]: compiles the sources that are out of date and shows the progress. fpm's own
# output appears only if the build fails. fpm 0.12 may compile a source with the old module file of a
# module that has changed; such a build is repeated once from the beginning.
build() {
   local profile=$1 log profile_options is_built=true
   shift
   options_of "$profile"
   log=$(mktemp)
   forget_moved_sources
   resolve_dependencies || return 1
   run_fpm_build "$@" || is_built=false
   if ! $is_built && grep -Eq "$stale_module" "$log"; then
      echo "fpm used module files that are out of date: all sources are compiled again" >&2
      forget_objects
      is_built=true
      run_fpm_build "$@" || is_built=false
   fi
   $is_built || cat "$log" >&2
   rm "$log"
   $is_built
}

# paths PROFILE run|test [OPTION...]: path of the program, or of all tests; the runner `echo` prints it.
paths() {
   local profile_options
   options_of "$1"
   shift
   (cd "$checkout" && "$fpm" "$@" "${profile_options[@]}" --runner echo </dev/null 2>/dev/null) |
      grep '^build/' || true
}
