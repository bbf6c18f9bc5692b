#!/usr/bin/env bash
# Closes the loop over one velocity step of basalt.
# The record is read from JAXFRIC_DATA/rock (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
record="${JAXFRIC_DATA:-../../../shared/data}/rock/velstep4_BRAVA_expb819_basalt.txt"
jaxfric loop "$record" --stiffness 3.1e-3/um --out loop
