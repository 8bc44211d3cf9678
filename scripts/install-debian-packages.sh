#!/usr/bin/env bash
# Install the system libraries that off-screen pictures need on a bare Debian or Ubuntu, and the browser of the tests.
#
#   scripts/install-debian-packages.sh               install them
#   scripts/install-debian-packages.sh --if-missing  only where they are missing and we may; else say so
#
# VTK's wheel loads them at run time: libX11 (without it VTK 9.7 stops the process), Xcursor, and EGL with
# Mesa's software renderer, for machines with no screen and no graphics card.  The tests of the explorer drive Chromium;
# they are skipped where there is none.
set -euo pipefail

packages=(libx11-6 libxcursor1 libegl1 libgl1-mesa-dri chromium)

missing() {
    local known
    command -v chromium >/dev/null || return 0
    known=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p)
    for library in libX11.so.6 libXcursor.so.1 libEGL.so.1 libEGL_mesa.so.0; do
        [[ $known == *"$library"* ]] || return 0
    done
    return 1
}

if [[ ${1:-} == --if-missing ]]; then
    [[ $(uname) == Linux ]] && missing || exit 0
fi

as_root=()
if ((EUID != 0)); then as_root=(sudo -n); fi
if ! command -v apt-get >/dev/null || ! "${as_root[@]}" true 2>/dev/null; then
    echo "Pictures need the system libraries X11, Xcursor and EGL, and the tests of the explorer Chromium (Debian:" \
        "${packages[*]}); the rest works without." >&2
    [[ ${1:-} == --if-missing ]] && exit 0 || exit 1
fi

echo "== system libraries: ${packages[*]}"
export DEBIAN_FRONTEND=noninteractive
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" apt-get install -y -qq --no-install-recommends "${packages[@]}" >/dev/null
