#!/usr/bin/env bash
# Closes the loop over one velocity step of a sepiolite gouge.
# The record is read from JAXFRIC_DATA/rock (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
record="${JAXFRIC_DATA:-../../../shared/data}/rock/velstep1_TR2_exp013_sepiolite.txt"
jaxfric loop "$record" --stiffness 1.9e-3/um --out loop
