#!/usr/bin/env bash
# Executes the notebooks of this folder in place (pip install -e ".[docs,study]").
set -euo pipefail
cd "$(dirname "$0")"
for notebook in press axis study; do
  jupyter execute --inplace "$notebook.ipynb"
done
