#!/usr/bin/env bash
# Makes everything on this page: base fit, its gains, the loop, its gains, and the true plant under both.
set -euo pipefail
cd "$(dirname "$0")"
record=../../data/undeclared.csv
machine=(--normal-force "500 N" --mass "2 kg" --velocity "1..10 um/s" --max-kv "1e5 N*s/m" --margin stiffness=1.2 --margin modulus=0)
jaxfric fit "$record" --stiffness 5e-3/um --out base
jaxfric gains --from base/fit.json "${machine[@]}" --out gains_before
jaxfric loop "$record" --stiffness 5e-3/um --out loop
jaxfric gains --from loop/loop.json "${machine[@]}" --out gains_after
python plant.py gains_before/gains.json gains_after/gains.json
