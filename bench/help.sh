# --help: what a script says at its head, before anything is built. Sourced.
# shellcheck shell=bash
case ${1-} in
-h | --help)
    sed -n '2,/^[^#]/{s/^# \{0,1\}//p}' "$0"
    exit 0
    ;;
esac
