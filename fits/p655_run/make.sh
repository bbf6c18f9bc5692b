#!/usr/bin/env bash
# Takes the run p655 from its raw file and its own reduction script to the table of its steps.
# Both are read from JAXFRIC_DATA/rock (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
rock="${JAXFRIC_DATA:-../../../shared/data}/rock"
jaxfric run "$rock/p655intact100l" --reduce "$rock/p655_r" --stiffness "0.16 MPa/um" --slip-trend --out run
rm -f run/run.json run/run.html run/step_*.png run/holds.png run/.jaxfric.json
jaxfric loop "$rock/p655intact100l" --reduce "$rock/p655_r" --run --downsample-to 6000 --stiffness "0.16 MPa/um" --out loop
find loop -type f ! -name residual.png ! -name location.png -delete
