#!/usr/bin/env bash
# Makes gains.json and the figure of this page.
set -euo pipefail
cd "$(dirname "$0")"
jaxfric gains --law slip --parameters "A=1 N, B=3 N, L=1 mm, V0=2 mm/s" --mass "1..3 kg" --velocity "1..10 mm/s" --margin modulus=0.5 --out .
