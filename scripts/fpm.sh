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

# build PROFILE [FLAG...]: compiles what is out of date, with one line on standard error that is
# written over in a terminal; fpm's own words only where the build fails.
build() {
   local profile=$1 log line told=
   shift
   log=$(mktemp)
   forget_moved_sources
   if (cd "$checkout" && "$fpm" build --profile "$profile" "$@" </dev/null 2>&1) | tee "$log" |
      while IFS= read -r line; do
         [[ $line == '['* ]] || continue
         [[ -n $told ]] || echo "building, $profile profile: a minute or two" >&2
         told=yes
         [[ ! -t 2 ]] || printf '\r%.60s\033[K' "$line" >&2
      done; then
      rm "$log"
      [[ ! -t 2 ]] || printf '\r\033[K' >&2
      return
   fi
   cat "$log" >&2
   rm "$log"
   return 1
}

# Path of the program, or of all tests, of a profile: the runner `echo` prints it.
paths() {
   (cd "$checkout" && "$fpm" "$@" --runner echo </dev/null 2>/dev/null) | grep '^build/' || true
}
