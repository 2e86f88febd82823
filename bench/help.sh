# What comes before anything is built. Sourced.
# shellcheck shell=bash

# --help: what a script says at its head.
case ${1-} in
-h | --help)
    sed -n '2,/^[^#]/{s/^# \{0,1\}//p}' "$0"
    exit 0
    ;;
esac

# Each word is a model by its name, or a file that is there; else one line, and exit 2.
models_are_known() { # names, as a regular expression; word…
    local names=$1 word script=bench/${0##*/}
    shift
    for word in "$@"; do
        [[ $word =~ ^($names)$ || -f $word ]] || {
            echo "$script: $word: no model that it knows, and no file; see $script --help" >&2
            exit 2
        }
    done
}
