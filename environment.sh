#!/usr/bin/env bash
# Make the environment: environment.sh FOLDER. Python 3.11 (Blender's module needs it; fetched by uv where
# it is missing), the pinned packages, and the system libraries, installed where this user may and named
# where not.
# TORCH_INDEX, if set, is the package index to take torch from (a CPU or a CUDA build).
set -euo pipefail
cd "$(dirname "$0")"
folder=${1:-.venv}
# What Blender's module links, and what the reference renderer of touch needs.
libraries=(libx11-6 libxrender1 libxfixes3 libxi6 libxkbcommon0 libsm6 libice6 libgl1 libxext6 libxt6
  libegl1 libgl1-mesa-dri libgbm1)

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
if [ -n "${TORCH_INDEX:-}" ]; then
  "${pip[@]}" install -qq --index-url "$TORCH_INDEX" "$(grep '^torch==' requirements.lock)"
fi
echo "Installing packages (a few minutes the first time)"
"${pip[@]}" install -qq --retries 5 -r requirements.lock
"${pip[@]}" install -qq --no-deps -e .
