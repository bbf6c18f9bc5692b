#!/usr/bin/env bash
# Makes everything on this page: the study (a store of 3 MB, not kept here) and its figures.
set -euo pipefail
cd "$(dirname "$0")"
store=$(mktemp -d)
trap 'rm -rf "$store"' EXIT
jaxfric study study.toml --out "$store/study.zarr"
jaxfric study --plot "$store/study.zarr" --out "$store/figures"
cp "$store"/figures/{map_end,map_slip_amplitude}.png .
