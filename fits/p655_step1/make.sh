#!/usr/bin/env bash
# Makes the three fits of this page. The record is read from JAXFRIC_DATA/rock (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
record="${JAXFRIC_DATA:-../../../shared/data}/rock/p655_step1.csv"
jaxfric fit "$record" --stiffness 1.6e-3/um --out one_state
jaxfric fit "$record" --stiffness 1.6e-3/um --states 2 --out two_states
jaxfric fit "$record" --stiffness 1.6e-3/um --steps "0 s: 2.289 um/s, 23.37 s: 22.86 um/s" --out published_step
