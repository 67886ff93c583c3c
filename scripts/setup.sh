#!/usr/bin/env bash
# Checks what building and running needs: a C++ compiler, Rust, a Vulkan loader and a Vulkan driver.
# Debian and Ubuntu: installs what lacks. Elsewhere: says what to install. Safe to run again; quick when all is there.
set -euo pipefail

# Keep equal to rust-version in Cargo.toml.
RUST_MINIMUM=1.95

export PATH="$PATH:$HOME/.cargo/bin:/sbin:/usr/sbin"

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$@" >&2; exit 1; }
has() { command -v "$1" >/dev/null 2>&1; }

# FLIP and zstd are compiled from C++ and C; Rust links through the C compiler.
has_compiler() { { has cc || has gcc || has clang; } && { has c++ || has g++ || has clang++; }; }

check_rust() {
  has rustc && has cargo || fail "Rust is missing. Install it with rustup, then run this again:" \
    "  curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh"
  local found
  found=$(rustc --version | cut -d' ' -f2)
  [ "$(printf '%s\n' "$RUST_MINIMUM" "${found%%-*}" | sort -V | head -n 1)" = "$RUST_MINIMUM" ] ||
    fail "Rust $found is too old, $RUST_MINIMUM or newer is needed: rustup update stable && rustup default stable"
}

library_list=
has_library() {
  # Asked once: each call of ldconfig takes some milliseconds.
  [ -n "$library_list" ] || library_list=$(ldconfig -p 2>/dev/null || true)
  case "$library_list" in *"$1"*) return 0 ;; esac
  # Where there is no ldconfig cache (Nix, some containers).
  local folder folders
  IFS=: read -r -a folders <<<"${LD_LIBRARY_PATH:-}:/usr/lib:/usr/lib64:/usr/local/lib:/usr/lib/$(uname -m)-linux-gnu"
  for folder in "${folders[@]}"; do
    [ -n "$folder" ] && [ -e "$folder/$1" ] && return 0
  done
  return 1
}

# A driver's manifest: where the loader looks by default, or where the user points it to.
has_vulkan_driver() {
  local file files pattern
  files="${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}"
  if [ -n "$files" ]; then
    IFS=: read -r -a files <<<"$files"
    for file in "${files[@]}"; do [ -e "$file" ] && return 0; done
    return 1
  fi
  for pattern in /usr/share/vulkan/icd.d /etc/vulkan/icd.d /usr/local/share/vulkan/icd.d /run/opengl-driver/share/vulkan/icd.d; do
    for file in "$pattern"/*.json; do [ -e "$file" ] && return 0; done
  done
  return 1
}

# Libraries that the window opens at run time, and the Debian packages they are in.
X11_LIBRARIES="libX11.so.6=libx11-6 libXcursor.so.1=libxcursor1 libXi.so.6=libxi6 libXrandr.so.2=libxrandr2
  libxkbcommon-x11.so.0=libxkbcommon-x11-0 libX11-xcb.so.1=libx11-xcb1"

# Names what lacks, as Debian packages, in `missing`.
missing=()
find_missing() {
  missing=()
  has_compiler || missing+=(gcc g++ libc6-dev)
  has pkg-config || missing+=(pkg-config)
  has_library libvulkan.so.1 || missing+=(libvulkan1)
  has_vulkan_driver || missing+=(mesa-vulkan-drivers)
  if [ -n "${DISPLAY:-}" ]; then
    local pair
    for pair in $X11_LIBRARIES; do
      has_library "${pair%%=*}" || missing+=("${pair##*=}")
    done
  fi
}

install_with_apt() {
  local elevate=()
  local line="apt-get update && apt-get install -y --no-install-recommends ${missing[*]}"
  if [ "$(id -u)" -ne 0 ]; then
    if has sudo && sudo -n true 2>/dev/null; then
      elevate=(sudo -n)
    else
      fail "missing: ${missing[*]}. As root, run:" "  $line"
    fi
  fi
  say "installing ${missing[*]}"
  # An index that cannot be refreshed (one dead mirror) may still hold the packages, so only the install decides.
  "${elevate[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq || say "apt-get update failed; trying the index at hand"
  "${elevate[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null ||
    fail "apt-get could not install them. As root, run:" "  $line"
  library_list=
  local asked="${missing[*]}"
  find_missing
  [ ${#missing[@]} -eq 0 ] || fail "installed $asked, but still missing: ${missing[*]}" \
    "(VK_DRIVER_FILES and VK_ICD_FILENAMES, if set, must name a file that exists)"
}

check_linux() {
  find_missing
  if [ -z "${DISPLAY:-}" ] && [ -n "${WAYLAND_DISPLAY:-}" ]; then
    say "note: the window uses X11; on this Wayland session it needs Xwayland"
  fi
  [ ${#missing[@]} -gt 0 ] || return 0
  if has apt-get; then
    install_with_apt
    return
  fi
  say "missing here (names of Debian packages): ${missing[*]}"
  say "  Fedora: sudo dnf install gcc gcc-c++ pkgconf vulkan-loader mesa-vulkan-drivers libX11 libXcursor libXi libXrandr libxkbcommon-x11"
  say "  Arch:   sudo pacman -S --needed base-devel vulkan-icd-loader vulkan-swrast libx11 libxcursor libxi libxrandr libxkbcommon-x11"
  say "  A driver for your GPU (vulkan-radeon, vulkan-intel, nvidia-utils) beats the software driver."
  has_library libvulkan.so.1 || fail "there is no Vulkan loader (libvulkan.so.1): install it, then run this again"
  has_compiler || fail "there is no C and C++ compiler: install one, then run this again"
  say "going on: the Vulkan loader is there"
}

case "$(uname -s)" in
  Linux) check_linux ;;
  Darwin)
    # Metal comes with the system.
    has_compiler || fail "there is no compiler: run xcode-select --install, then this again"
    ;;
  MINGW* | MSYS* | CYGWIN*)
    say "on Windows, a current GPU driver brings Vulkan and Direct3D 12; Rust brings or asks for the Visual Studio build tools"
    ;;
  *) say "unknown system $(uname -s): a C++ compiler, Rust and a Vulkan driver are needed" ;;
esac
check_rust
