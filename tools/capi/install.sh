#!/usr/bin/env bash
# Installs the C interface: shared library, headers for C and C++, files for pkg-config and CMake.
#
#   tools/capi/install.sh [PREFIX]        /usr/local by default
#
# Variables:
#   LIBDIR              folder of the library below PREFIX (lib); Debian's is lib/x86_64-linux-gnu
#   DESTDIR             folder that stands for / while a package is made
#   TRACK_CPU_LIBRARY   a built library; else `cargo build --release -p capi` makes one
#   TARGET              cargo's target, to cross-compile
#
# Afterwards `ldconfig` makes the library known, where PREFIX is one of the system's. The files may
# be moved together. To remove them: rm the files that this script prints.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
prefix=${1:-/usr/local}
libdir=${LIBDIR:-lib}
case $prefix in
-*) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" && exit 2 ;;
/*) ;;
*) prefix=$PWD/$prefix ;;
esac

version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/Cargo.toml")
major=${version%%.*}
if [ "$(uname -s)" = Darwin ]; then
    built=libtrack_cpu_c.dylib
    link=libtrack_cpu.dylib soname=libtrack_cpu.$major.dylib library=libtrack_cpu.$version.dylib
else
    built=libtrack_cpu_c.so
    link=libtrack_cpu.so soname=libtrack_cpu.so.$major library=libtrack_cpu.so.$version
fi

if [ -z "${TRACK_CPU_LIBRARY:-}" ]; then
    root=$here/../..
    (cd "$root" && cargo build --release --locked -p capi ${TARGET:+--target "$TARGET"}) >&2
    folder=$(cd "$root" && cd "${CARGO_TARGET_DIR:-target}" && pwd)
    TRACK_CPU_LIBRARY=$folder/${TARGET:+$TARGET/}release/$built
fi

into() { # file, folder below the prefix, name
    install -d "${DESTDIR:-}$prefix/$2"
    install -m "${4:-644}" "$1" "${DESTDIR:-}$prefix/$2/$3"
    echo "${DESTDIR:-}$prefix/$2/$3"
}
# From the library's folder up to the prefix, one .. for each of its parts.
up=$(sed 's#[^/][^/]*#..#g' <<< "$libdir")
filled=$(mktemp -d)
trap 'rm -rf "$filled"' EXIT
for template in "$here"/package/*.in; do
    sed -e "s|@VERSION@|$version|g; s|@MAJOR@|$major|g; s|@LIBDIR@|$libdir|g; s|@UP@|$up|g" \
        -e "s|@LIBRARY@|$library|g; s|@SONAME@|$soname|g" \
        "$template" > "$filled/$(basename "$template" .in)"
done

into "$TRACK_CPU_LIBRARY" "$libdir" "$library" 755
for name in "$soname" "$link"; do
    ln -sf "$library" "${DESTDIR:-}$prefix/$libdir/$name"
    echo "${DESTDIR:-}$prefix/$libdir/$name"
done
into "$here/include/track_cpu.h" include track_cpu.h
into "$here/include/track_cpu.hpp" include track_cpu.hpp
into "$filled/track_cpu.pc" "$libdir/pkgconfig" track_cpu.pc
for name in track_cpuConfig.cmake track_cpuConfigVersion.cmake; do
    into "$filled/$name" "$libdir/cmake/track_cpu" "$name"
done
