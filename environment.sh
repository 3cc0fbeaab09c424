#!/usr/bin/env bash
# Make the environment: environment.sh FOLDER [LOCK...]. Python 3.11 (Blender's module needs it; fetched by uv
# where it is missing), the packages that the locks pin (requirements.lock: what making a data set needs), and
# the system libraries, installed where this user may and named where not.
# TORCH_INDEX, if set, is the package index to take torch from (a CPU or a CUDA build).
set -euo pipefail
cd "$(dirname "$0")"
folder=${1:-.venv}
locks=("${@:2}")
[ "${#locks[@]}" -gt 0 ] || locks=(requirements.lock)
# What Blender's module links.
libraries=(libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1 libxext6 libxt6)
# What the reference renderer of touch needs, which tests compare with.
[[ " ${locks[*]} " != *" requirements-test.lock "* ]] || libraries+=(libegl1 libgl1-mesa-dri libgbm1)

as_root() {
  if [ "$(id -u)" = 0 ]; then
    "$@"
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    sudo -n "$@"
  else
    return 1
  fi
}

# Install Debian packages, or say which ones and stop.
need_packages() {
  [ "$#" -gt 0 ] || return 0
  echo "System packages missing: $*"
  if command -v apt-get >/dev/null && as_root true; then
    as_root apt-get update -qq
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
  else
    echo "Install them, then run this again. On Debian or Ubuntu: sudo apt-get install $*" >&2
    exit 1
  fi
}

# Print the path of a Python 3.11 that can make environments.
find_python() {
  local candidate fetched=""
  if [ "${#uv[@]}" -gt 0 ]; then fetched=$("${uv[@]}" python find 3.11 2>/dev/null || true); fi
  for candidate in python3.11 python3 python ${fetched:+"$fetched"}; do
    if "$candidate" -c 'import sys, ensurepip; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
  return 1
}

megabytes() { du -sm "$folder" | cut -f1; }

# Install with pip, which is silent while it unpacks; every few seconds say how far it is.
install() {
  "${pip[@]}" install --no-compile --progress-bar off --retries 5 "$@" 2>&1 | tee "$folder/pip.log" | follow || {
    tail -n 20 "$folder/pip.log" >&2
    exit 1
  }
}

follow() {
  local line="" packages=0 begun=$SECONDS next=$((SECONDS + 5)) every=5 status
  [ -t 1 ] || every=30
  while :; do
    status=0
    IFS= read -r -t 1 line || status=$?
    if [ "$status" -gt 0 ] && [ "$status" -le 128 ]; then return 0; fi
    case $line in Collecting* | Processing*) packages=$((packages + 1)) ;; esac
    line=""
    if [ "$SECONDS" -ge "$next" ]; then
      echo "  $((SECONDS - begun)) s: $packages packages fetched, $(megabytes) MB in $folder"
      next=$((SECONDS + every))
    fi
  done
}

# Remove what nothing here runs, half a gigabyte: packages' own tests, headers and tools of torch, Blender's
# kernels for GPUs, brushes and modules for add-ons, and of MKL all but the sequential solver of sparse systems.
prune() {
  local site="$folder/lib/python3.11/site-packages" package
  for package in matplotlib numba numpy pandas scipy sympy; do
    if [ -d "$site/$package" ]; then
      find "$site/$package" -type d -name tests -prune -exec rm -rf {} +
    fi
  done
  rm -rf "$site"/torch/{test,include,bin/protoc*,bin/*[tT]est*}
  rm -rf "$site"/bpy/*/{scripts/addons_core/cycles/lib,python,datafiles/assets}
  rm -f "$folder"/lib/libmkl_{vml_*,intel_thread,tbb_thread,gnu_thread,intel_ilp64,scalapack_*,blacs_*,cdft_core}.so.*
}

uv=()
if ! "$folder/bin/python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
  if ! python=$(find_python); then
    # uv fetches a Python for this user alone; any Python 3 can install uv.
    if command -v uv >/dev/null; then
      uv=(uv)
    elif python3 -m venv "$folder-uv" 2>/dev/null && "$folder-uv/bin/python" -m pip install -qq uv; then
      uv=("$folder-uv/bin/uv")
    fi
    if [ "${#uv[@]}" -gt 0 ] && "${uv[@]}" python install -q 3.11; then
      :
    elif command -v apt-cache >/dev/null && as_root true && apt-cache show python3.11 >/dev/null 2>&1; then
      need_packages python3.11 python3.11-venv
    else
      echo "Python 3.11 is needed, was not found, and uv could not fetch it. Get it from your system's" >&2
      echo "packages, with pyenv (pyenv install 3.11) or from python.org, and put it on the PATH." >&2
      exit 1
    fi
    python=$(find_python)
  fi
  echo "Making $folder with $("$python" --version)"
  "$python" -m venv --clear "$folder"
  rm -rf "$folder-uv"
fi

if command -v dpkg-query >/dev/null; then
  missing=()
  for library in "${libraries[@]}"; do
    # A package may be there under a successor's name (libgl1t64 and the like).
    status=$(dpkg-query -W -f '${Status}\n' "$library" "${library}t64" 2>/dev/null || true)
    [[ $status == *'ok installed'* ]] || missing+=("$library")
  done
  need_packages ${missing[@]+"${missing[@]}"}
fi

pip=("$folder/bin/python" -m pip --disable-pip-version-check)
torch=$(grep '^torch==' requirements.lock)
if [ -n "${TORCH_INDEX:-}" ]; then
  echo "Installing $torch from $TORCH_INDEX"
  install --no-deps --index-url "$TORCH_INDEX" "$torch"
fi
for lock in "${locks[@]}"; do
  echo "Installing the $(grep -c '==' "$lock") packages of $lock"
  # A lock is whole: what packages ask for beyond it is not needed here.
  install --no-deps -r "$lock"
done
# But for a CUDA build of torch, whose libraries are packages.
install "$torch"
install --no-deps -e .
prune
# DVC's notes on files go to a folder of this user's own, whoever starts it (docs/storage.md).
"$folder/bin/python" -c 'from pathlib import Path
from pipeline.dataset.site_cache import note_site_cache, use_own_site_cache
use_own_site_cache(), note_site_cache(Path.cwd())'
rm -f "$folder/pip.log"
echo "$folder: $(megabytes) MB"
