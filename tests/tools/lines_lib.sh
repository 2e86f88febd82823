# shellcheck shell=sh
# What the tests of single commands share; sourced, after metanode is set. Makes a folder of its own
# and goes there; failures counts what went wrong, for the exit code.
folder=$(mktemp -d) || exit 1
trap 'rm -rf "$folder"' EXIT
cd "$folder" || exit 1
failures=0

fail() {
    echo "FAILED: $*"
    failures=$((failures + 1))
}

# expect CODE COMMAND …: the exit code, and for errors one line that begins with "metanode: "
expect() {
    code=$1
    shift
    "$metanode" "$@" >out.txt 2>err.txt
    got=$?
    [ $got -eq "$code" ] || fail "exit $got, not $code: $* ($(cat err.txt))"
    if [ "$code" -ne 0 ]; then
        [ "$(wc -l <err.txt)" -eq 1 ] || fail "not one line of error: $*: $(cat err.txt)"
        grep -q '^metanode: ' err.txt || fail "an error without a name: $*: $(cat err.txt)"
    fi
}

says() {
    grep -q -- "$1" err.txt || fail "'$1' is not said: $(cat err.txt)"
}
