# What the end-to-end scripts share; sourced. They drive the program as a user does: through its
# command line. Each takes the build folder (default build), counts what it tries, and ends with
#   N passed, N failed, N skipped
# Exit 0, 1 when something failed, 77 when all was skipped (meson's word for it).
# MN_MESHES is a folder with real models; without it ../shared/meshes beside the sources.
set -Eeuo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=$(cd "${1:-$root/build}" && pwd)
metanode=${METANODE:-$build/tools/metanode}
helpers=$build/tests/tools
meshes=${MN_MESHES:-$root/../shared/meshes}

passed=0 failed=0 skipped=0 last=0
scratch=$(mktemp -d "$build/e2e.XXXXXX")
out=$scratch/out err=$scratch/err
trap 'rm -rf "$scratch"' EXIT
trap 'echo "FAILED: $0 gave up at line $LINENO: $BASH_COMMAND"' ERR

# A sanitizer takes memory and time of its own: no limits then.
seconds_max=0 megabytes_max=0
sanitized=false
if nm -D "$metanode" 2>/dev/null | grep -qE '__(asan|tsan)_init'; then
    sanitized=true
fi

pass() { passed=$((passed + 1)); }
skip() { skipped=$((skipped + 1)); printf 'skipped: %s\n' "$*"; }
fail() {
    failed=$((failed + 1))
    printf 'FAILED: %s\n' "$*"
    head -n 3 "$err" 2>/dev/null | cut -c 1-300 | sed 's/^/    /'
}

# expect CODE NAME ARGUMENT…: metanode with the arguments exits with that code (0,3: with one of those),
# within the limits; standard output lies in $out then, errors in $err. False when it does not.
expect() {
    local want=$1 name=$2 code=0
    shift 2
    "$helpers/e2e_limits" "$seconds_max" "$megabytes_max" "$metanode" "$@" >"$out" 2>"$err" </dev/null ||
        code=$?
    last=$code
    if [[ ,$want, != *,$code,* ]]; then
        fail "$name: exit $code instead of $want: metanode $*"
        return 1
    fi
    pass
}

# check NAME COMMAND…: the command succeeds.
check() {
    local name=$1
    shift
    if "$@" >"$scratch/check" 2>&1; then
        pass
    else
        fail "$name: $* $(head -n 2 "$scratch/check")"
        return 1
    fi
}

# figures KEY…: the values of these keys of the JSON in $out, one a line.
figures() { "$helpers/e2e_json" "$@" <"$out"; }

# equal NAME KEY VALUE: a key of the JSON in $out has this value.
equal() {
    local found
    found=$(figures "$2" 2>&1) || true
    if [[ $found == "$3" ]]; then
        pass
    else
        fail "$1: $2 is $found, should be $3"
    fi
}

# holds NAME CONDITION: a condition of awk, without variables.
holds() {
    if awk "BEGIN {exit !($2)}" </dev/null; then
        pass
    else
        fail "$1: not so: $2"
    fi
}

# one_line NAME WORD…: the errors are one line that holds each of the words.
one_line() {
    local name=$1 word
    shift
    if [[ $(wc -l <"$err") -ne 1 ]]; then
        fail "$name: $(wc -l <"$err") lines of errors"
        return
    fi
    for word in "$@"; do
        if ! grep -qiF -e "$word" "$err"; then
            fail "$name: the error does not say '$word'"
            return
        fi
    done
    pass
}

# part FUNCTION ARGUMENT…: a part of a script; what fails in it has been counted, and the next goes on.
part() { "$@" || true; }

finish() {
    echo "$passed passed, $failed failed, $skipped skipped"
    [[ $failed -eq 0 ]] || exit 1
    [[ $passed -gt 0 ]] || exit 77
    exit 0
}
