#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the Debian package of a build and checks it in a fresh root file system of this machine's release: it installs
# with all dependencies, its programs run with the LibTorch of the build, and removing it leaves no file.
#
#   scripts/check_deb.sh [BUILD_FOLDER]      default: build, which must be complete
#
# Needs root, debootstrap, dpkg-dev and 2 GB in $TMPDIR; about five minutes. MIRROR=URL replaces Debian's own. Exit code
# 1: the package fails; 3: a requirement is missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/check_deb.sh; exit ;; esac
say() { printf 'check_deb: %s\n' "$*" >&2; }
build=$(realpath "${1:-build}")
[ "$(id -u)" -eq 0 ] || { say "expected root, which debootstrap needs, found $(id -un)"; exit 3; }
for tool in debootstrap cpack dpkg-shlibdeps; do
  command -v "$tool" >/dev/null || { say "expected $tool, found none; apt install debootstrap cmake dpkg-dev"; exit 3; }
done
# shellcheck source=/dev/null
suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
torch=$(sed -n 's/^JADE_TORCH_ROOT:PATH=//p' "$build/CMakeCache.txt")
site=$(dirname "$torch")

(cd "$build" && cpack -G DEB -B "$build/packages" >"$build/cpack.log") || { tail "$build/cpack.log" >&2; exit 1; }
package=$(find "$build/packages" -maxdepth 1 -name 'jade-gs_*.deb' -newer "$build/CPackConfig.cmake" | sort | tail -n 1)
say "$(basename "$package"): $(stat -c %s "$package") bytes; depends on $(dpkg-deb -f "$package" Depends)"

root=${TMPDIR:-/tmp}/jade-deb-$suite
rm -rf --one-file-system "$root"
debootstrap --variant=minbase "$suite" "$root" "${MIRROR:-http://deb.debian.org/debian}" >"$root.log" 2>&1 ||
  { say "debootstrap failed; $root.log says why"; exit 3; }
cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
cp "$package" "$root/root/jade.deb"
mkdir -p "$root/opt/torch"
# The mounts end with this shell.
# shellcheck disable=SC2016
root=$root site=$site unshare --mount bash -euo pipefail -c '
  mount --bind /proc "$root/proc" && mount --rbind /dev "$root/dev"
  mount --bind "$site" "$root/opt/torch" && mount -o remount,bind,ro "$root/opt/torch"
  # A LibTorch that uses CUDA's libraries from the toolkit needs them here too, in the loader's path as NVIDIA installs
  # them.
  if [ -d /usr/local/cuda/lib64 ]; then
    mkdir -p "$root/usr/local/cuda" && mount --rbind /usr/local/cuda "$root/usr/local/cuda"
    echo /usr/local/cuda/lib64 >"$root/etc/ld.so.conf.d/cuda.conf" && chroot "$root" /sbin/ldconfig
  fi
  inside() {
    chroot "$root" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
      ${http_proxy:+http_proxy="$http_proxy"} "$@"
  }
  say() { printf "check_deb: %s\n" "$*" >&2; }
  traces() { (cd "$root" && find usr etc var/lib/dpkg/info -path "*jade*"); }
  left=$(traces)
  [ -z "$left" ] || { say "expected no trace of jade before, found $left"; exit 1; }
  inside apt-get update -qq
  inside apt-get install -y -qq --no-install-recommends /root/jade.deb >>"$root.log" 2>&1 || { tail "$root.log" >&2; exit 1; }
  say "installed: $(inside dpkg-query -W -f "\${Status}, \${Installed-Size} kB" jade-gs)"
  if inside jade_export --version >/dev/null 2>&1; then say "expected the programs to need LibTorch"; exit 1; fi
  inside jade_link_torch /opt/torch
  cd "$root/root"
  inside bash -euc "cd /root
    jade_train --version | head -n 1
    tiny=(--set simulate.width=64 --set simulate.height=48 --set simulate.focal_px=70 --set simulate.exposures=4)
    jade_simulate --quiet --config configs/simulate/demo.yaml \"\${tiny[@]}\" --output data
    jade_train --quiet --config configs/demo.yaml --set dataset.path=data --set train.iterations=20 --set init.points=500 --device cpu --output run
    jade_export --quiet --run run --output scene.sog && jade_inspect scene.sog | head -n 2
    test -s /usr/share/man/man1/jade_train.1 || test -s /usr/share/man/man1/jade_train.1.gz
    test -s /usr/share/bash-completion/completions/jade_train"
  inside apt-get purge -y -qq jade-gs >>"$root.log" 2>&1
  left=$(traces)
  [ -z "$left" ] || { say "expected nothing to be left, found $left"; exit 1; }
  say "removed: nothing is left"'
rm -rf --one-file-system "$root"
say "$package works"
