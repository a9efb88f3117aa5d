#!/usr/bin/env bash
# Completions in the real shells, manual pages in the real formatters, readers that go away, no colours unasked.
# usage: shells.sh PSLAM SCRATCH
set -euo pipefail
pslam=$(realpath "$1") dir=$2
rm -rf "$dir" && mkdir -p "$dir" && cd "$dir"
export PATH=$PWD/bin:$PATH
mkdir bin && ln -s "$pslam" bin/pslam
need() { command -v "$1" >/dev/null || { echo "SKIPPED: $1 is not here"; return 1; }; }
expect() { # what, text, word...
    local what=$1 text=$2 word
    shift 2
    for word; do grep -q -- "$word" <<<"$text" || { echo "$what: no $word in: $text"; exit 1; }; done
    echo "$what: $*"
}

pslam completions bash >pslam.bash
found=$(bash --norc -c 'source pslam.bash; COMP_WORDS=(pslam re) COMP_CWORD=1; _pslam pslam re pslam; echo "${COMPREPLY[@]}"
    COMP_WORDS=(pslam eval --rpe) COMP_CWORD=2; _pslam pslam --rpe eval; echo "${COMPREPLY[@]}"')
expect bash "$found" replay report recover --rpe-delta
if need fish; then
    pslam completions fish >pslam.fish
    found=$(fish --no-config -c 'source pslam.fish; complete -C "pslam re"; complete -C "pslam eval --rpe"; complete -C "pslam import "')
    expect fish "$found" replay report recover --rpe-delta euroc
fi
if need zsh; then
    pslam completions zsh >_pslam
    # Its own parser and its completion system take it; completion itself needs a terminal.
    zsh -f -n _pslam
    found=$(zsh -f -c 'fpath=($PWD $fpath); autoload -Uz compinit; compinit -u -d ./dump; echo $_comps[pslam]; autoload +X _pslam; functions _pslam')
    expect zsh "$found" _pslam replay report --rpe-delta
fi

pslam man -o man >/dev/null
for page in pslam pslam-replay pslam-import-tum pslam-report; do test -s "man/$page.1"; done
if need mandoc; then
    # Style advice is not an error.
    mandoc -T lint -W error man/*.1
    expect mandoc "$(mandoc -T utf8 man/pslam-report.1 | col -b)" OPTIONS --compare Examples
fi
if need man; then
    for page in man/*.1; do
        said=$(LC_ALL=C.UTF-8 MANWIDTH=100 man --warnings -E UTF-8 -l "$page" 2>&1 >/dev/null)
        test -z "$said" || { echo "$page: $said"; exit 1; }
    done
    echo "man: $(ls man | wc -l) pages without a warning"
fi

# Pipes that close early, and colours only where someone sees them.
for command in "--help" "config" "completions bash" "replay --help"; do
    bash -o pipefail -c "pslam $command | head -c 1 >/dev/null" 2>err || { echo "pslam $command: $(cat err)"; exit 1; }
    test ! -s err || { cat err; exit 1; }
done
if pslam --help | grep -q $'\e'; then echo "colours in a pipe"; exit 1; fi
if need script; then
    shown=$(script -qec "pslam --help" /dev/null)
    grep -q $'\e\[1m' <<<"$shown" || { echo "no colours on a terminal"; exit 1; }
    shown=$(NO_COLOR=1 script -qec "pslam --help" /dev/null)
    if grep -q $'\e\[' <<<"$shown"; then echo "NO_COLOR is ignored"; exit 1; fi
    echo "colours: on a terminal only, not with NO_COLOR"
fi
