#!/usr/bin/env bash
# Builds the peers' benchmarks into the folder given (default: target/peers). Needs Debian's libmrpt-maps-dev,
# liboctomap-dev, libopenvdb-dev, libboost-dev, libboost-iostreams-dev, libtbb-dev and g++.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-$here/../../target/peers}
mkdir -p "$out"
flags="-O3 -march=native -std=c++17 -w"
g++ $flags "$here/octomap.cpp" -o "$out/octomap" -loctomap -loctomath
g++ $flags "$here/openvdb.cpp" -o "$out/openvdb" -lopenvdb -ltbb
# Debian's MRPT keeps each module's headers in a folder of its own and has no pkg-config files.
mrpt_headers=$(for module in /usr/include/mrpt/*/include; do printf -- '-I%s ' "$module"; done)
g++ $flags $mrpt_headers "$here/mrpt.cpp" -o "$out/mrpt" -lmrpt-maps -lmrpt-obs -lmrpt-math -lmrpt-poses -lmrpt-system -lmrpt-core
echo "built into $out: octomap openvdb mrpt"
