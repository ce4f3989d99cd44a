# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash
#
# What tools/demo and tools/test have in common: packages, toolkit, build. Sourced, not run.

URGENGO_ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
URGENGO_PRESET=${URGENGO_PRESET:-release}
URGENGO_BUILD=$URGENGO_ROOT/build/$URGENGO_PRESET

URGENGO_PACKAGES=(
    cmake ninja-build g++ ccache python3 catch2 libfmt-dev libyaml-cpp-dev libcli11-dev
    nlohmann-json3-dev libspdlog-dev libbenchmark-dev libncurses-dev prometheus-cpp-dev
    libprotozero-dev libjs-chart.js)

die() {
    echo "$(basename "$0"): $*" >&2
    exit 1
}

# Installs those of the Debian/Ubuntu packages that are not there yet.
# Where that cannot be: 1, and `why_not` says why.
try_to_install() {
    local missing=() package sudo=()
    why_not=
    command -v dpkg-query >/dev/null || {
        why_not="found no dpkg: install by hand what these Debian packages hold: $*"
        return 1
    }
    for package in "$@"; do
        dpkg-query -W -f='${db:Status-Status}\n' "$package" 2>/dev/null | grep -qx installed ||
            missing+=("$package")
    done
    [ ${#missing[@]} -eq 0 ] && return
    if [ "$(id -u)" -ne 0 ]; then
        sudo -n true 2>/dev/null || {
            why_not="missing packages and no right to install them; run: sudo apt-get install ${missing[*]}"
            return 1
        }
        sudo=(sudo)
    fi
    echo "installing ${missing[*]}"
    "${sudo[@]}" apt-get update -qq || {
        why_not="apt-get update failed"
        return 1
    }
    DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq "${missing[@]}" >/dev/null || {
        why_not="could not install: ${missing[*]}"
        return 1
    }
}

# Installs what every build needs.
install_packages() {
    try_to_install "${URGENGO_PACKAGES[@]}" || die "$why_not"
}

# Perfetto's own decoder, for the test of `urgengo trace export --perfetto`: of PyPI's packages, in a
# virtual environment under build/. Where it cannot be had this says why, and that test is skipped.
URGENGO_PERFETTO=$URGENGO_ROOT/build/perfetto
PERFETTO_PACKAGES=(perfetto==0.59.1 protobuf==6.31.1)
install_perfetto_decoder() {
    local folder=$URGENGO_PERFETTO why
    [ "$(cat "$folder/packages" 2>/dev/null)" = "${PERFETTO_PACKAGES[*]}" ] && return
    rm -rf "$folder"
    mkdir -p "$folder"
    if ! python3 -c 'import venv, ensurepip' 2>/dev/null && ! try_to_install python3-venv; then
        why=$why_not
    elif why=$(python3 -m venv "$folder" 2>&1 &&
        "$folder/bin/python3" -m pip install --quiet --disable-pip-version-check --no-deps \
            --only-binary :all: --retries 1 --timeout 15 "${PERFETTO_PACKAGES[@]}" 2>&1); then
        echo "${PERFETTO_PACKAGES[*]}" >"$folder/packages"
        return
    fi
    rm -rf "$folder"
    echo "the test with Perfetto's own decoder will be skipped, no ${PERFETTO_PACKAGES[*]}: ${why##*$'\n'}"
}

# Puts nvcc on PATH, or says what is missing.
find_cuda_toolkit() {
    command -v nvcc >/dev/null && return
    local folder
    for folder in "${CUDA_HOME:-}" /usr/local/cuda /opt/cuda; do
        if [ -n "$folder" ] && [ -x "$folder/bin/nvcc" ]; then
            PATH=$folder/bin:$PATH
            return
        fi
    done
    die "found no CUDA toolkit (nvcc): install version 12.4 or newer, or set CUDA_HOME to its folder"
}

# Configures once, then builds what changed.
build() {
    if [ ! -f "$URGENGO_BUILD/build.ninja" ]; then
        cmake -S "$URGENGO_ROOT" --preset "$URGENGO_PRESET" >"$URGENGO_ROOT/build-$URGENGO_PRESET.log" 2>&1 || {
            cat "$URGENGO_ROOT/build-$URGENGO_PRESET.log" >&2
            die "configuring failed"
        }
        rm -f "$URGENGO_ROOT/build-$URGENGO_PRESET.log"
    fi
    (cd "$URGENGO_ROOT" && cmake --build --preset "$URGENGO_PRESET") || die "the build failed"
}

prepare() {
    install_packages
    find_cuda_toolkit
    build
}

has_gpu() {
    command -v nvidia-smi >/dev/null && nvidia-smi -L 2>/dev/null | grep -q '^GPU'
}
