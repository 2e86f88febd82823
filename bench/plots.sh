# Plots of the scripts of this folder, as SVG and PNG, with gnuplot; sourced by them. Without gnuplot
# nothing is drawn, and that is said once.
# shellcheck shell=bash disable=SC2034
# What a plot shows looks the same in all of them.
ours_style="pt 7 ps 1 lc rgb '#1b6ca8' lw 2"
virt_style="pt 5 ps 1 lc rgb '#d95f02' lw 2"
heap_style="pt 9 ps 1 lc rgb '#1b9e77' lw 2"
paper_style="pt 6 ps 1.2 lc rgb '#7a7a7a' lw 2"
no_gnuplot_said=

# plot NAME <SCRIPT: NAME.svg and NAME.png. The script sets title, labels with their units, and plots.
plot() {
    local script kind terminal
    script=$(cat)
    if ! command -v gnuplot >/dev/null; then
        [[ -n $no_gnuplot_said ]] || echo "no plots: there is no gnuplot" >&2
        no_gnuplot_said=yes
        return 0
    fi
    mkdir -p "$(dirname "$1")"
    for kind in svg png; do
        terminal="svg size 760,480 dynamic background 'white' font 'Helvetica,14'"
        [[ $kind == svg ]] || terminal="pngcairo size 1140,720 font 'Sans,14'"
        gnuplot <<END
set terminal $terminal
set output '$1.$kind'
set termoption noenhanced
set encoding utf8
set border 3 lc rgb '#555555'
set tics nomirror textcolor rgb '#222222'
set grid lt 1 lc rgb '#dddddd' lw 0.6
$script
END
    done
}
