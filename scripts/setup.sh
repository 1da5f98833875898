#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what JADE-GS needs on Debian 12 or Ubuntu 22.04/24.04, only what is missing:
# compilers and libraries through apt, LibTorch as a Python wheel in .venv.
#
#   scripts/setup.sh [--python-torch] [--figures] [--metrics] [--import] [--browser]
#
# --python-torch  also what `import torch` needs in Python (scripts/efnet)
# --figures       also what scripts/figures.py needs (scripts/requirements-figures.txt)
# --import        also COLMAP, and what reads AEDAT4 files and ROS bags (scripts/requirements-import.txt)
# --metrics       also the networks of LPIPS, made by scripts/export_lpips.py (64 MB to fetch, once)
# --browser       also node and Chromium, for the tests of the report's page
#
# Without root it uses sudo for apt; where neither works it prints the command to hand to an
# administrator.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
say() { printf 'setup: %s\n' "$*" >&2; }

python_torch=no
figures=no
metrics=no
import=no
browser=no
for flag in "$@"; do
  case "$flag" in
    --python-torch) python_torch=yes ;;
    --figures) figures=yes ;;
    --import) import=yes ;;
    --metrics) python_torch=yes metrics=yes ;;
    --browser) browser=yes ;;
    *) sed -n '3,15p' "$0" >&2; exit 2 ;;
  esac
done

packages=(g++ cmake ninja-build ccache git pkg-config ca-certificates python3 python3-venv
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev
  libyaml-cpp-dev libcli11-dev libspdlog-dev catch2 libhdf5-dev nlohmann-json3-dev libzip-dev zlib1g-dev libssl-dev
  libcpp-httplib-dev)
# A small comfort: an HDF5 filter that some recordings use.
optional=(hdf5-plugin-lzf)
# Elsewhere COLMAP comes as a wheel, which is also the faster one.
if [ $import = yes ] && [ "$(uname -m)" != x86_64 ]; then packages+=(colmap); fi
if [ $browser = yes ]; then
  # Any node will do; on Ubuntu the package of Chromium is a snap, which the tests cannot drive.
  command -v node >/dev/null || packages+=(nodejs)
  command -v chromium >/dev/null || command -v google-chrome >/dev/null || packages+=(chromium)
fi

installed() { dpkg-query -W -f='${db:Status-Abbrev}' "$1" 2>/dev/null | grep -q '^.i'; }

missing=()
for package in "${packages[@]}"; do installed "$package" || missing+=("$package"); done
if [ ${#missing[@]} -gt 0 ]; then
  for package in "${optional[@]}"; do installed "$package" || missing+=("$package"); done
  as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
      say "these packages are missing and there is no sudo; ask an administrator to run:"
      say "  apt-get install -y ${missing[*]}"
      exit 3
    fi
    as_root=(sudo)
  fi
  say "installing with apt: ${missing[*]}"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq
  # Ubuntu 22.04 lacks some of the optional ones.
  wanted=()
  for package in "${missing[@]}"; do
    if apt-cache show "$package" >/dev/null 2>&1; then wanted+=("$package"); else say "not in this release, skipped: $package"; fi
  done
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${wanted[@]}" >/dev/null
fi

# The wheel holds headers and libraries; its CUDA companions (2.5 GB) are needed for kernels only, and
# then come from the CUDA toolkit.
if [ ! -x .venv/bin/python ]; then
  say "making .venv"
  python3 -m venv .venv
fi
have() { .venv/bin/python - "$@" <<'PY'
import importlib.metadata as metadata, sys
def found(requirement):
    name, _, version = requirement.partition("==")
    try:
        installed = metadata.version(name).split("+")[0]
        return not version or installed == version
    except metadata.PackageNotFoundError:
        return False
print(" ".join(r for r in sys.argv[1:] if not found(r)))
PY
}
wheels=(torch==2.11.0 numpy==2.2.6)
if [ -e /usr/local/cuda/lib64/libcudart.so.13 ]; then
  # With the toolkit on the machine only what it does not hold is added.
  wheels+=(nvidia-cusparselt-cu13==0.8.0 nvidia-nvshmem-cu13==3.4.5 nvidia-cufile==1.15.1.6)
else
  wheels+=(nvidia-cuda-runtime==13.0.96 nvidia-cuda-cupti==13.0.85)
fi
if [ $python_torch = yes ]; then
  # Versions that run on Python 3.10 (Ubuntu 22.04) too.
  wheels+=(typing_extensions==4.13.2 sympy==1.14.0 mpmath==1.3.0 networkx==3.4.2 jinja2==3.1.6 markupsafe==3.0.2
    fsspec==2025.3.0 filelock==3.18.0)
fi
absent=$(have "${wheels[@]}")
if [ -n "$absent" ]; then
  say "installing into .venv: $absent"
  # shellcheck disable=SC2086
  .venv/bin/python -m pip install -q --disable-pip-version-check --no-deps $absent
fi
# What a list of pinned packages names, with all that it needs.
install_list() {
  local pinned absent
  mapfile -t pinned < <(grep -o '^[a-z][^=;]*==[0-9.]*' "$1")
  absent=$(have "${pinned[@]}")
  if [ -n "$absent" ]; then
    say "installing into .venv: $absent and what it needs"
    # Of torch only what is needed is here, of which pip warns at length.
    .venv/bin/python -m pip install -q --disable-pip-version-check -r "$1" \
      2> >(grep -v -e '^ERROR: pip.s dependency resolver' -e '^torch [0-9.]* requires' >&2)
  fi
}
if [ $figures = yes ]; then install_list scripts/requirements-figures.txt; fi
if [ $import = yes ]; then install_list scripts/requirements-import.txt; fi
if [ $metrics = yes ]; then
  .venv/bin/python scripts/export_lpips.py >&2
fi
say "everything is there"
