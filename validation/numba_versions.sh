#!/usr/bin/env bash
# Tries the quick way of compiling on the oldest and the newest version of numba that it is said to
# know, each in an environment of its own: the tests of compiling and the golden results.
#
#     validation/numba_versions.sh [FOLDER]
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:-$(mktemp -d)}
versions=$(sed -n 's/^TESTED = (0, \([0-9]*\)), (0, \([0-9]*\))$/\1 \2/p' \
    "$repository/stickslip_ros/base/numba_internals.py")
for version in $versions; do
    python3 -m venv "$folder/$version"
    "$folder/$version/bin/pip" install -q "numba==0.$version.*" "$repository[test]"
    cd "$repository"
    export PYTHONPATH=$repository NUMBA_CACHE_DIR=$folder/cache-$version
    "$folder/$version/bin/python" -m pytest -q -n 0 test/base/test_compiled.py test/golden
done
