#!/usr/bin/env bash
# The friction of a screw drive at steady speeds.
# The runs are read from JAXFRIC_DATA/servo (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
runs="${JAXFRIC_DATA:-../../../shared/data}/servo/screwdrive/driveNo1"
jaxfric axis "$runs" --rated-torque "9.84 mN m" --flip-sign --include direction_asymmetry --out loop
