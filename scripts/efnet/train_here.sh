#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains a restorer on this machine: all its cores render films of 3-D scenes while all its GPUs train on them.
#
#   scripts/efnet/train_here.sh --output RUN [--films N] [--first SEED] [--jobs N] [--size WxH] [train_efnet.py's arguments]
#
# RUN/films gets N scenes (default 300) of six exposures of 320x288 pixels, from seed SEED (default 5001) on;
# RUN/held_out eight more, for validation. Existing films are kept, so a second start renders only the rest; the
# training begins once there are enough of both and ends by its own arguments, such as --max-minutes 9. Films that are
# not finished by then are abandoned. Needs build/bin/jade_simulate (scripts/build.sh jade_simulate) and a Python with
# torch (docs/engineering/restorer.md, section 3): $PYTHON, else that of build/training or .venv, else python3. Exit
# codes are those of train_efnet.py.
set -euo pipefail
held_out=900001  # the first of eight seeds that training never uses
training='' renderers=''
fail() { echo "train_here: $*" >&2; exit 2; }

# A film appears in its folder only when it is complete.
film() {
  local world=gallery folder=films
  [ $(($1 % 2)) = 1 ] || world=clutter
  [ "$1" -lt "$held_out" ] || folder=held_out
  local target=$output/$folder/$1 making=$output/rendering/$1
  [ ! -e "$target/footage.npy" ] || return 0
  rm -rf "$making"
  if OMP_NUM_THREADS=1 "$simulate" --config "$root/configs/simulate/restorer.yaml" --seed "$1" --set "simulate.world=$world" \
    --set "simulate.width=${size%x*}" --set "simulate.height=${size#*x}" --footage 37 --output "$making" --quiet >"$making.log" 2>&1; then
    rm -rf "$target" && mv -T "$making" "$target" && rm -f "$making.log"
  else
    echo "train_here: film $1 failed, see $making.log" >&2
  fi
}
export -f film

ready() { find "$output/$1" -name footage.npy | wc -l; }

leave() {
  [ -z "$training" ] || kill -TERM -- "-$training" 2>/dev/null || true
  [ -z "$renderers" ] || kill -TERM -- "-$renderers" 2>/dev/null || true
}

# One function, so that bash reads the whole script before it begins.
main() {
  root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
  case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;; esac
  output='' films=300 first=5001 jobs=$(nproc) size=320x288
  local rest=() name python
  while [ $# -gt 0 ]; do
    case $1 in
      --output | --films | --first | --jobs | --size)
        [ $# -gt 1 ] || fail "$1: expected a value"
        printf -v "${1#--}" %s "$2"; shift 2 ;;
      *) rest+=("$1"); shift ;;
    esac
  done
  [ -n "$output" ] || fail "--output: expected a folder for the run"
  for name in films first jobs; do
    [[ ${!name} =~ ^[1-9][0-9]{0,5}$ ]] || fail "--$name: expected a whole number from 1 to 999999, found '${!name}'"
  done
  [ "$films" -gt 1 ] || fail "--films: expected at least 2, fewer are not trained on, found $films"
  [ $((first + films)) -le "$held_out" ] || fail "--first: expected seeds below $held_out, which are held out, found up to $((first + films - 1))"
  [[ $size =~ ^[1-9][0-9]{0,3}x[1-9][0-9]{0,3}$ ]] || fail "--size: expected WxH such as 320x288, found '$size'"
  simulate=${JADE_BIN:-$root/build/bin}/jade_simulate
  [ -x "$simulate" ] || fail "$simulate: not there; run scripts/build.sh jade_simulate"
  if [ -n "${PYTHON:-}" ]; then
    python=$PYTHON
    command -v "$python" >/dev/null || fail "PYTHON: no program at $python"
  else
    for python in "$root/build/training/bin/python" "$root/.venv/bin/python" python3; do
      ! command -v "$python" >/dev/null || break
    done
  fi
  # Reports mistakes in the training's own arguments immediately, not after the first films. Prints the number of
  # processes.
  local processes
  processes=$("$python" -c '
import sys
folder, size = sys.argv[1:3]
sys.path.insert(0, folder)
sys.argv[:3] = ["train_efnet.py"]
import train_efnet
o = train_efnet.parse_arguments()
problem = None
if o.footage or o.held_out_footage:
    problem = "--footage, --held-out-footage: this script renders its own; with films at hand call scripts/efnet/train_efnet.py"
least = max(o.crop, 256) if o.crop >= 128 else o.crop
if min(map(int, size.split("x"))) < least:
    problem = f"--size: expected at least {least}x{least} for --crop {o.crop}, found {size}"
if problem:
    sys.exit(print(f"train_here: {problem}", file=sys.stderr) or 2)
print(train_efnet.torch.cuda.device_count() if o.device == "cuda" else 1)' "$root/scripts/efnet" "$size" --output "$output" "${rest[@]}") || exit $?

  export root simulate size output held_out
  mkdir -p "$output/films" "$output/held_out" "$output/rendering"
  trap leave EXIT
  trap 'exit 130' INT
  trap 'exit 143' TERM
  trap 'exit 129' HUP
  # Separate process groups, so that their children end with them.
  set -m
  { seq "$held_out" $((held_out + 7)); seq "$first" $((first + films - 1)); } | xargs -P "$jobs" -n 1 bash -c 'film "$0"' &
  renderers=$!
  while [ "$(ready held_out)" -lt 8 ] || [ "$(ready films)" -lt 2 ]; do
    kill -0 "$renderers" 2>/dev/null || { [ "$(ready films)" -gt 1 ] && [ "$(ready held_out)" -gt 0 ] && break; fail "too few films could be rendered"; }
    sleep 0.5
  done
  local run=("$python")
  [ "$processes" -lt 2 ] || run+=(-m torch.distributed.run --nproc-per-node "$processes")
  # Not in the foreground, where bash would handle a signal only after it ends.
  "${run[@]}" "$root/scripts/efnet/train_efnet.py" --output "$output" --footage "$output/films" --held-out-footage "$output/held_out" \
    "${rest[@]}" &
  training=$!
  local code heard
  trap 'heard=yes; kill -INT -- "-$training" 2>/dev/null || true' INT
  trap 'heard=yes; kill -TERM -- "-$training" 2>/dev/null || true' TERM HUP
  while :; do  # a signal ends a wait, not the training
    heard='' code=0
    wait "$training" || code=$?
    [ -n "$heard" ] || break
  done
  training=''
  exit "$code"
}

main "$@"
