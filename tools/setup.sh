#!/bin/sh
# Prepare a folder for working on photonbeams: a virtual environment and the packages.
# Usage: tools/setup.sh VENV. It does only what is missing. The Makefile calls it until VENV/.ready is up to date.
set -eu

venv=$1
cd "$(dirname "$0")/.."

stop() {
    echo "set-up: $*" >&2
    exit 1
}

# Install with apt, if that is allowed: as root, or with a sudo that needs no password.
apt_install() {
    command -v apt-get >/dev/null || return 1
    if [ "$(id -u)" = 0 ]; then
        as_root="env"
    elif sudo -n true 2>/dev/null; then
        as_root="sudo -n env"
    else
        return 1
    fi
    $as_root apt-get update -qq >/dev/null 2>&1 || true # an old index may still do
    for package in "$@"; do
        apt-cache show "$package" >/dev/null 2>&1 || continue
        echo "set-up: installing $package with apt-get"
        $as_root DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "$package" >/dev/null 2>&1 &&
            return 0
    done
    return 1
}

recent() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() {
    for python in ${PYTHON:-python3.11 python3 python3.12 python3.13}; do
        if recent "$python"; then
            return 0
        fi
    done
    stop "Python 3.11 or newer is needed: install python3.11, or name one with PYTHON=/path/to/python3"
}

make_venv() {
    if recent "$venv/bin/python" && "$venv/bin/python" -m pip --version >/dev/null 2>&1; then
        return 0
    fi
    find_python
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    # Debian keeps venv's pip (ensurepip) in a package of its own.
    "$python" -c 'import venv, ensurepip' 2>/dev/null ||
        apt_install "python$version-venv" ||
        stop "Python's venv module is missing: install the package python$version-venv"
    echo "set-up: making $venv with $python ($version)"
    "$python" -m venv --clear "$venv"
}

install_packages() {
    echo "set-up: installing the packages of pyproject.toml"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check -e '.[dev]' ||
        stop "pip could not install the packages of pyproject.toml; its message is above"
}

# Dr.Jit's wheel links libatomic, which comes with compilers but not with a small Debian.
install_libatomic() {
    "$venv/bin/python" -c 'import ctypes; ctypes.CDLL("libatomic.so.1")' 2>/dev/null || [ "$(uname)" != Linux ] ||
        apt_install libatomic1 ||
        stop "libatomic.so.1 is missing: install the package libatomic1"
}

# Playwright's wheel brings no browser. Without one, all tests run except those of the studio's page.
install_chromium() {
    for name in chromium chromium-browser google-chrome; do
        command -v "$name" >/dev/null && return 0
    done
    apt_install chromium || echo "set-up: Chromium was not found, so tests in a browser are skipped; to run them, install chromium"
}

# Blender as a module brings libraries of its own, and there is one for Python 3.11 alone. Without it, all tests run
# except those of Blender's render engine.
install_blender() {
    if [ -x "$venv/bpy/bin/python" ]; then
        return 0
    fi
    if "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then
        echo "set-up: installing Blender as a module (bpy) in $venv/bpy"
        "$venv/bin/python" -m venv "$venv/bpy" &&
            "$venv/bpy/bin/python" -m pip install --quiet --disable-pip-version-check bpy==5.0.1 && return 0
        rm -rf "$venv/bpy"
    fi
    echo "set-up: there is no bpy for this Python, so tests in Blender are skipped"
}

prove() {
    report=$("$venv/bin/photonbeams" doctor 2>&1) || {
        echo "$report" >&2
        exit 1
    }
}

make_venv
install_libatomic
install_packages
install_chromium
install_blender
prove
touch "$venv/.ready"
