#!/usr/bin/env bash
# Builds the packages: `veilwing` (onboard) and `veilwing-desk` (everything), for amd64 and arm64, as .deb and as plain tarballs,
# with checksums; and tries what can be tried without installing them.
#
#     packaging/build.sh [--check] [ARCHITECTURE...]
#
# --check builds with the tests' profile in place of `dist`: the same files, for trying, and of this computer's architecture what
# the tests have built already, where VEILWING_COMMIT was the same then. Into target/packaging/out, or $OUT. Needs cargo, rustup and python3; on Debian and as root it installs what else is missing.
#
# What is tried: every program says its commit and its target; none needs a newer C library than the package asks for; lintian
# has no errors and no warnings; the plan of the demo has one digest on both architectures; a whole flight in virtual time is
# completed by each of them. Of another architecture than this computer's all that runs under qemu.
set -euo pipefail
cd "$(dirname "$0")/.."

profile=dist
if [ "${1:-}" = --check ]; then
    profile=test
    shift
fi
architectures=${*:-amd64 arm64}
native=$(dpkg --print-architecture)
target=${CARGO_TARGET_DIR:-target}
stage=target/packaging/stage
out=${OUT:-target/packaging/out}
cargo=${CARGO:-cargo}
mission=config/mission.toml
# Where the installed files find the schemas that editors check them by.
schemas="#:schema file:///usr/share/veilwing/schema/"
onboard=(--no-default-features --features companion,serial)
# The newest C library that the packages ask for: Debian 12, Ubuntu 22.04 and all since.
glibc=2.35

say() { printf -- '-- %s (%s s)\n' "$*" "$SECONDS"; }
fail() { printf 'FAIL %s\n' "$*" >&2; exit 1; }

triple() {
    case $1 in
        amd64) echo x86_64-unknown-linux-gnu ;;
        arm64) echo aarch64-unknown-linux-gnu ;;
        *) fail "there is no package for \"$1\": amd64, arm64" ;;
    esac
}

# How a program of an architecture is run here.
runner() {
    if [ "$native" = "$1" ]; then
        echo ""
    elif [ "$1" = arm64 ]; then
        echo "qemu-aarch64-static -L /usr/aarch64-linux-gnu"
    else
        fail "$1 cannot be run on $native"
    fi
}

install_missing() {
    local wanted=() architecture
    for architecture in $architectures; do
        rustup target add "$(triple "$architecture")" >/dev/null 2>&1 || fail "no Rust target for $architecture"
        if [ "$architecture" = arm64 ] && [ "$native" = amd64 ]; then
            wanted+=(gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static)
        fi
    done
    wanted+=(lintian binutils)
    local missing=()
    for package in "${wanted[@]}"; do
        dpkg -s "$package" >/dev/null 2>&1 || missing+=("$package")
    done
    if [ ${#missing[@]} -gt 0 ]; then
        say "installing ${missing[*]}"
        apt-get update -q >/dev/null
        DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${missing[@]}" >/dev/null
    fi
    command -v cargo-deb >/dev/null || $cargo install --locked --quiet cargo-deb
}

# build ARCHITECTURE onboard|desk: the programs, stripped, in $programs.
build() {
    local to where=() built=$target strip=strip program
    to=$(triple "$1")
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
    if [ "$1" != "$native" ]; then
        where=(--target "$to")
        built=$target/$to
        [ "$1" != arm64 ] || strip=aarch64-linux-gnu-strip
    fi
    if [ "$2" = onboard ]; then
        $cargo build --quiet --locked --profile "$profile" "${where[@]}" --package veilwing --bin veilwing "${onboard[@]}"
    else
        $cargo build --quiet --locked --profile "$profile" "${where[@]}" --workspace --bin veilwing --bin veilwing-sitl
    fi
    built=$built/$([ "$profile" = test ] && echo debug || echo "$profile")
    programs=target/packaging/programs/$1-$2
    rm -rf "$programs"
    mkdir -p "$programs"
    for program in veilwing $([ "$2" = onboard ] || echo veilwing-sitl); do
        "$strip" -o "$programs/$program" "$built/$program"
    done
}

# What a program of this architecture must be.
examine() {
    local said needs
    said=$($(runner "$1") "$programs/veilwing" --version)
    [ "$said" = "veilwing $version ($VEILWING_COMMIT, $(triple "$1"))" ] || fail "it says \"$said\""
    needs=$(readelf --version-info --wide "$programs/veilwing" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -Vu | tail -n 1)
    [ "$(printf '%s\n' "$needs" "$glibc" | sort -V | tail -n 1)" = "$glibc" ] || fail "it needs glibc $needs, not $glibc"
    echo "ok   $said, glibc $needs or newer"
}

# The files of a package beside its programs. Manual pages and completions are made by this computer's own build.
fill_stage() {
    local native=$1 variant=$2 to=$3
    rm -rf "$stage"
    mkdir -p "$stage"/{man,completions,doc,etc}
    "$native" manuals "$stage/manuals"
    mv "$stage"/manuals/*.1 "$stage/man/"
    if [ "$variant" = desk ]; then
        cp packaging/man/veilwing-sitl.1 "$stage/man/"
    fi
    gzip --best --no-name "$stage"/man/*.1
    mv "$stage"/manuals/* "$stage/completions/"
    cp docs/on-a-vehicle.md docs/ground-station.md docs/calibration.md docs/pair-protocol.md docs/radio.md docs/radios.md README.md "$stage/doc/"
    cp CHANGELOG.md "$stage/doc/NEWS.md"
    local features=()
    [ "$variant" = desk ] || features=("${onboard[@]}")
    python3 packaging/sbom.py --target "$to" "${features[@]}" --out "$stage/doc"
    gzip --best --no-name "$stage"/doc/third-party-licences.txt
    printf 'veilwing (%s-1) stable; urgency=medium\n\n  * See NEWS.md.\n\n -- %s  %s\n' "$version" \
        "The veilwing developers <maintainers@veilwing.dev>" "$(date -R -u -d "@$SOURCE_DATE_EPOCH")" >"$stage/changelog"
    conffile mission.toml
    conffile vehicle-i.toml 's|^dir = "flight-logs"|dir = "/var/lib/veilwing/flights"|'
    conffile vehicle-j.toml 's|^dir = "flight-logs"|dir = "/var/lib/veilwing/flights"|'
    sed -e "s|^#:schema ../../config/schema/|$schemas|" packaging/etc/radio.toml >"$stage/etc/radio.toml"
}

# conffile NAME [CHANGE]: an example of the tree, as a package has it.
conffile() {
    sed -e "s|^#:schema schema/|$schemas|" -e 's|config/|/etc/veilwing/|g' ${2:+-e "$2"} "config/$1" >"$stage/etc/$1"
    if [ $# -gt 1 ] && ! grep -q '^dir = "/var/lib/veilwing/flights"' "$stage/etc/$1"; then
        fail "config/$1 has no [log] dir to change"
    fi
}

# The .deb, and what is in it as a tarball.
pack() {
    local architecture=$1 variant=$2 name=veilwing arguments=() to deb tree
    to=$(triple "$architecture")
    if [ "$variant" = desk ]; then
        name=veilwing-desk
        arguments=(--variant desk)
    fi
    deb=$out/${name}_$version-1_$architecture.deb
    tree=$name-$version-$to
    rm -rf "$stage/bin"
    cp -r "target/packaging/programs/$architecture-$variant" "$stage/bin"
    cargo-deb deb --quiet --no-build --no-strip --locked --deb-version "$version-1" --target "$to" "${arguments[@]}" --package veilwing --output "$deb"
    rm -rf "$stage/$tree"
    dpkg-deb --extract "$deb" "$stage/$tree"
    tar --sort=name --mtime="@$SOURCE_DATE_EPOCH" --owner=0 --group=0 --numeric-owner -C "$stage" -czf "$out/$tree.tar.gz" "$tree"
    rm -rf "${stage:?}/$tree"
    # The tag left out asks for the number of a wish in Debian's own bug tracker.
    lintian --fail-on error,warning --tag-display-limit 0 --suppress-tags initial-upload-closes-no-bugs "$deb" 2>/dev/null || fail "lintian finds fault with $deb"
    echo "ok   $deb: $(stat -c %s "$deb") bytes, installed $(dpkg-deb --field "$deb" Installed-Size) KiB; lintian is silent"
}

# The digest of the demo's plan.
digest() {
    $(runner "$1") "$programs/veilwing" plan "$mission" --json | python3 -c 'import json, sys; print(json.load(sys.stdin)["plan_digest"])'
}

install_missing
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
if [ -z "${VEILWING_COMMIT:-}" ]; then
    VEILWING_COMMIT=$(git rev-parse --short=12 HEAD 2>/dev/null || echo unknown)
    if [ -n "$(git status --porcelain 2>/dev/null | head -n 1)" ]; then
        echo "warning: the tree has changes that are in no commit" >&2
        VEILWING_COMMIT=$VEILWING_COMMIT-dirty
    fi
fi
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export VEILWING_COMMIT SOURCE_DATE_EPOCH
mkdir -p "$out"

digests=
for variant in onboard desk; do
    say "$variant, $native"
    build "$native" "$variant"
    examine "$native"
    fill_stage "$programs/veilwing" "$variant" "$(triple "$native")"
    for architecture in $architectures; do
        if [ "$architecture" != "$native" ]; then
            say "$variant, $architecture"
            build "$architecture" "$variant"
            examine "$architecture"
        fi
        python3 packaging/sbom.py --target "$(triple "$architecture")" \
            $([ "$variant" = desk ] || echo "${onboard[@]}") --out "$stage/doc" >/dev/null
        gzip --best --no-name --force "$stage/doc/third-party-licences.txt"
        programs=target/packaging/programs/$architecture-$variant
        pack "$architecture" "$variant"
        digests+="$(digest "$architecture") $variant $architecture"$'\n'
        if [ "$variant" = desk ]; then
            say "a flight, $architecture"
            flown=$($(runner "$architecture") "$programs/veilwing" campaign tests/flight/yard.toml --runs 1 --json |
                python3 -c 'import json, sys; d = json.load(sys.stdin); print(d["completed"], len(d["violations"]))')
            [ "$flown" = "1 0" ] || fail "a flight on $architecture: \"completed, violations\" are \"$flown\""
            echo "ok   a whole flight completed on $architecture, no violation"
        fi
    done
done
printf '%s' "$digests" | sort | sed 's/^/plan /'
[ "$(printf '%s' "$digests" | cut -d' ' -f1 | sort -u | wc -l)" = 1 ] || fail "the plans differ"
echo "ok   one digest on every architecture"
(cd "$out" && sha256sum ./*.deb ./*.tar.gz >SHA256SUMS)
echo "packages of $VEILWING_COMMIT in $out, $SECONDS s"
