#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Before a release: runs both commands of the README, scripts/demo.sh and scripts/test.sh, from the newest commit in a fresh
# root file system of each of these Debian releases.
#
#   scripts/check_systems.sh [SUITE...]      default: bookworm trixie
#
# Needs root, debootstrap, 15 GB in $TMPDIR and about half an hour per release on two cores. MIRROR=URL replaces Debian's
# own, and makes other suites possible, such as noble from a mirror of Ubuntu. Each root file system is kept for a
# closer look, until the next call replaces it. Exit code 1: a command failed in one of them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/check_systems.sh; exit ;; esac
say() { printf 'check_systems: %s\n' "$*" >&2; }
[ "$(id -u)" -eq 0 ] || { say "expected root, which debootstrap needs, found $(id -un)"; exit 3; }
command -v debootstrap >/dev/null || { say "expected debootstrap, found none; apt install debootstrap"; exit 3; }
suites=("$@")
[ $# -gt 0 ] || suites=(bookworm trixie)

# Runs a command in a root file system; its mounts end with the command.
inside() {
  root=$1 unshare --mount bash -c '
    mount --bind /proc "$root/proc" && mount --rbind /dev "$root/dev" || exit 1
    exec chroot "$root" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 CI=1 \
      ${http_proxy:+http_proxy="$http_proxy"} ${https_proxy:+https_proxy="$https_proxy"} \
      ${PIP_CERT:+PIP_CERT=/root/certificates.crt} "$@"' inside "${@:2}"
}

failed=()
for suite in "${suites[@]}"; do
  root=${TMPDIR:-/tmp}/jade-system-$suite
  rm -rf --one-file-system "$root"
  debootstrap --variant=minbase "$suite" "$root" "${MIRROR:-http://deb.debian.org/debian}" >"$root.log" 2>&1 ||
    { say "$suite: debootstrap failed; $root.log says why"; failed+=("$suite"); continue; }
  cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
  [ -z "${PIP_CERT:-}" ] || cp -L "$PIP_CERT" "$root/root/certificates.crt"
  git clone -q --no-hardlinks . "$root/root/jade-gs"
  for command in scripts/demo.sh scripts/test.sh; do
    say "$suite: $command"
    if inside "$root" bash -c "cd ~/jade-gs && $command" >"$root.log" 2>&1; then
      say "$suite: $command works"
    else
      say "$suite: $command failed; the end of $root.log:"
      tail -n 30 "$root.log" >&2
      failed+=("$suite: $command")
    fi
  done
done
[ ${#failed[@]} -eq 0 ] || { say "failed: ${failed[*]}"; exit 1; }
