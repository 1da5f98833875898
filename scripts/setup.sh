#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs what JADE-GS needs on Debian 12 or 13, or Ubuntu 22.04 or 24.04, only what is missing:
# compilers and libraries through apt, LibTorch as a Python wheel in .venv.
#
#   scripts/setup.sh [--python-torch] [--figures] [--metrics] [--import] [--browser]
#
# --python-torch  also what `import torch` needs in Python, and what else scripts/efnet reads pictures and events with
# --figures       also what scripts/figures.py needs (scripts/requirements-figures.txt)
# --import        also COLMAP, and what reads AEDAT files and ROS bags (scripts/requirements-import.txt)
# --metrics       also the networks of LPIPS, made by scripts/export_lpips.py (64 MB to fetch, once)
# --browser       also node and Chromium, for the tests of the report's page
#
# Without root it uses sudo for apt; where neither works it prints the command to hand to an
# administrator. Exit code 2: another flag; 3: something that is needed cannot be had.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "$*"; exit 3; }
usage() { sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/setup.sh; }

python_torch=no
restorer=no
figures=no
metrics=no
import=no
browser=no
for flag in "$@"; do
  case "$flag" in
    --python-torch) python_torch=yes restorer=yes ;;
    --figures) figures=yes ;;
    --import) import=yes ;;
    --metrics) python_torch=yes metrics=yes ;;
    --browser) browser=yes ;;
    -h | --help) usage; exit ;;
    *) say "expected a flag of those below, found '$flag'"; usage >&2; exit 2 ;;
  esac
done

packages=(g++ cmake ninja-build ccache git pkg-config ca-certificates python3 python3-venv
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev
  libyaml-cpp-dev libcli11-dev libspdlog-dev catch2 libhdf5-dev nlohmann-json3-dev libzip-dev zlib1g-dev libzstd-dev
  libwebp-dev libssl-dev libcpp-httplib-dev)
# Optional: an HDF5 filter that some recordings use.
optional=(hdf5-plugin-lzf)
# On other machines the COLMAP wheel is used, which is also faster.
if [ $import = yes ] && [ "$(uname -m)" != x86_64 ]; then packages+=(colmap); fi
if [ $browser = yes ]; then
  # Any node suffices; on Ubuntu the package of Chromium is a snap, which the tests cannot control.
  command -v node >/dev/null || packages+=(nodejs)
  command -v chromium >/dev/null || command -v google-chrome >/dev/null || packages+=(chromium)
fi

installed() { dpkg-query -W -f='${db:Status-Abbrev}' "$1" 2>/dev/null | grep -q '^.i'; }

# Prints the packages that are not installed.
missing_of() { for package; do installed "$package" || echo "$package"; done; }

mapfile -t missing < <(missing_of "${packages[@]}")
if [ ${#missing[@]} -gt 0 ]; then
  command -v apt-get >/dev/null ||
    fail "expected Debian 12 or 13, or Ubuntu 22.04 or 24.04, found no apt-get; install what these packages hold by hand: ${missing[*]}"
  as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
      say "these packages are missing and there is no sudo; ask an administrator to run:"
      say "  apt-get install -y ${missing[*]}"
      exit 3
    fi
    as_root=(sudo)
  fi
  apt_get() { "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq "$@" >/dev/null; }
  say "installing with apt: ${missing[*]}"
  apt_get update || say "apt could not renew its lists; going on with those that are here"
  unknown=()
  for package in "${missing[@]}"; do apt-cache show "$package" >/dev/null 2>&1 || unknown+=("$package"); done
  [ "${unknown[*]}" != chromium ] ||
    fail "this release has no package chromium that the tests of the page can drive; install google-chrome, or leave out --browser"
  [ ${#unknown[@]} -eq 0 ] ||
    fail "apt does not know these packages, which are needed: ${unknown[*]}; is there a network (apt-get update), and is this" \
      "Debian 12 or 13, or Ubuntu 22.04 or 24.04?"
  apt_get install -y --no-install-recommends "${missing[@]}" ||
    fail "apt could not install: $(missing_of "${missing[@]}" | xargs); its own words are above"
  # Ubuntu 22.04 lacks some of the optional ones.
  for package in $(missing_of "${optional[@]}"); do
    { apt-cache show "$package" && apt_get install -y --no-install-recommends "$package"; } >/dev/null 2>&1 ||
      say "optional, cannot be had and is left out: $package"
  done
fi

# The wheel contains headers and libraries; its CUDA companions (2.5 GB) are needed for kernels only, and then come from
# the CUDA toolkit. An interrupted virtual environment has a Python, but no pip.
whole() { .venv/bin/python -m pip --version >/dev/null 2>&1; }
if ! whole; then
  if [ -e .venv/bin/python ]; then say "making .venv anew: its pip does not work"; else say "making .venv"; fi
  python3 -m venv --clear .venv >&2 || true
  whole || fail "python3 -m venv could not make .venv; remove that folder, and check the free space"
fi
pip_install() {
  .venv/bin/python -m pip install -q --disable-pip-version-check "$@" ||
    fail "pip could not install into .venv what is needed; its own words are above. Check the network and the free space"
}
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
  # With the toolkit on the machine, add only what it lacks.
  wheels+=(nvidia-cusparselt-cu13==0.8.0 nvidia-nvshmem-cu13==3.4.5 nvidia-cufile==1.15.1.6)
else
  wheels+=(nvidia-cuda-runtime==13.0.96 nvidia-cuda-cupti==13.0.85)
fi
if [ $python_torch = yes ]; then
  # Versions that also run on Python 3.10 (Ubuntu 22.04).
  wheels+=(typing_extensions==4.13.2 sympy==1.14.0 mpmath==1.3.0 networkx==3.4.2 jinja2==3.1.6 markupsafe==3.0.2
    fsspec==2025.3.0 filelock==3.18.0)
fi
# In the versions of requirements-import.txt.
if [ $restorer = yes ]; then wheels+=(h5py==3.13.0 opencv-python-headless==4.11.0.86); fi
absent=$(have "${wheels[@]}")
if [ -n "$absent" ]; then
  say "installing into .venv: $absent"
  # shellcheck disable=SC2086
  pip_install --no-deps $absent
fi
# Installs a list of pinned packages with their dependencies.
install_list() {
  local pinned absent
  mapfile -t pinned < <(grep -o '^[a-z][^=;]*==[0-9.]*' "$1")
  absent=$(have "${pinned[@]}")
  if [ -n "$absent" ]; then
    say "installing into .venv: $absent and what it needs"
    # Only parts of torch's dependencies are installed; hide pip's warnings about the rest.
    pip_install -r "$1" \
      2> >(grep -v -e '^ERROR: pip.s dependency resolver' -e '^torch [0-9.]* requires' >&2)
  fi
}
if [ $figures = yes ]; then install_list scripts/requirements-figures.txt; fi
if [ $import = yes ]; then install_list scripts/requirements-import.txt; fi
if [ $metrics = yes ]; then
  .venv/bin/python scripts/export_lpips.py >&2
fi
say "everything is there"
