#!/usr/bin/env bash
# Closes the loop over two velocity steps: train on the first, report on the second.
# The record is read from JAXFRIC_DATA/rock (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
record="${JAXFRIC_DATA:-../../../shared/data}/rock/p655_steps12.csv"
jaxfric loop "$record" --stiffness 1.6e-3/um --out loop
