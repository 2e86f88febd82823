#!/usr/bin/env bash
# Goal: no page sends its reader nowhere: links, their anchors, sections by number, files of the sources;
# and scripts that take minutes say what they do,
# and which word they do not know, before they begin.
# Method: every relative link in every page; every "design.md §N" in the sources against docs/contract.md;
# each script's --help, and each with a model that is not there.
# test_docs.sh ROOT
set -uo pipefail
cd "$1" || exit 1
failures=0
fail() { echo "FAILED: $*"; failures=$((failures + 1)); }
mapfile -t pages < <(find . -name '*.md' -not -path './build*' -not -path './.*' | sort)

# anchors PAGE: as web pages of repositories make them of headings
anchors() {
    sed -n 's/^##* //p' "$1" | tr '[:upper:]' '[:lower:]' | sed -E 's/[^[:alnum:] _-]//g; s/ /-/g'
}

for page in "${pages[@]}"; do
    while read -r link; do
        [[ $link == *://* ]] && continue
        path=${link%%#*} anchor=
        [[ $link == *'#'* ]] && anchor=${link#*#}
        target=$(dirname "$page")/$path
        [[ -n $path ]] || target=$page
        [[ -e $target ]] || { fail "$page: $link"; continue; }
        [[ -z $anchor ]] || anchors "$target" | grep -qxF -- "$anchor" || fail "$page: no heading: $link"
    done < <(grep -oE '\]\([^) ]+\)' "$page" | sed -E 's/^\]\(//; s/\)$//')
    while read -r path; do
        compgen -G "$path*" >/dev/null || compgen -G "$(dirname "$page")/$path*" >/dev/null ||
            fail "$page: no file $path"
    done < <(grep -oE '`(src|tests|tools|docs|include|bench)/[A-Za-z0-9_./-]+`' "$page" | tr -d '`')
done

# §3.2 is the second item of section 3.
sections=$(awk '/^## [0-9]/ { section = $2; print section; next }
    section ~ /^[36]$/ && /^[0-9]+\. / { print section "." $1 + 0 }' docs/contract.md)
while read -r number; do
    grep -qxF "${number%.}" <<<"$sections" || fail "docs/contract.md has no §$number"
done < <(grep -rhoE 'design\.md,? §[0-9.]+( (and|to)?,? ?§[0-9.]+)*' README.md docs src tests tools include bench |
    grep -oE '§[0-9.]+' | tr -d '§' | sed 's/\.$//' | sort -u)

# The scripts of bench/ take minutes and build what they need: --help does nothing of that.
for script in bench/build bench/cgroup bench/navigator bench/paper bench/paper-tables bench/quality bench/soak; do
    METANODE=/nowhere "$script" --help 2>&1 </dev/null | grep -qF "$script" || fail "$script --help"
done
# Nor does a model that there is none of.
for script in bench/build bench/cgroup bench/navigator bench/paper bench/quality bench/soak; do
    line=$(METANODE=/nowhere "$script" nosuch.mesh 2>&1 </dev/null)
    code=$?
    [[ $code -eq 2 && $(wc -l <<<"$line") -eq 1 && $line == *"$script"* ]] || fail "$script nosuch.mesh: $code: $line"
done
exit $((failures > 0))
