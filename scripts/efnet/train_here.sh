#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains a restorer on this machine: all its cores render films of 3-D scenes while all its GPUs train on them.
#
#   scripts/efnet/train_here.sh --output RUN [--films N] [--first SEED] [--jobs N] [--size WxH] [train_efnet.py's arguments]
#
# RUN/films gets N scenes (default 300) of six exposures of 320x288 pixels, from seed SEED (default 5001) on; RUN/held_out eight
# more, for validation. What is there already is kept, so a second start renders the rest only; the training begins once there is
# enough of both and ends by its own arguments, such as --max-minutes 9. Films that are not ready by then are given up.
# Needs build/bin/jade_simulate (scripts/build.sh jade_simulate) and a Python with torch (docs/efnet.md, section 3): $PYTHON, else
# that of build/training or .venv, else python3. Exit codes are those of train_efnet.py.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;; esac
fail() { echo "train_here: $*" >&2; exit 2; }
held_out=900001  # the first of eight seeds that no training sees
output='' films=300 first=5001 jobs=$(nproc) size=320x288 rest=()
while [ $# -gt 0 ]; do
  case $1 in
    --output | --films | --first | --jobs | --size)
      [ $# -gt 1 ] || fail "$1: expected a value"
      printf -v "${1#--}" %s "$2"; shift 2 ;;
    --footage | --held-out-footage) fail "$1: this script renders its own; with films at hand call scripts/efnet/train_efnet.py" ;;
    *) rest+=("$1"); shift ;;
  esac
done
[ -n "$output" ] || fail "--output: expected a folder for the run"
for name in films first jobs; do
  [[ ${!name} =~ ^[1-9][0-9]*$ ]] || fail "--$name: expected a whole number above 0, found '${!name}'"
done
[ $((first + films)) -le "$held_out" ] || fail "--first: expected seeds below $held_out, which are held out, found up to $((first + films - 1))"
[[ $size =~ ^[1-9][0-9]*x[1-9][0-9]*$ ]] || fail "--size: expected WxH such as 320x288, found '$size'"
simulate=${JADE_BIN:-$root/build/bin}/jade_simulate
[ -x "$simulate" ] || fail "$simulate: not there; run scripts/build.sh jade_simulate"
for python in ${PYTHON:+"$PYTHON"} "$root/build/training/bin/python" "$root/.venv/bin/python" python3; do
  ! command -v "$python" >/dev/null || break
done
# Mistakes in the training's own arguments are told now, not after the first films.
gpus=$("$python" -c '
import sys
sys.path.insert(0, sys.argv.pop(1))
sys.argv[0] = "train_efnet.py"
import train_efnet
train_efnet.parse_arguments()
print(train_efnet.torch.cuda.device_count())' "$root/scripts/efnet" --output "$output" "${rest[@]}") || exit $?

# A film is not in its folder until it is whole.
film() {
  local world=gallery folder=films
  [ $(($1 % 2)) = 1 ] || world=clutter
  [ "$1" -lt "$held_out" ] || folder=held_out
  local target=$output/$folder/$1 making=$output/rendering/$1
  [ ! -e "$target/footage.npy" ] || return 0
  rm -rf "$making"
  if OMP_NUM_THREADS=1 "$simulate" --config "$root/configs/simulate/restorer.yaml" --seed "$1" --set "simulate.world=$world" \
    --set "simulate.width=${size%x*}" --set "simulate.height=${size#*x}" --footage 33 --output "$making" --quiet >"$making.log" 2>&1; then
    mv "$making" "$target" && rm -f "$making.log"
  else
    echo "train_here: film $1 failed, see $making.log" >&2
  fi
}
export -f film
export root simulate size output held_out
mkdir -p "$output/films" "$output/held_out" "$output/rendering"
# A process group of its own, so that all of it ends with the training or with Ctrl-C.
set -m
{ seq "$held_out" $((held_out + 7)); seq "$first" $((first + films - 1)); } | xargs -P "$jobs" -n 1 bash -c 'film "$0"' &
renderers=$!
set +m
trap 'kill -- -$renderers 2>/dev/null || true' EXIT
trap 'exit 130' INT TERM
ready() { find "$output/$1" -name footage.npy | wc -l; }
while [ "$(ready held_out)" -lt 8 ] || [ "$(ready films)" -lt "$((films < 2 ? films : 2))" ]; do
  kill -0 "$renderers" 2>/dev/null || { [ "$(ready films)" -gt 0 ] && [ "$(ready held_out)" -gt 0 ] && break; fail "no film could be rendered"; }
  sleep 0.5
done
run=("$python")
[ "$gpus" -lt 2 ] || run+=(-m torch.distributed.run --nproc-per-node "$gpus")
# Not in the foreground, where bash would hear of no signal before it ends.
set -m
"${run[@]}" "$root/scripts/efnet/train_efnet.py" --output "$output" --footage "$output/films" --held-out-footage "$output/held_out" "${rest[@]}" &
training=$!
set +m
trap 'kill -INT -- -$training 2>/dev/null || true' INT TERM
code=0
wait "$training" || code=$?
while kill -0 "$training" 2>/dev/null; do  # a signal ends the first wait, not the training
  code=0
  wait "$training" || code=$?
done
exit "$code"
