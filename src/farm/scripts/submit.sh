#!/bin/sh
# Submits the tasks, and the merges after them. Arguments are passed to sbatch, such as --partition.
set -e
cd "$(dirname "$0")"
folder=$PWD
cd @BACK@
export BUFFON_FOLDER="$folder"
mkdir -p "$folder/logs"
tasks=$(sbatch --parsable --output="$folder/logs/%a.log" "$@" "$folder/tasks.sbatch")
sbatch --dependency=afterok:"${tasks%%;*}" --kill-on-invalid-dep=yes --output="$folder/logs/merge.log" "$@" \
    "$folder/merge.sbatch"
