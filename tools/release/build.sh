#!/usr/bin/env bash
# Builds what a release consists of into a folder, and tries each part.
#
#   tools/release/build.sh FOLDER [STEP...]
#
# Steps, all by default, in this order:
#   programs   static programs for x86-64 and aarch64, each with licenses and systemd unit
#   wheels     Python wheels for both
#   deb        Debian packages of the programs
#   image      container images of the programs
#   crates     the archives for crates.io, each built alone (long)
#   check      doctor and demo by each program, aarch64 under qemu; wheels in environments of their
#              own; packages installed and removed; exposure of the systemd unit
#   sums       SBOM in CycloneDX form and SHA256SUMS
#
# Needs rustup and Python with pip. What else is missing is skipped, and said so in a line that
# begins with "skipped". Variables: QEMU (qemu-aarch64-static; also looked for in .ci/aarch64's
# cross kit), AARCH64_PYTHON (a command that runs Python with NumPy for aarch64).
set -euo pipefail
out=$(mkdir -p "${1:?usage: build.sh FOLDER [STEP...]}" && cd "$1" && pwd)
shift
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
steps=("$@")
[ $# -gt 0 ] || steps=(programs wheels deb image crates check sums)

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
# The time of everything that is packed: the same commit gives the same archives.
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH
kit=${AARCH64_KIT:-${XDG_CACHE_HOME:-$HOME/.cache}/track-cpu-aarch64}
qemu=${QEMU:-$(command -v qemu-aarch64-static || true)}
[ -n "$qemu" ] || [ ! -x "$kit/root/usr/bin/qemu-aarch64-static" ] \
    || qemu=$kit/root/usr/bin/qemu-aarch64-static
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

skipped() { printf 'skipped: %s\n' "$*"; }
failed() { printf 'failed: %s\n' "$*" >&2 && exit 1; }
has() { command -v "$1" > /dev/null; }
program() { echo "$out/track-cpu-$version-$1-linux/track-cpu"; } # of x86_64 or aarch64
debian() { if [ "$1" = x86_64 ]; then echo amd64; else echo arm64; fi; }
# Runs a program of an architecture; fails with 126 if this machine cannot.
runs() { # architecture, program, arguments
    local arch=$1
    shift
    if [ "$arch" = "$(uname -m)" ]; then
        "$@"
    elif [ "$arch" = aarch64 ] && [ -n "$qemu" ]; then
        "$qemu" "$@"
    else
        return 126
    fi
}

step_programs() {
    local arch folder built
    for arch in x86_64 aarch64; do
        built=$(tools/static.sh "$arch-unknown-linux-musl")
        folder=$(dirname "$(program "$arch")")
        rm -rf "$folder" && mkdir -p "$folder"
        install -m 755 "$built" "$folder/track-cpu"
        install -m 644 LICENSE-MIT LICENSE-APACHE README.md docs/track-cpu.service "$folder"
        tar -C "$out" --owner=0 --group=0 --sort=name --mtime="@$SOURCE_DATE_EPOCH" -cf - \
            "$(basename "$folder")" | gzip -9n > "$folder.tar.gz"
    done
}

step_wheels() {
    rm -f "$out"/*.whl
    tools/python/wheels.sh "$out"
}

step_deb() {
    has dpkg-deb || { skipped "deb: no dpkg-deb" && return; }
    local arch root name
    for arch in x86_64 aarch64; do
        root=$work/deb-$arch
        install -D -m 755 "$(program "$arch")" "$root/usr/bin/track-cpu"
        install -D -m 644 "$here/debian/options" "$root/etc/default/track-cpu"
        install -d "$root/usr/lib/systemd/system" "$root/usr/share/doc/track-cpu" "$root/DEBIAN"
        # The same unit, but that its options stand in a file which upgrades keep.
        sed -e '/^# Copy to/,/^# With --http/d' \
            -e '/^ExecStart=/,/[^\\]$/c ExecStart=/usr/bin/track-cpu serve $OPTIONS' \
            -e 's|^Type=notify|&\nEnvironmentFile=/etc/default/track-cpu|' \
            docs/track-cpu.service > "$root/usr/lib/systemd/system/track-cpu.service"
        { cat "$here/debian/copyright" && sed '1,2d; s/^$/./; s/^/ /' LICENSE-MIT; } \
            > "$root/usr/share/doc/track-cpu/copyright"
        gzip -9n < CHANGELOG.md > "$root/usr/share/doc/track-cpu/NEWS.gz"
        echo /etc/default/track-cpu > "$root/DEBIAN/conffiles"
        install -m 755 "$here/debian/postinst" "$here/debian/prerm" "$here/debian/postrm" \
            "$root/DEBIAN"
        sed -e "s/@VERSION@/$version/; s/@ARCH@/$(debian "$arch")/" \
            -e "s/@SIZE@/$(du -sk --exclude=DEBIAN "$root" | cut -f1)/" \
            "$here/debian/control" > "$root/DEBIAN/control"
        chmod 644 "$root/usr/lib/systemd/system/track-cpu.service" \
            "$root"/usr/share/doc/track-cpu/* "$root/DEBIAN/control" "$root/DEBIAN/conffiles"
        name=track-cpu_${version}_$(debian "$arch").deb
        dpkg-deb --root-owner-group -Zxz --build "$root" "$out/$name" > /dev/null
        echo "$name"
        # The program is linked statically on purpose; the package was never Debian's.
        local tags=statically-linked-binary,no-changelog,no-manual-page,maintainer-script-calls-systemctl
        ! has lintian || lintian --allow-root --fail-on error --suppress-tags "$tags" "$out/$name"
    done
}

# A tool that builds images and works here; a client without its daemon does not.
engine() {
    if has buildah; then
        echo buildah
    elif has podman; then
        echo podman
    elif has docker && docker info > /dev/null 2>&1; then
        echo docker
    fi
}

step_image() {
    local arch tool name context=$work/image
    tool=$(engine)
    [ -n "$tool" ] || { skipped "image: no buildah, no podman, no docker with a daemon" && return; }
    for arch in x86_64 aarch64; do
        install -D -m 755 "$(program "$arch")" "$context/$(debian "$arch")/track-cpu"
    done
    cp LICENSE-MIT LICENSE-APACHE "$context"
    for arch in x86_64 aarch64; do
        name=track-cpu:$version-$(debian "$arch")
        "$tool" build --quiet --platform "linux/$(debian "$arch")" --file "$here/Containerfile" \
            --tag "$name" "$context" > /dev/null
        rm -f "$out/track-cpu-$version-$arch.oci.tar"
        case $tool in
        buildah) buildah push --quiet "$name" "oci-archive:$out/track-cpu-$version-$arch.oci.tar:$version" ;;
        podman) podman save --quiet --format oci-archive --output "$out/track-cpu-$version-$arch.oci.tar" "$name" ;;
        docker) docker save --output "$out/track-cpu-$version-$arch.oci.tar" "$name" ;;
        esac
        echo "track-cpu-$version-$arch.oci.tar"
    done
}

step_crates() {
    .ci/packages --verify
}

check_program() { # architecture, program, what it came out of
    local frames=60
    [ "$1" = "$(uname -m)" ] || frames=3 # an emulated frame takes seconds
    if ! runs "$1" "$2" --version > /dev/null; then
        skipped "$3: this machine runs no $1"
        return
    fi
    runs "$1" "$2" doctor > "$work/doctor" || failed "$3: doctor: $(cat "$work/doctor")"
    runs "$1" "$2" demo --frames "$frames" --out "$work/demo" --json > "$work/demo.json" \
        || failed "$3: demo"
    python3 - "$work/demo.json" <<'PY' || failed "$3: demo"
import json, sys
result = json.loads(open(sys.argv[1]).read().splitlines()[-1])
assert result["mean_iou"] >= 0.5, result
PY
    echo "$3: doctor and demo pass"
}

check_wheel() { # architecture, wheel
    local python=("$work/python/bin/python") modules=${PYTHONPATH:-}
    if [ "$1" = "$(uname -m)" ]; then
        [ -d "$work/python" ] || python3 -m venv "$work/python"
        "${python[@]}" -m pip --quiet --disable-pip-version-check install "$2"
    elif [ -n "${AARCH64_PYTHON:-}" ]; then
        mkdir -p "$work/$1-wheel" && python3 -m zipfile -e "$2" "$work/$1-wheel"
        read -ra python <<< "$AARCH64_PYTHON"
        modules=$work/$1-wheel${modules:+:$modules}
    else
        skipped "$(basename "$2"): no Python for $1 (AARCH64_PYTHON)"
        return
    fi
    (cd "$work" && PYTHONPATH=$modules "${python[@]}" -m track_cpu demo --frames 4) \
        || failed "$2: demo"
}

check_deb() { # package; in a root of its own, as dpkg does it, without running its scripts there
    local root=$work/root
    rm -rf "$root" && mkdir -p "$root/var/lib/dpkg/updates" "$root/var/lib/dpkg/info"
    touch "$root/var/lib/dpkg/status" "$root/var/lib/dpkg/available"
    local dpkg=(dpkg --root="$root" --force-not-root --force-script-chrootless --force-architecture
        --force-depends --log=/dev/null)
    "${dpkg[@]}" --install "$1" > /dev/null
    "${dpkg[@]}" --verify track-cpu
    [ -x "$root/usr/bin/track-cpu" ] || failed "$1: no program"
    "${dpkg[@]}" --purge track-cpu > /dev/null
    local left
    left=$(find "$root" -type f -not -path "*/var/lib/dpkg/*")
    [ -z "$left" ] || failed "$1 leaves $left"
    echo "$(basename "$1"): installs and leaves nothing"
}

check_unit() {
    has systemd-analyze || { skipped "systemd unit: no systemd-analyze" && return; }
    systemd-analyze security --offline=true --threshold=30 --no-pager docs/track-cpu.service \
        > "$work/unit" || failed "systemd unit: $(tail -n 1 "$work/unit")"
    tail -n 1 "$work/unit"
}

step_check() {
    local arch file
    check_unit
    for arch in x86_64 aarch64; do
        check_program "$arch" "$(program "$arch")" "program for $arch"
        file=$out/track-cpu_${version}_$(debian "$arch").deb
        if [ -f "$file" ]; then
            check_deb "$file"
        fi
        for file in "$out"/track_cpu-*"_$arch.whl"; do
            [ ! -f "$file" ] || check_wheel "$arch" "$file"
        done
        file=$out/track-cpu-$version-$arch.oci.tar
        if [ -f "$file" ]; then
            python3 "$here/unpack_image.py" "$file" "$work/image-$arch"
            check_program "$arch" "$work/image-$arch/usr/bin/track-cpu" "image for $arch"
        fi
    done
}

step_sums() {
    python3 "$here/sbom.py" > "$out/track-cpu-$version.cdx.json"
    (cd "$out" && find . -maxdepth 1 -type f -not -name SHA256SUMS -printf '%P\n' | sort \
        | xargs sha256sum > SHA256SUMS)
    cat "$out/SHA256SUMS"
}

for step in "${steps[@]}"; do
    declare -F "step_$step" > /dev/null || failed "no step $step"
    printf '\n== %s\n' "$step"
    "step_$step"
done
