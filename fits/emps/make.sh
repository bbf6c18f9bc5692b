#!/usr/bin/env bash
# Closes the loop on a ball-screw slider that moves back and forth under PD control.
# The record is read from JAXFRIC_DATA/servo (see data/public.toml).
set -euo pipefail
cd "$(dirname "$0")"
record="${JAXFRIC_DATA:-../../../shared/data}/servo/emps/DATA_EMPS.mat"
jaxfric axis "$record" --out loop
rm -f loop/*.svg
